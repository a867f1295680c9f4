"""From all corners to one lens: outliers, the bend of the board, and the lens model are decided together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from .board_flex import BoardFlex, judge_flex
from .bundle import Bundle, free_directions, polished
from .corner_stack import Observation
from .lens_choice import Candidate, assess, choose_lens
from .lens_information import Information, information
from .lens_models import LENS_MODELS, LensModel
from .lens_start import fit_lens, rough_lens, unfolded
from .outliers import Inliers, fit_without_outliers, refined_robustly

SCREENING = ("opencv5", "fisheye", "rational")
"""Lenses rich enough that what they leave over is noise and outliers, tried while the lens is not chosen."""

_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class LensFit:
    """A lens over the good corners, with all that was decided about it.

    Attributes
    ----------
    inliers : the good corners among all observations. bundle : the solution over them, one pose for each good view.
    information : of the corners at that solution; None where they leave the lens open.
    comparison : the lens models that were assessed.
    """

    lens: LensModel
    bundle: Bundle
    inliers: Inliers
    flex: BoardFlex
    comparison: tuple[Candidate, ...]
    information: Information | None


@dataclass(frozen=True, eq=False)
class Screened:
    """The good corners under a first lens, that lens' solution over them, and solutions of others to start from."""

    lens: LensModel
    inliers: Inliers
    bundle: Bundle
    warm: dict[str, Bundle]


def screen(
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    model: str,
    square_pixels: bool,
    min_corners: int,
) -> Screened:
    """The good corners under the lens given, or under the best of `SCREENING` for "auto"; the board may be bent.

    Which lens is best is told by the median corner of a robust fit, which outliers do not move.
    """
    known: dict[str, Bundle] = {}
    robust = {}
    for name in ("opencv4", *SCREENING) if model == "auto" else (model,):
        lens, directions = LENS_MODELS[name], free_directions(LENS_MODELS[name], square_pixels, flex=True)
        known[name] = rough_lens(lens, observations, image_size, square_pixels, known)
        if name in SCREENING or name == model:
            robust[name] = refined_robustly(lens, known[name], observations, directions)
    best = min(robust, key=lambda name: robust[name].sigma_px)
    lens, directions = LENS_MODELS[best], free_directions(LENS_MODELS[best], square_pixels, flex=True)
    inliers, bundle = fit_without_outliers(lens, robust[best], observations, directions, min_corners)
    warm = {name: replace(fit, poses=fit.poses[inliers.views]) for name, fit in (known | robust).items()}
    return Screened(lens, inliers, bundle, warm)


def decide(
    start: Screened,
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    model: str,
    square_pixels: bool,
    min_corners: int,
) -> LensFit:
    """Bend of the board, lens model, and once more the outliers under them, until neither decision changes."""
    lens, inliers, bundle, warm = start.lens, start.inliers, start.bundle, start.warm
    comparison: tuple[Candidate, ...] = ()
    decided, judged = None, None
    for _ in range(_ROUNDS):
        good = inliers.of(observations)
        corners = sum(len(view.pixels) for view in good)
        if judged != (lens.name, corners):
            flex = judge_flex(lens, bundle, good, square_pixels)
            judged = (lens.name, corners)
        if decided == (lens.name, flex.used):
            break
        if model == "auto":
            lens, bundle, comparison = choose_lens(good, image_size, square_pixels, flex.used, warm)
        else:
            bundle = fit_lens(lens, good, image_size, square_pixels, flex.used, {lens.name: bundle})
        decided = (lens.name, flex.used)
        directions = free_directions(lens, square_pixels, flex.used)
        whole = [observations[index] for index in inliers.views]
        within, bundle = fit_without_outliers(lens, bundle, whole, directions, min_corners, inliers.masks)
        inliers = Inliers(inliers.views[within.views], within.masks)
        warm = {name: replace(fit, poses=fit.poses[within.views]) for name, fit in warm.items()}
    good = inliers.of(observations)
    bundle = polished(lens, unfolded(lens, bundle, good, directions, image_size), good, directions)
    known = information(lens, bundle, good, directions)
    if model != "auto" and known is not None:
        comparison = (assess(lens, bundle, good, image_size, directions, known)[0],)
    return LensFit(lens, bundle, inliers, flex, comparison, known)
