"""Whether the pictures of the board in the jig suffice: uncertainty on plane C by them and the lens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.board_flex import Bend
from vbaa_calib.calibrate.lens.models import PROJECTIONS
from vbaa_calib.calibrate.pose.board_pose import BoardPose, solve_board_pose
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.detect.board.corners import BoardView

from .view_uncertainty import WorkPlane

_LEAST_PICTURES = 3
_LEAST_GAIN = 0.025


@dataclass(frozen=True, eq=False)
class PlaneProgress:
    """Uncertainty on plane C by the pictures of the jig so far.

    std_m : predicted deviation of points on plane C by lens and board, rms over the work area; NaN while unknown. The
        jig's own accuracy is not in it.
    enough : whether to go on. words : why, or what is missing, and what to do.
    """

    std_m: float
    enough: bool
    words: str


def plane_progress(
    views: Sequence[BoardView],
    spec: BoardSpec,
    camera: Camera,
    bend: Bend | None,
    plane: WorkPlane,
    goal_m: float = 1e-4,
) -> PlaneProgress:
    """Judge the pictures of the board in the jig, which stands still in all of them.

    camera : with its covariance. bend : of the board, as the lens' solve found it. plane : `WorkPlane` in this camera.
    """
    try:
        board = solve_board_pose(views, spec, camera, bend)
    except (InputError, SolveError) as error:
        what = error.what if isinstance(error, InputError) else str(error)
        remedy = f": {error.remedy}" if isinstance(error, InputError) and error.remedy else ""
        return PlaneProgress(np.nan, False, f"{what}{remedy}.")
    if camera.covariance is None:
        words = "The lens has no covariance, and plane C no uncertainty: calibrate it with vbaa intrinsics."
        return PlaneProgress(np.nan, False, words)
    lens_m, board_m = _shares_m(board, camera, plane)
    std_m = float(np.hypot(lens_m, board_m))
    gain = 1.0 - float(np.hypot(lens_m, board_m * np.sqrt(1.0 - _next_share(views, board)))) / std_m
    return PlaneProgress(std_m, *_judged(board, len(views), std_m, lens_m, goal_m, gain))


def _shares_m(board: BoardPose, camera: Camera, plane: WorkPlane) -> tuple[float, float]:
    """Deviations of points on the plane from the lens and from the board's pose; NaN where too few are in view."""
    points = plane.points
    space = plane.T_camera_plane @ np.column_stack([points, np.zeros(len(points))])
    pixels, valid = camera.project(space)
    inside = valid & camera.in_picture(pixels)
    if inside.mean() < 0.5 or camera.covariance is None:
        return np.nan, np.nan
    intrinsics = camera.parameters
    _, by_lens, by_point = PROJECTIONS[camera.model](space[inside], np.zeros(6), intrinsics)
    by_lens, by_point = by_lens.reshape(-1, 2, len(intrinsics)), by_point[:, 3:].reshape(-1, 2, 3)
    lever = space[inside] - board.T_camera_board.translation_m
    by_turn = np.cross(lever[:, None, :], by_point)
    by_pose = np.concatenate([by_turn, by_point], axis=-1)
    in_plane = by_point @ plane.T_camera_plane.rotation[:, :2]
    from_lens = np.linalg.solve(in_plane, by_lens + by_pose @ board.lens_sensitivity)
    from_board = np.linalg.solve(in_plane, by_pose)
    return _rms(from_lens, camera.covariance), _rms(from_board, board.covariance)


def _rms(jacobian: np.ndarray, covariance: np.ndarray) -> float:
    carried = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
    return float(np.sqrt(np.trace(carried, axis1=-2, axis2=-1).mean()))


def _next_share(views: Sequence[BoardView], board: BoardPose) -> float:
    """Part by which one more picture lowers the variance of the board's pose.

    Only what differs from picture to picture averages out; what they share, as print and lens, does not.
    """
    count = len(views)
    if count < 2:
        return 1.0 - count / (count + 1)
    ids = sorted(set.intersection(*({*view.ids.tolist()} for view in views)))
    if not ids:
        return 0.0
    stack = np.stack([view.corners_px[[view.ids.tolist().index(corner) for corner in ids]] for view in views])
    noise_px2 = float(stack.var(axis=0, ddof=1).mean())
    misfit_px2 = max(board.rms_px**2 / 2.0, 1e-12)
    return min(noise_px2 * (1.0 / count - 1.0 / (count + 1)) / misfit_px2, 1.0 / (count + 1))


def _judged(
    board: BoardPose, pictures: int, std_m: float, lens_m: float, goal_m: float, gain: float
) -> tuple[bool, str]:
    now = f"Points on plane C are known to {1e3 * std_m:.3f} mm (one standard deviation, lens and jig together)"
    if not np.isfinite(std_m):
        return False, "Plane C is hardly in the picture: turn the camera to where the antenna moves."
    if board.is_ambiguous:
        return False, f"{now}, but two poses of the board explain the picture: tilt camera and board to each other."
    if pictures < _LEAST_PICTURES:
        return False, f"{now}; {_LEAST_PICTURES - pictures} more of the jig as it stands, to average out noise."
    if std_m <= goal_m:
        return True, f"{now}: the goal of {1e3 * goal_m:.3f} mm is reached. Enough, more will not help."
    if gain < _LEAST_GAIN and lens_m > 0.7 * std_m:
        return True, f"{now}; most of it is the lens'. Enough, more of the jig will not help: take more for the lens."
    if gain < _LEAST_GAIN:
        return True, f"{now}. Enough, more will not help: a larger, flatter board in the jig would."
    return False, f"{now}; the goal is {1e3 * goal_m:.3f} mm. Take another of the jig as it stands."
