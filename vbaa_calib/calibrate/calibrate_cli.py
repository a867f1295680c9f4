"""`vbaa calibrate SESSION -o rig.json`."""

from __future__ import annotations

import argparse
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..console import say
from ..detect.corners import detect_folder
from ..files import refuse_overwrite, sha256, write_json
from ..images import list_images
from ..session import Session, load_session, read_loads, read_noload
from .intrinsics import solve_intrinsics
from .intrinsics_cli import MODELS
from .plane import solve_board_pose
from .session_rig import Calibration, doubts, make_rig, pose_from_jig, report, require_jig, solve_antenna, summary

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
    refuse_overwrite(args.output, args.force)
    session = load_session(args.session)
    calibration = calibrate(session, args.model)
    report(calibration)
    result = summary(calibration)
    write_json(
        args.output,
        calibration.rig.to_dict()
        | {
            "quality": result,
            "inputs_sha256": inputs(session),
            "versions": {"python": platform.python_version(), "vbaa-calib": version("vbaa-calib")}
            | {name: version(name) for name in PACKAGES},
            "command": list(args.argv),
        },
        force=args.force,
    )
    say(f"wrote {args.output}")
    return {"rig": str(args.output), **result, **numbers(calibration)}


def calibrate(session: Session, lens_model: str = "auto") -> Calibration:
    """A session to a rig. Everything that can be wrong with the inputs is checked before the long work."""
    T_antenna_board = require_jig(session)
    noload, loads = read_noload(session), read_loads(session)
    folders = [session.root / name for name in ("intrinsics", "plane")]
    for folder in folders:
        list_images(folder)
    lens = solve_intrinsics(detect_folder(folders[0], session.board), session.board, lens_model)
    board_pose = solve_board_pose(detect_folder(folders[1], session.board), session.board, lens.camera)
    T_antenna_camera, covariance = pose_from_jig(board_pose, lens.camera, T_antenna_board)
    joint, observations = solve_antenna(session, lens.camera, T_antenna_camera, covariance)
    rig = make_rig(session, lens.camera, joint, observations)
    return Calibration(rig, lens, board_pose, joint, doubts(session, rig, board_pose, joint, [*noload, *loads]))


def inputs(session: Session) -> dict[str, str]:
    """sha256 of every file that the calibration read."""
    folders = ("intrinsics", "plane", "noload", "loads")
    files = [session.root / "session.yaml"]
    for name in folders:
        files += sorted(path for path in (session.root / name).iterdir() if path.is_file())
    return {str(path.relative_to(session.root)): sha256(path) for path in files}


def numbers(calibration: Calibration) -> dict[str, Any]:
    """The calibrated values with their standard deviations."""
    described = calibration.rig.to_dict()
    return {key: described[key] for key in ("T_antenna_camera", "antenna", "moment_sensor")}
