"""Which picture of board or jig to take next, and whether another is needed, by the uncertainty in mm on plane C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardWithIds
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.models import pose_slopes, projected
from vbaa_calib.calibrate.pose.board_pose import BoardPose, solve_board_pose
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.detect.board.corners import BoardView

from .settings import GuideSettings
from .suggestion import Suggestion, best_next
from .view_uncertainty import LensInformation, WorkPlane, mean_square, plane_sensitivity


@dataclass(frozen=True, eq=False)
class ViewProgress:
    """Uncertainty on plane C from the pictures so far."""

    std_m: float  # predicted, of points on plane C, rms over the work area; without the jig's own; NaN while unknown
    enough: bool  # whether to go on with the next step
    words: str  # why, or what is missing, and what to do
    solution: LensSolution | None = None  # the lens; None while there are too few pictures
    suggestion: Suggestion | None = None  # the next picture of the board; None where no pose of it can be seen


def lens_progress(
    views: Sequence[BoardView],
    spec: BoardWithIds,
    plane: WorkPlane,
    goal_m: float = GuideSettings.goal_m,
    image_size: tuple[int, int] = (1280, 720),
    solution: LensSolution | None = None,
) -> ViewProgress:
    """Judge the pictures of the board so far and suggest the next one.

    image_size : (width, height) px of pictures to come, while there is no view.
    solution : of just these views, where it is already known.
    """
    size, reason = views[0].image_size if views else image_size, ""
    if solution is None:
        try:
            solution = solve_intrinsics(views, spec, "auto")
        except (InputError, SolveError) as error:
            reason = f"There is no lens yet: {error.what}." if isinstance(error, InputError) else str(error)
    known = None if solution is None else LensInformation.of(solution, views, spec)
    if known is not None and not known.has_rays:
        reason = "The lens found so far gives most of the picture no direction: more pictures are needed."
        known = None
    known = known or LensInformation.nominal(views, spec, size)
    sensitivity = plane_sensitivity(known, plane, spec)
    suggestion = best_next(known, plane, spec, sensitivity)
    if not reason and sensitivity is None:
        reason = "Plane C is hardly in the picture as it was described: give its distance and inclination again."
    if reason or sensitivity is None:
        return ViewProgress(np.nan, False, reason, solution, suggestion)
    noise_m = known.inflation * float(np.sqrt(mean_square(sensitivity, known.information)))
    # a lens model that is too simple shows by how far a richer one would move the plane
    bias_m = known.inflation * float(np.sqrt(known.bias_square(sensitivity)))
    judged = _lens_judged(known, noise_m, bias_m, goal_m, suggestion)
    return ViewProgress(max(noise_m, bias_m), *judged, solution, suggestion)


def _lens_judged(
    known: LensInformation, noise_m: float, bias_m: float, goal_m: float, suggestion: Suggestion | None
) -> tuple[bool, str]:
    """Whether the pictures suffice, and why, in words. noise_m : standard deviation due to noise. bias_m :
    displacement by a richer lens model."""
    std_m, goal = max(noise_m, bias_m), f"the goal of {1e3 * goal_m:.3f} mm"
    now = f"The lens adds {1e3 * std_m:.3f} mm (one standard deviation) where the antenna moves"
    if known.pictures < GuideSettings.fewest_views:
        missing = GuideSettings.fewest_views - known.pictures
        more = "One more picture is" if missing == 1 else f"{missing} more pictures are"
        return False, f"{more} needed before outliers can be found."
    if known.doubt:
        return False, f"{now}, but {known.doubt}."
    if std_m <= goal_m:
        return True, f"{now}: {goal} is reached. Enough, more will not help."
    if bias_m > noise_m and suggestion is not None:
        return False, (
            f"{now}, for a richer lens would move them as far; the goal is {1e3 * goal_m:.3f} mm, and the next picture "
            "helps to find which lens is right."
        )
    gain = 0.0 if suggestion is None else 1.0 - suggestion.std_m / noise_m
    if gain < GuideSettings.least_view_gain:
        return True, (
            f"{now}, not {goal}, but the best next picture would take off {100 * gain:.0f} % only. Enough, more will "
            "not help: a larger or nearer board, sharper pictures or a camera with more pixels would."
        )
    return False, f"{now}; the goal is {1e3 * goal_m:.3f} mm, the next picture takes off about {100 * gain:.0f} %."


def plane_progress(views: Sequence[BoardView], shape: BoardShape, camera: Camera, plane: WorkPlane) -> ViewProgress:
    """Judge the pictures of the board in the jig, at rest in all of them. shape : of the board, from the lens
    solution. camera : with its covariance. plane : in this camera."""
    try:
        board = solve_board_pose(views, shape, camera)
    except (InputError, SolveError) as error:
        what = error.what if isinstance(error, InputError) else str(error)
        remedy = f": {error.remedy}" if isinstance(error, InputError) and error.remedy else ""
        return ViewProgress(np.nan, False, f"{what}{remedy}.")
    if camera.covariance is None:
        words = "The lens has no covariance, and plane C no uncertainty: calibrate it with vbaa intrinsics."
        return ViewProgress(np.nan, False, words)
    lens_m, board_m = _shares_m(board, camera, camera.covariance, plane)
    std_m = float(np.hypot(lens_m, board_m))
    gain = 1.0 - float(np.hypot(lens_m, board_m * np.sqrt(1.0 - _next_share(views, board)))) / std_m
    now = f"Points on plane C are known to {1e3 * std_m:.3f} mm (one standard deviation, lens and jig together)"
    goal = f"{1e3 * GuideSettings.goal_m:.3f} mm"
    enough, words = False, f"{now}; the goal is {goal}. Take another of the jig without moving it."
    if not np.isfinite(std_m):
        words = "Plane C is hardly in the picture: turn the camera to where the antenna moves."
    elif board.is_ambiguous:
        words = f"{now}, but two poses of the board explain the picture: tilt camera and board to each other."
    elif len(views) < GuideSettings.fewest_of_jig:
        missing = GuideSettings.fewest_of_jig - len(views)
        words = f"{now}; {missing} more of the jig without moving it, to average out noise."
    elif std_m <= GuideSettings.goal_m:
        enough, words = True, f"{now}: the goal of {goal} is reached. Enough, more will not help."
    elif gain < GuideSettings.least_view_gain:
        lens = f"{now}; most of it is the lens'. Enough, more of the jig will not help: take more for the lens."
        jig = f"{now}. Enough, more will not help: a larger, flatter board in the jig would."
        enough, words = True, lens if lens_m > 0.7 * std_m else jig
    return ViewProgress(std_m, enough, words)


def _shares_m(board: BoardPose, camera: Camera, covariance: np.ndarray, plane: WorkPlane) -> tuple[float, float]:
    """Standard deviations of points on the plane due to the lens and due to the board's pose; NaN where too few
    points are in view."""
    space = plane.T_camera_plane @ np.pad(plane.points, ((0, 0), (0, 1)))
    pixels, valid = camera.project(space)
    inside = valid & camera.in_picture(pixels)
    if inside.mean() < 0.5:
        return np.nan, np.nan
    _, by_point, by_lens = projected(camera, space[inside])
    by_board = pose_slopes(by_point, space[inside] - board.T_camera_board.translation_m)
    in_plane = by_point @ plane.T_camera_plane.rotation[:, :2]

    def rms(in_pixels: np.ndarray, covariance: np.ndarray) -> float:
        jacobian = np.linalg.solve(in_plane, in_pixels)
        carried = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
        return float(np.sqrt(np.trace(carried, axis1=-2, axis2=-1).mean()))

    return rms(by_lens + by_board @ board.lens_sensitivity, covariance), rms(by_board, board.covariance)


def _next_share(views: Sequence[BoardView], board: BoardPose) -> float:
    """Fraction by which one more picture lowers the variance of the board's pose: only the noise that differs between
    pictures averages out."""
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
