"""`vbaa check`: is this rig still right? A verdict in words, check.json, and a report to read."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `vbaa check`."""
    parser.add_argument("rig", type=Path, help="rig.json, as vbaa calibrate writes it")
    parser.add_argument(
        "session",
        type=Path,
        nargs="?",
        help="a session to hold it against: one new picture of the board in plane/ and one in noload/ will do",
    )
    parser.add_argument("--html", type=Path, metavar="REPORT", help="write a page that opens offline in any browser")
    parser.add_argument("-o", "--output", type=Path, metavar="CHECK", help="check.json to write")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Judge the rig. Returns all numbers; the exit code is 0 whatever the verdict.

    Raises InputError for a broken rig or session, or a file in the way.
    """
    from vbaa_calib.errors import InputError
    from vbaa_calib.files import refuse_overwrite, write_json, write_text

    for path, suffixes in ((args.html, (".html", ".htm")), (args.output, (".json",))):
        if path is not None:
            if path.suffix.lower() not in suffixes:
                raise InputError(f"is not a {suffixes[0]}", where=path, remedy=f"name it something{suffixes[0]}")
            refuse_overwrite(path, args.force)

    from vbaa_calib.calibrate.recheck import assess
    from vbaa_calib.console import say

    from .check_page import page

    document = assess(args.rig, args.session).to_dict()
    for finding in [*document["session_findings"], *document["findings"]]:
        say(f"{finding['level']:14s} {finding['question']} {finding['words']}")
        if finding["remedy"]:
            say(f"{'':14s} → {finding['remedy']}")
    say(f"verdict        {document['verdict']}")
    if args.output is not None:
        write_json(args.output, document, args.force)
        say(f"wrote {args.output}")
    if args.html is not None:
        write_text(args.html, page(document), args.force)
        say(f"wrote {args.html}")
    return document
