"""`vbaa calibrate SESSION -o rig.json`."""

from __future__ import annotations

import argparse
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .intrinsics_cli import MODELS

if TYPE_CHECKING:
    from ..session import Session
    from .calibration import Calibration

PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "torch", "kornia")


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `vbaa calibrate`."""
    parser.add_argument("session", type=Path, help="the session folder (docs/formats.md)")
    parser.add_argument("-o", "--output", type=Path, required=True, help="rig.json to write")
    parser.add_argument(
        "--model", default="auto", choices=MODELS, help="lens model (default: chosen on held-out views)"
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Calibrate a session and write rig.json."""
    from ..console import say
    from ..files import refuse_overwrite, write_json
    from ..session import load_session, refuse_measured
    from .calibration import calibrate
    from .calibration_report import doubts, report, summary

    refuse_overwrite(args.output, args.force)
    refuse_measured(args.output, args.session)
    session = load_session(args.session)
    calibration = calibrate(session, args.model)
    warnings = doubts(calibration)
    report(calibration, warnings)
    write_json(args.output, rig_document(session, calibration, warnings, args.argv), force=args.force)
    say(f"wrote {args.output}")
    return {"rig": str(args.output), **summary(calibration, warnings), **numbers(calibration)}


def rig_document(
    session: Session, calibration: Calibration, warnings: Sequence[str], command: Sequence[str]
) -> dict[str, Any]:
    """rig.json: the rig, the evidence for it, and what it was made of by which command line."""
    from .calibration_report import evidence

    return calibration.rig.to_dict() | {
        "quality": evidence(calibration, warnings),
        "inputs_sha256": inputs(session),
        "versions": {"python": platform.python_version(), "vbaa-calib": version("vbaa-calib")}
        | {name: version(name) for name in PACKAGES},
        "command": list(command),
    }


def inputs(session: Session) -> dict[str, str]:
    """sha256 of every file that the calibration read."""
    from ..files import sha256
    from .session_plane import picture_folders

    files = [session.root / "session.yaml"]
    for name in ("intrinsics", *picture_folders(session), "noload", "loads"):
        files += sorted(path for path in (session.root / name).iterdir() if path.is_file())
    return {str(path.relative_to(session.root)): sha256(path) for path in files}


def numbers(calibration: Calibration) -> dict[str, Any]:
    """The calibrated values with their standard deviations."""
    described = calibration.rig.to_dict()
    return {key: described[key] for key in ("T_antenna_camera", "antenna", "moment_sensor")}
