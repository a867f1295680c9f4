"""`vbaa check`: whether a rig is valid, as a verdict in words, check.json, and a report."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from vbaa_calib.cli.options import add_joints, joints_rad
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import write_json, write_text
from viz.files.outputs import PAGES, refuse_output

from .streams import add_watch


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rig", type=Path, help="rig.json, as vbaa calibrate writes it")
    against = "a session to hold it against; with --jig or --free the one that the rig was calibrated from, for its "
    against += "board and jig alone, if rig.json does not record them; with --watch a source of `vbaa live`"
    parser.add_argument("session", nargs="?", help=against)
    new = parser.add_argument_group("new pictures")
    new.add_argument("--jig", type=Path, metavar="PICTURE", help="the board in its jig, as it is now")
    new.add_argument("--free", type=Path, metavar="PICTURE", help="the free antenna, as it is now")
    add_joints(new, "the joint's reading with --free")
    new.add_argument("--moment", type=float, metavar="NM", help="the moment's reading with --free (default: not noted)")
    add_watch(parser)
    parser.add_argument("--camera-name", metavar="NAME", help="the camera to check, of several (the first)")
    parser.add_argument("--html", type=Path, metavar="REPORT", help="write a page that opens offline in any browser")
    parser.add_argument("-o", "--output", type=Path, metavar="CHECK", help="check.json to write")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Check the rig. Returns all numbers; the exit code is 1 where it fails.

    Raises InputError for a broken rig or session, or a file in the way.
    """
    for path, suffixes in ((args.html, PAGES), (args.output, (".json",))):
        if path is not None:
            refuse_output(path, suffixes, args.force)
    if args.watch is not None:
        return _watched(args)
    if args.moment is not None and math.isnan(args.moment):
        raise InputError("--moment is nan", remedy="give the sensor's reading in N·m, or leave it out")
    free = joints_rad(args) | ({} if args.moment is None else {"moment": args.moment})
    if args.free is None and free:
        flags = ", ".join(f"--{name}" for name in free)
        raise InputError(f"{flags} without --free", remedy="they belong to the picture of the free antenna")

    from vbaa_calib.calibrate.check.assessment import assess
    from vbaa_calib.calibrate.check.finding import FAILS
    from vbaa_calib.session import Still
    from viz.report.check import page

    unloaded = None
    if args.free is not None:
        unloaded = Still(args.free, free.get("pan", 0.0), free.get("tilt", 0.0), free.get("moment", math.nan))
    session = None if args.session is None else Path(args.session)
    document = assess(args.rig, session, args.jig, unloaded, args.camera_name).to_dict()
    for finding in [*document["session_findings"], *document["findings"]]:
        say(f"{finding['level']:14s} {finding['question']} {finding['words']}")
        if finding["remedy"]:
            say(f"{'':14s} → {finding['remedy']}")
    own = ", by the pictures that it was calibrated from: take new ones to see whether it still does"
    say(f"verdict        {document['verdict']}{own if document['own_pictures'] else ''}")
    if args.output is not None:
        write_json(args.output, document, args.force)
        say(f"wrote {args.output}")
    if args.html is not None:
        write_text(args.html, page(document), args.force)
        say(f"wrote {args.html}")
    return document | {"exit_code": int(document["verdict"] == FAILS)}


def _watched(args: argparse.Namespace) -> dict[str, Any]:
    """The summary of a watched stream, with its alarms. Raises InputError for options of another check."""
    from . import live

    if args.session is None:
        remedy = "name one, as in vbaa check rig.json camera:0 --watch"
        raise InputError("--watch without a source", where="vbaa check", remedy=remedy)
    others = {"--jig": args.jig, "--free": args.free, "--moment": args.moment, "--camera-name": args.camera_name}
    others |= {"--html": args.html, "--output": args.output}
    if wrong := [name for name, value in others.items() if value is not None]:
        raise InputError(f"{', '.join(wrong)} with --watch", where="vbaa check", remedy="check once, or watch")
    parser = argparse.ArgumentParser()
    live.configure(parser)
    angles = [f"--{name}={value}" for name, value in joints_rad(args).items()]
    options = parser.parse_args([str(args.rig), args.session, "--watch", args.watch, "--no-final", *angles])
    options.json, options.force = args.json, args.force
    return options.run(options)
