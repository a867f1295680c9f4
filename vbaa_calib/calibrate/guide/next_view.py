"""Which picture of the board to take next for the lens, and whether another one helps, in mm on plane C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.detect.board.corners import BoardView

from .suggestion import Suggestion, best_next
from .view_uncertainty import LensInformation, WorkPlane, bias_square, has_rays, mean_square, plane_sensitivity

_LEAST_VIEWS = 8
"""Pictures that a lens rests on before it is enough: fewer show no outlier, and no halves to compare."""
_LEAST_GAIN = 0.025
"""A picture that lowers the deviation by less than this part is not needed."""


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
