"""`vbaa estimate`: a recording to contacts.csv, and a report to read."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from estimator.cli import estimate as cli


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa estimate`."""
    cli.configure(parser)
    parser.add_argument("--report", type=Path, metavar="PAGE", help="the report's name (default: beside the output)")
    parser.add_argument("--no-report", action="store_true", help="leave the report out")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Estimate every frame of a recording, write contacts.csv, then report.html. Refuses before any work."""
    from vbaa_calib.core.console import say
    from vbaa_calib.core.errors import InputError
    from viz.files.outputs import PAGES, refuse_output
    from viz.report.make import Sources, beside, make_report

    if args.no_report:
        if args.report is not None:
            raise InputError("--report and --no-report", where="vbaa estimate", remedy="give one of them")
        return {**cli.run(args), "report": None}
    cli.check_outputs(args)
    output = beside(args.output) if args.report is None else args.report
    refuse_output(output, PAGES, args.force)
    result = cli.run(args)
    sources = Sources(args.output, args.rig, args.session, background=args.background, drift=result["drift"])
    title = f"Contacts of the antenna: {args.session.resolve().name}"
    make_report(output, sources, title=title, argv=args.argv, force=args.force)
    say(f"wrote {output}: open it in a browser")
    return {**result, "report": str(output)}
