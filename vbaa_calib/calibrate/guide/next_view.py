"""Which picture of the board to take next for the lens, and whether another one helps: counted in mm on plane C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.detect.board.corners import BoardView

from .jig_views import PlaneProgress, plane_progress
from .suggestion import Suggestion, best_next, closeness
from .view_uncertainty import (
    Taken,
    WorkPlane,
    before_a_lens,
    has_rays,
    mean_square,
    plane_functional,
    pulled_square,
    with_a_lens,
)

LEAST_VIEWS = 8
"""Pictures that a lens rests on before it is enough: fewer show no outlier, and no halves to compare."""

LEAST_GAIN = 0.025
"""A picture that takes less than this share off the deviation is not worth taking."""

__all__ = [
    "LEAST_GAIN",
    "LEAST_VIEWS",
    "LensProgress",
    "PlaneProgress",
    "Suggestion",
    "WorkPlane",
    "closeness",
    "lens_progress",
    "plane_progress",
]


@dataclass(frozen=True, eq=False)
class LensProgress:
    """What the pictures of the board are worth so far.

    Attributes
    ----------
    solution : the lens; None while there are too few pictures for one.
    std_m : predicted deviation of points on plane C, rms over the part that is used, with the camera's pose found again
        in the jig with this lens, the board in the jig seen exactly (`plane_progress` adds what its pictures are
        worth). NaN while there is no lens, or where plane C is not in the picture.
    goal_m : what it should be.
    suggestion : the picture to take next; None where no pose of the board can be seen.
    enough : whether to go on with the next step. words : why, or what is missing.
    """

    solution: LensSolution | None
    std_m: float
    goal_m: float
    suggestion: Suggestion | None
    enough: bool
    words: str


def lens_progress(
    views: Sequence[BoardView],
    spec: BoardSpec,
    plane: WorkPlane,
    goal_m: float = 1e-4,
    model: str = "auto",
    image_size: tuple[int, int] = (1280, 720),
    solution: LensSolution | None = None,
) -> LensProgress:
    """Judge the pictures taken so far and choose the next.

    image_size : (width, height) px of pictures to come, while there is no view.
    solution : of just these views, where it is already known; else it is solved for with `model`.
    """
    size = views[0].image_size if views else image_size
    reason = ""
    if solution is None:
        solution, reason = _solved(views, spec, model)
    taken = before_a_lens(views, spec, size) if solution is None else with_a_lens(solution, views, spec)
    if solution is not None and not has_rays(taken.design):
        words = "The lens found so far gives most of the picture no direction: more pictures are needed."
        nominal = before_a_lens(views, spec, size)
        suggestion = best_next(nominal, plane, spec, plane_functional(nominal.design, plane, spec))
        return LensProgress(solution, np.nan, goal_m, suggestion, False, words)
    functional = plane_functional(taken.design, plane, spec)
    suggestion = best_next(taken, plane, spec, functional)
    if solution is None:
        return LensProgress(None, np.nan, goal_m, suggestion, False, reason)
    if functional is None:
        words = "Plane C is hardly in the picture as it was described: give its distance and inclination again."
        return LensProgress(solution, np.nan, goal_m, suggestion, False, words)
    noise_m = taken.inflation * float(np.sqrt(mean_square(functional, taken.information)))
    # a lens that is too simple for its pictures shows by how far a richer one would move the plane
    moved_m = taken.inflation * float(np.sqrt(pulled_square(functional, taken.information, taken.pull)))
    enough, words = _judged(taken, noise_m, moved_m, goal_m, suggestion)
    return LensProgress(solution, max(noise_m, moved_m), goal_m, suggestion, enough, words)


def _solved(views: Sequence[BoardView], spec: BoardSpec, model: str) -> tuple[LensSolution | None, str]:
    try:
        return solve_intrinsics(views, spec, model), ""
    except (InputError, SolveError) as error:
        return None, f"There is no lens yet: {error.what}." if isinstance(error, InputError) else str(error)


def _judged(
    taken: Taken, noise_m: float, moved_m: float, goal_m: float, suggestion: Suggestion | None
) -> tuple[bool, str]:
    """Whether it is enough, and why. noise_m : deviation by noise. moved_m : what a richer lens would move."""
    std_m = max(noise_m, moved_m)
    now = f"Points on plane C are known to {1e3 * std_m:.3f} mm (one standard deviation)"
    if taken.pictures < LEAST_VIEWS:
        missing = LEAST_VIEWS - taken.pictures
        more = "one more picture is" if missing == 1 else f"{missing} more pictures are"
        return False, f"{now}; {more} needed before outliers can be told."
    if taken.doubt:
        return False, f"{now}, but {taken.doubt}."
    if std_m <= goal_m:
        return True, f"{now}: the goal of {1e3 * goal_m:.3f} mm is reached. Enough, more will not help."
    if moved_m > noise_m and suggestion is not None:
        return False, (
            f"{now}, for a richer lens would move them as far; the goal is {1e3 * goal_m:.3f} mm, and the next picture "
            "helps to tell which lens is right."
        )
    gain = 0.0 if suggestion is None else 1.0 - suggestion.std_m / noise_m
    if gain < LEAST_GAIN:
        return True, (
            f"{now}, not the goal of {1e3 * goal_m:.3f} mm, but the best next picture would take off "
            f"{100 * gain:.0f} % only. Enough, more will not help: a larger or nearer board, sharper pictures or a "
            "camera with more pixels would."
        )
    return False, f"{now}; the goal is {1e3 * goal_m:.3f} mm, the next picture takes off about {100 * gain:.0f} %."
