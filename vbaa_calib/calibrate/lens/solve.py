"""From all corners to one lens: outliers, the bend of the board, and the lens model are decided together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .board_flex import BoardFlex, judge_flex
from .bundle import CONVERGED, FLEX, Bundle, Observation, polished, refine
from .information import Information, information
from .initialization import LensOptions, fit_lens, rough_lens, unfolded
from .models import LENS_MODELS, is_monotonic
from .outliers import Inliers, fit_without_outliers
from .validation import AGREE, compare_split_half, excess_in_errors, held_out_squares, rms_over

_CANDIDATES = ("none", "radial", "opencv4", "opencv5", "fisheye", "rational")
"""What `auto` compares, from simple to rich. Thin-prism and tilted lenses are compared only when named."""

_CENTRED, _DECENTRED = ("none", "radial"), "opencv4"
_EXCESS, _SMALL_EXCESS = 1.0, 2.0
_NEGLIGIBLE, _SMALL = 1.002, 1.05
_AGREEMENT_MAY_COST = 1.005
_CLEARLY = 1.01
_MONOTONIC_MAY_COST = 1.1


@dataclass(frozen=True, eq=False)
class Candidate:
    """How one lens model does.

    free_parameters : of the lens, focal lengths and principal point included.
    rms_px : over the corners it was fitted to. held_out_rms_px : over views that only had their poses fitted.
    monotonic : whether it maps the whole picture without folding.
    halves, halves_p_value : as `compare_split_half` gives them.
    """

    model: str
    free_parameters: int
    rms_px: float
    held_out_rms_px: float
    monotonic: bool
    halves: float | None = None
    halves_p_value: float | None = None

    @property
    def split_half_agrees(self) -> bool:
        """Whether the halves differ no more than predicted, or cannot be compared."""
        return self.halves_p_value is None or self.halves_p_value >= AGREE


def _assess(
    bundle: Bundle, observations: Sequence[Observation], image_size: tuple[int, int], known: Information
) -> tuple[Candidate, np.ndarray]:
    """One lens model's row of the comparison, and its held-out squared errors (V,) px² by view."""
    squares = held_out_squares(bundle, observations, known)
    halves, chance = compare_split_half(bundle.model, bundle.intrinsics, known, image_size)
    candidate = Candidate(
        model=bundle.model.name,
        free_parameters=int(np.any(bundle.directions[:-FLEX] != 0.0, axis=0).sum()),
        rms_px=bundle.rms_px,
        held_out_rms_px=rms_over(squares, observations),
        monotonic=is_monotonic(bundle.model, bundle.intrinsics, image_size),
        halves=halves,
        halves_p_value=chance,
    )
    return candidate, squares


def _choose_lens(
    observations: Sequence[Observation], options: LensOptions, flex: bool, warm: Mapping[str, Bundle]
) -> tuple[Bundle, tuple[Candidate, ...]]:
    """The solution of the lens model that the views require, and the comparison it rests on.

    Each model is fitted to four fifths of the views and tested on the rest, whose poses alone are solved for. Taken is
    the first in order of complexity whose held-out error is within one standard error (over views) of the best, two
    where that is under 5 %, or within 0.2 %. A lens without decentring must also beat the one with it, by over 1 %.
    Models that fold inside the picture are passed over unless every other is 10 % worse, those whose halves disagree
    unless every other is 0.5 % worse; one that the views leave open is left out.

    warm : solutions by model name for nearly the same corners, to start from.
    """
    fits: dict[str, Bundle] = {}
    errors, candidates = {}, []
    for name in _CANDIDATES:
        bundle = fit_lens(LENS_MODELS[name], observations, options, flex, {**fits, **warm})
        fits[name] = bundle = unfolded(bundle, observations, options.image_size)
        known = information(bundle, observations)
        if known is None:
            continue
        candidate, errors[name] = _assess(bundle, observations, options.image_size, known)
        candidates.append(candidate)
    chosen = _simplest_good(candidates, errors) if candidates else _CANDIDATES[0]
    return fits[chosen], tuple(candidates)


