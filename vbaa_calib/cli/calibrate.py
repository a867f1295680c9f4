"""`vbaa calibrate SESSION -o rig.json`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .intrinsics import MODELS


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="the session folder (docs/formats.md)")
    parser.add_argument("-o", "--output", type=Path, required=True, help="rig.json to write")
    parser.add_argument(
        "--model", default="auto", choices=MODELS, help="lens model (default: chosen on held-out views)"
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Calibrate a session and write rig.json; the exit code is 1 where its lens must not be used."""
    from vbaa_calib.calibrate.pipeline import calibrate
    from vbaa_calib.calibrate.report import doubts, report, rig_document, summary
    from vbaa_calib.core.console import say
    from vbaa_calib.core.files import refuse_overwrite, write_json
    from vbaa_calib.session import load_session, refuse_measured

    refuse_overwrite(args.output, args.force)
    refuse_measured(args.output, args.session)
    session = load_session(args.session)
    calibration = calibrate(session, args.model)
    warnings = doubts(calibration)
    report(calibration, warnings)
    write_json(args.output, rig_document(calibration, warnings, args.argv), force=args.force)
    say(f"wrote {args.output}")
    described = calibration.rig.to_dict()
    numbers = {key: described[key] for key in ("T_antenna_camera", "antenna", "moment_sensor")}
    code = calibration.lens.verdict.exit_code
    return {"rig": str(args.output), **summary(calibration, warnings), **numbers, "exit_code": code}
