"""`vbaa report`: contacts.csv as an HTML page."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vbaa_calib.cli.options import add_antenna
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from viz.files.outputs import PAGES, refuse_output, report_path


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("contacts", type=Path, help="contacts.csv, as vbaa estimate writes it")
    add_antenna(parser)
    parser.add_argument("--rig", type=Path, help="rig.json: friction, stiffness, and the rig in the picture need it")
    parser.add_argument("--framewise", type=Path, help="contacts.csv that vbaa refine made these of: drawn beside them")
    parser.add_argument("--session", type=Path, help="the session folder: adds a picture of its recording; needs --rig")
    parser.add_argument("--truth", type=Path, help="truth.json of a synthetic session: drawn beside the estimates")
    parser.add_argument("-o", "--output", type=Path, metavar="PAGE", help="the page (default: beside the contacts)")
    parser.add_argument("--title", default="Contacts of the antenna", help="title of the page")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the page. Returns its path. Raises InputError for wrong input or an existing file."""
    output = report_path(args.contacts) if args.output is None else args.output
    refuse_output(output, PAGES, args.force)
    if args.session is not None and args.rig is None:
        raise InputError("--session needs --rig", where="vbaa report", remedy="give the rig.json it was recorded with")
    from viz.report.make import Sources, make_report

    more = {"framewise": args.framewise, "antenna": args.antenna}
    sources = Sources(args.contacts, args.rig, args.session, args.truth, **more)
    make_report(output, sources, title=args.title, argv=args.argv, force=args.force)
    say(f"{output}: {output.stat().st_size / 1e6:.1f} MB, opens offline in any browser")
    return {"report": str(output)}
