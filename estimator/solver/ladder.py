"""From frames to solutions: which minimum, which rung of the ladder, and what else would explain the frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import Array, arange_like, namespace, true_indices

from .alternative_minima import BestFits, different, mirror_ambiguous, mirror_starts
from .convergence import coarse_minima, converge, polish
from .frames import Frames
from .initialization import FreeAntenna, GridSearch, free_antenna, grid_search
from .prediction import FRICTION_RUNGS, LINEAR, predict
from .rows import select
from .second_contact import second_force
from .state import Fits
from .uncertainty import (
    REFERENCE,
    Uncertainty,
    contact_evidence,
    model_errors,
    predicted_bias,
    problem_on,
    uncertainty,
    widened_by_profile,
)

COARSE_RUNG = LINEAR
"""The rung on which minima are compared before a rung is chosen."""
SMALL_BIAS = 1 / 3
"""A rung's predicted bias is small below this fraction of the standard deviation."""
LARGE_BIAS = SMALL_BIAS
"""A demanded rung's larger bias is added to the deviations."""
_USUAL = "elastica"
"""The rung that most frames need: `auto` begins with it."""
_STARTS, _COARSE_POINTS = 2, 64
"""Minima that are searched for each frame, with about so many of its points."""
_WIDE_STEP, _WIDE_ITERATIONS = 4, 15
"""Lost frames are searched from every fourth distance of the grid, with so many iterations each."""
_LOST_SCATTER, _LOST_FRICTION = 2.0, 2.5
"""A larger scatter, or a friction angle of more deviations, is a reason to search elsewhere."""
_FAINT = 5.0
"""Below this gain over the free antenna a frame's other minima are not searched: contact takes three times as much."""
_SIGNIFICANT_FORCE = 3.0
"""Without a force of so many deviations in any direction there is no contact whose mirror image would matter."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Converged frames on one rung, with their uncertainty and alternatives.

    Attributes
    ----------
    rows : (B,) their places among all frames.
    evidence : (B,) for a contact, see `uncertainty.contact_evidence`.
    bias : rung → (B,) its predicted bias in standard deviations, of the rungs that were evaluated.
    alternative_cost : (B,) how much more another minimum costs, infinite without one. alternative_unknowns : (B, 4).
    ambiguous : (B,) bool, see `alternative_minima.mirror_ambiguous`.
    second_gain, second_place, second_shift : (B,) see `second_contact.second_force`.
    model_errors : (B, 2, 10) see `uncertainty.model_errors`; 0 where the rung's bias is small.
    """

    rows: Array
    fits: Fits
    uncertainty: Uncertainty
    free: FreeAntenna
    evidence: Array
    bias: dict[str, Array]
    alternative_cost: Array
    alternative_unknowns: Array
    ambiguous: Array
    second_gain: Array
    second_place: Array
    second_shift: Array
    model_errors: Array


@dataclass(frozen=True, eq=False)
class Starts:
    """What is known of B frames before a rung is chosen.

    Attributes
    ----------
    minima, costs : (B, S, 4) rough minima, lowest first, and their costs (B, S), infinite where there is none.
    """

    free: FreeAntenna
    grid: GridSearch
    minima: Array
    costs: Array


def find_starts(frames: Frames, warm: Array | None = None, always: bool = False) -> Starts:
    """The rough minima of each frame. `warm` (B, 4), unknowns near the truth where finite, may take their place.

    Frames with several descend on a low rung, to see which of them are useful; with `always`, all do.
    """
    xp = namespace(frames.points)
    free = free_antenna(frames, REFERENCE)
    few, kept = frames.subsample(_COARSE_POINTS)
    points = free.points.subsample(kept)
    grid = grid_search(few, free, points)
    minima, costs = grid.lowest(_STARTS)
    if warm is not None:
        minima, costs = grid.warm_started(minima, costs, warm)
    several = true_indices(xp.isfinite(costs[:, -1]) | always)
    if len(several):
        part = select(few, several), COARSE_RUNG, minima[several], costs[several], points.foot_m[several]
        minima[several], costs[several] = coarse_minima(*part)
    return Starts(free, grid, minima, costs)


def solve(frames: Frames, model: str, warm: Array | None = None) -> list[Solution]:
    """Fit B frames; frames on the same rung come together. `warm` as in `find_starts`."""
    xp = namespace(frames.points)
    starts, every = find_starts(frames, warm), arange_like(frames.points, len(frames))
    if model != "auto":
        return [_solve_on_rung(frames, starts, model, every, (model,))]
    first = _solve_on_rung(frames, starts, _USUAL, every, RUNGS)
    bias, level = first.bias, xp.zeros_like(starts.costs[:, 0])
    for index, rung in enumerate(RUNGS[:-1]):
        level = xp.where((level == index) & ~(bias[rung] <= SMALL_BIAS), level + 1.0, level)
    minima = xp.stack([first.fits.state.unknowns, first.alternative_unknowns], 1)
    costs = xp.stack([xp.zeros_like(first.alternative_cost), first.alternative_cost], -1)
    starts = replace(starts, minima=minima, costs=costs)
    found = []
    for index, rung in enumerate(RUNGS):
        rows = true_indices(level == index)
        if rung == _USUAL and len(rows):
            found.append(first if len(rows) == len(frames) else select(first, rows))
        elif len(rows):
            found += _climb(frames, starts, rung, rows, bias)
    return found


