"""`vbaa intrinsics IMAGES --board board.yaml -o camera.json`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_overwrite, write_json

if TYPE_CHECKING:
    from vbaa_calib.calibrate.lens.intrinsics import LensSolution

MODELS = ("auto", "none", "radial", "opencv4", "opencv5", "rational", "thin", "tilted", "fisheye")


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", type=Path, help="folder of photos of the board in many poses")
    parser.add_argument("--board", type=Path, required=True, help="board.yaml, or a session.yaml")
    parser.add_argument("-o", "--output", type=Path, required=True, help="camera.json to write")
    parser.add_argument(
        "--model",
        choices=MODELS,
        default="auto",
        help="lens: auto takes the simplest that predicts held-out views; none, radial (k1 k2), opencv4 and opencv5 "
        "(coefficients), rational (8), thin (12), tilted (14), fisheye (default: auto)",
    )
    parser.add_argument(
        "--min-corners", type=int, default=6, metavar="N", help="drop photos with fewer corners (default: 6)"
    )
    parser.add_argument("--fix-aspect", action="store_true", help="hold fx = fy (square pixels)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Detect, solve, write camera.json. Returns its numbers; the exit code is 1 where the lens must not be used."""
    from vbaa_calib.calibrate.faults.views import judge_views
    from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
    from vbaa_calib.calibrate.report import camera_document
    from vbaa_calib.core.images import list_images
    from vbaa_calib.detect.board.board_file import load_board
    from vbaa_calib.detect.board.corners import detect_folder

    refuse_overwrite(args.output, args.force, [args.board])
    if args.min_corners < 4:
        raise InputError(f"--min-corners is {args.min_corners}", remedy="4 corners are the least that fix a pose")
    spec = load_board(args.board)
    refuse_overwrite(args.output, args.force, list_images(args.images))
    views = detect_folder(args.images, spec)
    solution = solve_intrinsics(views, spec, args.model, args.min_corners, args.fix_aspect)
    solution = judge_views(views, solution, spec)
    document = camera_document(solution, spec)
    write_json(args.output, document, args.force)
    _report(solution)
    say(f"wrote {args.output}")
    return {"output": str(args.output), **document, "exit_code": solution.verdict.exit_code}


def _report(solution: LensSolution) -> None:
    """The result in a few lines of prose."""
    matrix, covariance = solution.camera.matrix, solution.camera.covariance
    assert covariance is not None
    std = covariance.diagonal().clip(0.0) ** 0.5
    for candidate in solution.comparison:
        folds = "" if candidate.monotonic else "  folds inside the picture"
        halves = "" if candidate.halves is None else f", halves differ by {candidate.halves:.1f} predicted deviations"
        say(
            f"  {candidate.model:9s} rms {candidate.rms_px:.3f} px, held out {candidate.held_out_rms_px:.3f} px"
            f"{halves}{folds}"
        )
    used = sum(view.corners for view in solution.views)
    outliers = sum(view.left_out for view in solution.views)
    without = f", {solution.rms_inliers_px:.4f} px without {outliers} outliers" if outliers else ""
    say(
        f"lens       {solution.model}: rms {solution.rms_px:.4f} px over {used + outliers} corners{without}, "
        f"{len(solution.views)} photos"
    )
    say(
        f"focal      {matrix[0, 0]:.2f} ± {std[0]:.2f}, {matrix[1, 1]:.2f} ± {std[1]:.2f} px, "
        f"centre {matrix[0, 2]:.2f} ± {std[2]:.2f}, {matrix[1, 2]:.2f} ± {std[3]:.2f} px"
    )
    for view in solution.views:
        if view.outlying or view.left_out:
            gross = f", {view.left_out} outlier corners left out" if view.left_out else ""
            say(f"look at    {view.name}: rms {view.rms_px:.2f} px{gross}")
    for dropped in solution.dropped:
        say(f"dropped    {dropped.name}: {dropped.reason}")
    say(f"board      {'bent, solved with that' if solution.board_flex.used else 'flat'}: {solution.board_flex.reason}")
    for one in solution.verdict.diagnoses:
        say(f"{'wrong' if one.grave else 'look at':10s} {one}")
    say(f"verdict    {solution.verdict.words}")
