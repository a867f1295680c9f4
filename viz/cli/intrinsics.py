"""`vbaa intrinsics`: the lens from photos of a board, and a page to read about it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vbaa_calib.cli import intrinsics as lens


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `vbaa intrinsics`."""
    lens.configure(parser)
    parser.add_argument("--html", type=Path, metavar="REPORT", help="write a page that opens offline in any browser")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Solve for the lens. Returns its numbers; the exit code is 1 where it must not be used.

    Raises InputError for pictures, a board or a call that is wrong, or a file in the way.
    """
    from viz.files.outputs import PAGES, refuse_output

    if args.html is not None:
        refuse_output(args.html, PAGES, args.force, [args.board])
    with lens.folder_of(args):
        return _solved(args)


def _solved(args: argparse.Namespace) -> dict[str, Any]:
    from vbaa_calib.core.files import write_text

    result, solution, views, board = lens.solve(args)
    if args.html is not None:
        from vbaa_calib.core.console import say
        from viz.report.lens import page

        write_text(args.html, page(solution, views, board, result, args.images), args.force)
        say(f"wrote {args.html}")
    return result