def _climb(frames: Frames, starts: Starts, rung: str, rows: Array, bias: dict[str, Array]) -> list[Solution]:
    """Some frames on their rung, those for which it proves too low on a higher one."""
    first = _solve_on_rung(frames, starts, rung, rows, (rung,), {each: bias[each][rows] for each in bias})
    low = ~(first.bias[rung] <= SMALL_BIAS)
    if rung == REFERENCE or not bool(low.any()):
        return [first]
    updated = bias[rung] + 0.0
    updated[rows[low]] = first.bias[rung][low]
    higher = _climb(frames, starts, RUNGS[RUNGS.index(rung) + 1], rows[low], bias | {rung: updated})
    return higher if bool(low.all()) else [select(first, ~low), *higher]


def _solve_on_rung(
    frames: Frames,
    starts: Starts,
    rung: str,
    rows: Array,
    biased: tuple[str, ...],
    bias: Mapping[str, Array] = MappingProxyType({}),
) -> Solution:
    """These rows of the frames converged on a rung, at the best of their minima.

    `biased` are the rungs whose bias is to be predicted, `bias` what is known of it already.
    """
    xp = namespace(rows)
    if len(rows) < len(frames):
        frames, starts = select(frames, rows), select(starts, rows)
    distinct = xp.amax(starts.grid.gains, -1) > _FAINT
    best = BestFits.only(converge(frames, rung, starts.minima[:, 0], starts.free.points.foot_m))
    for other in range(1, starts.minima.shape[1]):
        best = best.try_starts(xp.isfinite(starts.costs[:, other]) & distinct, starts.minima[:, other])
    best = _search_lost(frames, rung, starts, best, distinct)
    best = replace(best, fits=polish(best.fits))
    found = uncertainty(best.fits)
    unknowns = best.fits.state.unknowns
    ambiguous = _significant(unknowns, found) & mirror_ambiguous(frames, unknowns, best.fits.by_rig)
    if bool(ambiguous.any()):
        best = best.try_starts(ambiguous, *mirror_starts(frames, unknowns))
        # what turned out better has a mirror image of its own
        turned = ambiguous & different(unknowns, best.fits.state.unknowns)
        best = best.try_starts(turned, *mirror_starts(frames, best.fits.state.unknowns))
        found = widened_by_profile(best.fits, uncertainty(best.fits), ambiguous)
    fits = best.fits
    problem, bias = fits.problem, dict(bias)
    values = xp.concat([fits.state.unknowns, fits.prediction.point_force], -1)
    errors = xp.stack([xp.zeros_like(values)] * 2, 1)
    if rung != REFERENCE:
        reference = predict(frames, REFERENCE, fits.state.unknowns, derivatives=False)
        problem = problem_on(fits, reference)
        bias |= predicted_bias(fits, found, reference, biased)
        large = (bias[rung] > LARGE_BIAS) & xp.isfinite(bias[rung])
        if bool(large.any()):
            errors = xp.where(large[:, None, None], model_errors(fits, reference), errors)
    evidence = contact_evidence(fits, problem, starts.free)
    others = best.extra_cost, best.other_unknowns, ambiguous, *second_force(fits, problem, found), errors
    return Solution(rows, fits, found, starts.free, evidence, bias, *others)


def _significant(unknowns: Array, found: Uncertainty) -> Array:
    """(B,) whether the force stands out of its uncertainty in some direction across the antenna."""
    first, second = unknowns[:, 1], unknowns[:, 2]
    own, cross, other = found.covariance[:, 1, 1], found.covariance[:, 1, 2], found.covariance[:, 2, 2]
    apart = other * first**2 - 2.0 * cross * first * second + own * second**2
    return apart > _SIGNIFICANT_FORCE**2 * (own * other - cross**2)


def _search_lost(frames: Frames, rung: str, starts: Starts, best: BestFits, distinct: Array) -> BestFits:
    """Lost frames searched again: with new feet, then from all over the antenna."""
    again = best.try_starts(_lost(best) & distinct, best.fits.state.unknowns)
    lost = _lost(again) & distinct
    if not bool(lost.any()):
        return again
    unknowns, costs = select(starts.grid, lost).every(_WIDE_STEP)
    coarse = rung if rung in FRICTION_RUNGS else FRICTION_RUNGS[0]
    minima = starts.minima[:, 0] + 0.0
    minima[lost] = coarse_minima(select(frames, lost), coarse, unknowns, costs, iterations=_WIDE_ITERATIONS)[0][:, 0]
    return again.try_starts(lost, minima)


def _lost(best: BestFits) -> Array:
    state = best.fits.state
    return ~state.converged | (state.scatter > _LOST_SCATTER) | (abs(state.unknowns[:, 3]) > _LOST_FRICTION)
