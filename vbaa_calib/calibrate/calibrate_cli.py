"""`vbaa calibrate SESSION -o rig.json`."""

from __future__ import annotations

import argparse
import platform
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .intrinsics_cli import MODELS

if TYPE_CHECKING:
    from ..session import Session
    from .session_rig import Calibration

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
    from ..session import load_session
    from .session_rig import report, summary

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
    from ..detect.corners import detect_folder
    from ..images import list_images, read_gray
    from ..session import check_pictures, read_loads, read_noload
    from .intrinsics import solve_intrinsics
    from .plane import solve_board_pose
    from .session_rig import Calibration, doubts, make_rig, pose_from_jig, require_jig, solve_antenna

    T_antenna_board = require_jig(session)
    noload, loads = read_noload(session), read_loads(session)
    stills = [still.image for still in (*noload, *loads) if still.image is not None]
    photos, in_jig = (list_images(session.root / name) for name in ("intrinsics", "plane"))
    height, width = read_gray(photos[0]).shape
    check_pictures((*photos, *in_jig, *stills), (width, height), f"{photos[0].name} is")

    # the jig first: one picture tells whether the board is the one described
    jig_views = detect_folder(session.root / "plane", session.board)
    lens = solve_intrinsics(detect_folder(session.root / "intrinsics", session.board), session.board, lens_model)
    board_pose = solve_board_pose(jig_views, session.board, lens.camera)
    T_antenna_camera, covariance = pose_from_jig(board_pose, lens.camera, T_antenna_board)
    joint, observations = solve_antenna(session, lens.camera, T_antenna_camera, covariance)
    rig = make_rig(session, lens.camera, joint, observations)
    return Calibration(rig, lens, board_pose, joint, doubts(session, rig, board_pose, joint, [*noload, *loads]))


def inputs(session: Session) -> dict[str, str]:
    """sha256 of every file that the calibration read."""
    from ..files import sha256

    folders = ("intrinsics", "plane", "noload", "loads")
    files = [session.root / "session.yaml"]
    for name in folders:
        files += sorted(path for path in (session.root / name).iterdir() if path.is_file())
    return {str(path.relative_to(session.root)): sha256(path) for path in files}


def numbers(calibration: Calibration) -> dict[str, Any]:
    """The calibrated values with their standard deviations."""
    described = calibration.rig.to_dict()
    return {key: described[key] for key in ("T_antenna_camera", "antenna", "moment_sensor")}