def _simplest_good(candidates: Sequence[Candidate], errors: dict[str, np.ndarray]) -> str:
    allowed = _unless_too_dear(candidates, [c for c in candidates if c.monotonic], _MONOTONIC_MAY_COST)
    allowed = _unless_too_dear(allowed, [c for c in allowed if c.split_half_agrees], _AGREEMENT_MAY_COST)
    rows = {candidate.model: candidate for candidate in allowed}
    best = min(allowed, key=lambda candidate: candidate.held_out_rms_px)
    for candidate in allowed:
        own = errors[candidate.model]
        if candidate.model in _CENTRED and _DECENTRED in rows:
            # every lens is a little off its axis: to deny that takes evidence, and more than chance gives
            worse = rows[_DECENTRED].held_out_rms_px > _CLEARLY * candidate.held_out_rms_px
            if not worse or excess_in_errors(errors[_DECENTRED], own) <= _EXCESS:
                continue
        loss = candidate.held_out_rms_px / best.held_out_rms_px
        tolerated = _SMALL_EXCESS if loss <= _SMALL else _EXCESS
        if loss <= _NEGLIGIBLE or excess_in_errors(own, errors[best.model]) <= tolerated:
            return candidate.model
    return best.model


def _unless_too_dear(
    every: Sequence[Candidate], preferred: Sequence[Candidate], may_cost: float
) -> Sequence[Candidate]:
    least = min(candidate.held_out_rms_px for candidate in every)
    return preferred if any(candidate.held_out_rms_px <= may_cost * least for candidate in preferred) else every


_SCREENING = ("opencv5", "fisheye", "rational")
"""Lenses rich enough that what they leave over is noise and outliers, tried while the lens is not chosen."""

_ROUNDS = 3
_ROUGHLY = replace(CONVERGED, iterations=5, tolerance=1e-4)  # just enough to tell good corners from bad


@dataclass(frozen=True, eq=False)
class LensFit:
    """A lens over the good corners of all observations, one pose for each good view, and what was decided about it.

    comparison : the lens models that were assessed. information : None where the corners leave the lens open.
    """

    bundle: Bundle
    inliers: Inliers
    flex: BoardFlex
    comparison: tuple[Candidate, ...]
    information: Information | None


@dataclass(frozen=True, eq=False)
class _Screened:
    """The good corners under a first lens, that lens' solution over them, and solutions of others to start from."""

    inliers: Inliers
    bundle: Bundle
    warm: dict[str, Bundle]


def screen(observations: Sequence[Observation], options: LensOptions) -> _Screened:
    """The good corners under the lens given, or under the best of `_SCREENING` for "auto"; the board may be bent.

    The best lens is that with the least median error in a robust fit, which outliers do not move.
    """
    known: dict[str, Bundle] = {}
    robust = {}
    for name in ("opencv4", *_SCREENING) if options.model == "auto" else (options.model,):
        known[name] = rough_lens(LENS_MODELS[name], observations, options, known)
        if name in _SCREENING or name == options.model:
            free = known[name].freed(options.square_pixels, flex=True)
            robust[name] = refine(free, observations, _ROUGHLY, robust=True)
    best = min(robust, key=lambda name: robust[name].sigma_px)
    inliers, bundle = fit_without_outliers(robust[best], observations, options.min_corners)
    warm = {name: replace(fit, poses=fit.poses[inliers.views]) for name, fit in (known | robust).items()}
    return _Screened(inliers, bundle, warm)


def decide(start: _Screened, observations: Sequence[Observation], options: LensOptions) -> LensFit:
    """Bend of the board, lens model, and once more the outliers under them, until neither decision changes."""
    inliers, bundle, warm = start.inliers, start.bundle, start.warm
    comparison: tuple[Candidate, ...] = ()
    decided, judged = None, None
    for _ in range(_ROUNDS):
        good, name = inliers.of(observations), bundle.model.name
        corners = sum(len(view.pixels) for view in good)
        if judged != (name, corners):
            flex = judge_flex(bundle, good, options.square_pixels)
            judged = (name, corners)
        if decided == (name, flex.used):
            break
        if options.model == "auto":
            bundle, comparison = _choose_lens(good, options, flex.used, warm)
        else:
            bundle = fit_lens(bundle.model, good, options, flex.used, {name: bundle})
        decided = (bundle.model.name, flex.used)
        whole = [observations[index] for index in inliers.views]
        within, bundle = fit_without_outliers(bundle, whole, options.min_corners, inliers.masks)
        inliers = Inliers(inliers.views[within.views], within.masks)
        warm = {name: replace(fit, poses=fit.poses[within.views]) for name, fit in warm.items()}
    good = inliers.of(observations)
    bundle = polished(unfolded(bundle, good, options.image_size), good)
    known = information(bundle, good)
    if options.model != "auto" and known is not None:
        comparison = (_assess(bundle, good, options.image_size, known)[0],)
    return LensFit(bundle, inliers, flex, comparison, known)
