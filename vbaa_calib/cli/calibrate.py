"""`vbaa calibrate SESSION -o rig.json`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_overwrite, write_json

from .intrinsics import MODELS


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "session",
        type=Path,
        nargs="+",
        help="the session folder (docs/formats.md); or many of one rig over time, with their dates in their names, or "
        "a CSV with the columns session and date",
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="rig.json to write; a folder for the rigs of many sessions"
    )
    parser.add_argument(
        "--lens-model",
        dest="model",
        default="auto",
        choices=MODELS,
        help="lens model (default: the one expected to be least off)",
    )
    parser.add_argument(
        "--camera",
        type=Path,
        metavar="FILE",
        help="start from a known lens: camera.json, rig.json, or a file of ROS, OpenCV, Kalibr, mrcal or COLMAP; "
        "intrinsics/ is not needed then, and tests it if it is there",
    )
    parser.add_argument("--camera-name", metavar="NAME", help="which one, where FILE holds several (cam1; CAMERA_ID)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Calibrate a session and write rig.json; the exit code is 1 where its lens must not be used."""
    from vbaa_calib.calibrate.given_lens import read_lens
    from vbaa_calib.calibrate.pipeline import calibrate
    from vbaa_calib.calibrate.report import doubts, report, rig_document, summary
    from vbaa_calib.session import load_session, refuse_measured

    inputs = [] if args.camera is None else [args.camera]
    refuse_overwrite(args.output, args.force, inputs)
    if args.camera_name is not None and not inputs:
        raise InputError("names a camera of no file", where="--camera-name", remedy="give --camera FILE, too")
    if inputs and args.model != "auto":
        raise InputError("--camera brings its lens model", where="--lens-model", remedy="leave one of the two out")
    refuse_measured(args.output, args.session)
    session = load_session(args.session)
    given = None if args.camera is None else read_lens(args.camera, args.camera_name)
    calibration = calibrate(session, args.model, given)
    warnings = doubts(calibration)
    report(calibration, warnings)
    write_json(args.output, rig_document(calibration, warnings, args.argv), force=args.force)
    say(f"wrote {args.output}")
    described = calibration.rig.to_dict()
    numbers = {key: described[key] for key in ("T_antenna_camera", "antenna", "moment_sensor")}
    code = calibration.lens.verdict.exit_code
    return {"rig": str(args.output), **summary(calibration, warnings), **numbers, "exit_code": code}
