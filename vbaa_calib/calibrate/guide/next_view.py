"""Which picture of board or jig to take next, and whether another one helps, in mm on plane C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec
from vbaa_calib.calibrate.guide.suggestion import Suggestion, best_next
from vbaa_calib.calibrate.guide.view_uncertainty import (
    LensInformation,
    WorkPlane,
    bias_square,
    has_rays,
    mean_square,
    plane_sensitivity,
)
from vbaa_calib.calibrate.lens.information import Bend
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.models import PROJECTIONS
from vbaa_calib.calibrate.pose.board_pose import BoardPose, solve_board_pose
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.detect.board.corners import BoardView

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
    return PlaneProgress(std_m, *_jig_judged(board, len(views), std_m, lens_m, goal_m, gain))


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


def _jig_judged(
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


_LEAST_VIEWS = 8
"""Pictures that a lens rests on before it is enough: fewer show no outlier, and no halves to compare."""


@dataclass(frozen=True, eq=False)
class LensProgress:
    """Uncertainty on plane C by the pictures of the board so far.

    solution : the lens; None while there are too few pictures for one.
    std_m : predicted deviation of points on plane C, rms over the work area, with the camera's pose solved for from the
        jig with this lens, the board in the jig being seen exactly (`plane_progress` adds the share of its pictures).
        NaN while there is no lens, or where plane C is not in the picture.
    suggestion : the picture to take next; None where no pose of the board can be seen.
    enough : whether to go on with the next step. words : why, or what is missing.
    """

    solution: LensSolution | None
    std_m: float
    suggestion: Suggestion | None
    enough: bool
    words: str


def lens_progress(
    views: Sequence[BoardView],
    spec: BoardSpec,
    plane: WorkPlane,
    goal_m: float = 1e-4,
    image_size: tuple[int, int] = (1280, 720),
    solution: LensSolution | None = None,
) -> LensProgress:
    """Judge the pictures so far and choose the next.

    image_size : (width, height) px of pictures to come, while there is no view.
    solution : of just these views, where it is already known.
    """
    size = views[0].image_size if views else image_size
    reason = ""
    if solution is None:
        try:
            solution = solve_intrinsics(views, spec, "auto")
        except (InputError, SolveError) as error:
            reason = f"There is no lens yet: {error.what}." if isinstance(error, InputError) else str(error)
    known = (
        LensInformation.nominal(views, spec, size) if solution is None else LensInformation.of(solution, views, spec)
    )
    if solution is not None and not has_rays(known.design):
        reason = "The lens found so far gives most of the picture no direction: more pictures are needed."
        known = LensInformation.nominal(views, spec, size)
    sensitivity = plane_sensitivity(known.design, plane, spec)
    suggestion = best_next(known, plane, spec, sensitivity)
    if not reason and sensitivity is None:
        reason = "Plane C is hardly in the picture as it was described: give its distance and inclination again."
    if reason or sensitivity is None:
        return LensProgress(solution, np.nan, suggestion, False, reason)
    noise_m = known.inflation * float(np.sqrt(mean_square(sensitivity, known.information)))
    # a lens model that is too simple shows by how far a richer one would move the plane
    bias_m = known.inflation * float(np.sqrt(bias_square(sensitivity, known.information, known.gradient)))
    return LensProgress(
        solution, max(noise_m, bias_m), suggestion, *_judged(known, noise_m, bias_m, goal_m, suggestion)
    )


def _judged(
    known: LensInformation, noise_m: float, bias_m: float, goal_m: float, suggestion: Suggestion | None
) -> tuple[bool, str]:
    """Whether it is enough, and why. noise_m : deviation by noise. bias_m : by what a richer lens would move."""
    std_m = max(noise_m, bias_m)
    now = f"Points on plane C are known to {1e3 * std_m:.3f} mm (one standard deviation)"
    if known.pictures < _LEAST_VIEWS:
        missing = _LEAST_VIEWS - known.pictures
        more = "one more picture is" if missing == 1 else f"{missing} more pictures are"
        return False, f"{now}; {more} needed before outliers can be found."
    if known.doubt:
        return False, f"{now}, but {known.doubt}."
    if std_m <= goal_m:
        return True, f"{now}: the goal of {1e3 * goal_m:.3f} mm is reached. Enough, more will not help."
    if bias_m > noise_m and suggestion is not None:
        return False, (
            f"{now}, for a richer lens would move them as far; the goal is {1e3 * goal_m:.3f} mm, and the next picture "
            "helps to find which lens is right."
        )
    gain = 0.0 if suggestion is None else 1.0 - suggestion.std_m / noise_m
    if gain < _LEAST_GAIN:
        return True, (
            f"{now}, not the goal of {1e3 * goal_m:.3f} mm, but the best next picture would take off "
            f"{100 * gain:.0f} % only. Enough, more will not help: a larger or nearer board, sharper pictures or a "
            "camera with more pixels would."
        )
    return False, f"{now}; the goal is {1e3 * goal_m:.3f} mm, the next picture takes off about {100 * gain:.0f} %."
