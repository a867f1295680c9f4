"""From frames to their fits: which minimum, which rung of the ladder, and what else would explain each frame."""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.camera.compiled_lens import Lens
from vbaa_calib.core.compiled import compiled, in_threads, kernel

from .alternative_minima import (
    beyond_reach,
    different,
    largest_error,
    mirror_ambiguous,
    most_distance,
    nearest_shape,
    try_mirrors,
    try_start,
)
from .convergence import (
    COARSE_ITERATIONS,
    MOST_SCATTER,
    WRONG_SHAPE,
    begin_search,
    coarse_minimum,
    converge,
    converge_there,
    empty_work,
    polish,
)
from .fit import CONVERGED, COST, NODES, SCATTER, copy_fit
from .frames import Frames, frame_of, thinned
from .initialization import (
    STARTS,
    free_antenna,
    grid_search,
    largest_gain,
    limit_load,
    lowest_of_grid,
    warm_start,
)
from .linear_algebra import put
from .normal_equations import linearise, points_cost, unscaled_cost
from .numbers import SMALL_BIAS, FitNumbers, NumberRecord, write_numbers
from .prediction import LINEAR, REFERENCE, predict
from .rig_arrays import UNKNOWNS, RigRecord
from .second_contact import second_force
from .uncertainty import (
    contact_evidence,
    empty_uncertainty,
    first_order_errors,
    predicted_bias,
    uncertainty,
    widen_by_profile,
)

_COARSE_POINTS = 64
"""Minima are searched with about so many of a frame's points."""
_LOST_SCATTER, _LOST_FRICTION = 2.0, 2.5
"""A larger scatter, or a friction angle of more deviations, is a reason to search elsewhere."""
_FAINT = 5.0
"""Below this gain over the free antenna neither distance nor other minima are searched: contact takes three times as
much."""
_SIGNIFICANT_FORCE = 3.0
"""Without a force of so many deviations in any direction there is no contact whose mirror image would matter."""
_SAME_MINIMUM = 1e-2
"""Minima whose distances differ by less, in antenna lengths, are taken for the same."""
_HOPELESS, _HOPELESS_FACTOR = 50.0, 4.0
"""A minimum that costs this many times the lowest one, and this much more, is dropped."""
AUTO = -1


def solve(
    frames: Frames, model: str, warm: np.ndarray | None = None, pieces_m: np.ndarray | None = None, jobs: int = 1
) -> FitNumbers:
    """Fit B frames, each by itself, in `jobs` threads.

    warm : (B, 4) unknowns near the truth where finite; pieces_m : (G,) arc lengths of `motion.Beam`, if it is tested.
    """
    found = FitNumbers.unwritten(len(frames))
    rig, lens, tables, numbers = frames.rig_arrays.tables, frames.rig_arrays.lens, frames.tables, found.tables
    exact = frames.rig_arrays.exact.tables
    starts = np.full((len(frames), UNKNOWNS), np.nan) if warm is None else np.ascontiguousarray(warm, float)
    pieces = np.empty(0) if pieces_m is None else np.ascontiguousarray(pieces_m, float)
    rung = AUTO if model == "auto" else RUNGS.index(model)

    def work(begin: int, end: int) -> None:
        _solve_frames(rig, exact, lens, tables, begin, end, rung, starts, pieces, numbers)

    in_threads(work, len(frames), jobs)
    return found


def rough_fits(frames: Frames) -> tuple[np.ndarray, np.ndarray]:
    """(B, 4) unknowns of rough minima on a low rung, and the antennas' nodes there (B, M, 3), antenna frame."""
    found, points_m = np.empty((len(frames), UNKNOWNS)), np.empty((len(frames), NODES, 3))
    _rough_frames(frames.rig_arrays.tables, frames.rig_arrays.lens, frames.tables, found, points_m)
    return found, points_m


@kernel
def _rough_frames(rig_tables, lens_tables, tables, found, points_m):
    rig, lens = RigRecord(*rig_tables), Lens(*lens_tables)
    warm = np.full(UNKNOWNS, np.nan)
    for index in range(len(found)):
        frame = frame_of(tables, index)
        work = empty_work(rig, lens, len(frame.u))
        starts, costs = np.empty((STARTS, UNKNOWNS)), np.empty(STARTS)
        _find_starts(rig, frame, warm, True, starts, costs, work)
        found[index] = starts[0]
        put(starts[0], work.best.unknowns)
        predict(rig, frame, LINEAR, work.bent, work.best, False)
        points_m[index] = work.best.points_m.T


@kernel
def _solve_frames(rig_tables, exact_tables, lens_tables, tables, begin, end, rung, warm, pieces_m, found):
    rig, lens, numbers = RigRecord(*rig_tables), Lens(*lens_tables), NumberRecord(*found)
    exact = RigRecord(*exact_tables)
    work = empty_work(rig, lens, 0)
    for index in range(begin, end):
        frame = frame_of(tables, index)
        if len(frame.u) != len(work.best.foot_m):
            work = empty_work(rig, lens, len(frame.u))
        work.evaluations[0] = work.most[0] = 0
        begin_search(work)
        _solve_frame(rig, exact, frame, rung, warm[index], pieces_m, numbers, index, work)


@compiled
def _solve_frame(rig, exact, frame, model, warm, pieces_m, numbers, index, work):
    """One frame on a rung, by default on the highest: then also which one would have been good enough."""
    best, found = work.best, empty_uncertainty(len(work.best.steps))
    starts, costs = np.empty((STARTS, UNKNOWNS)), np.empty(STARTS)
    grid = _find_starts(rig, frame, warm, False, starts, costs, work)
    other, other_cost = np.empty(UNKNOWNS), np.empty(1)
    rung = REFERENCE if model == AUTO else model
    left = _left(rig, exact, frame, grid, starts[0].copy(), other, work)
    given_up, ambiguous = np.isfinite(left), False
    if given_up:
        put(other, best.unknowns)
        other_cost[0] = np.inf
        coarse_minimum(rig, frame, rung, best, work, False, MOST_SCATTER, 0)
        uncertainty(best, found, work)
    else:
        ambiguous = _fit_on_rung(rig, exact, frame, rung, grid, starts, costs, found, other, other_cost, work)
    problem = best
    if rung != REFERENCE:
        # residuals of the highest rung, whose shapes are right
        problem = work.found
        copy_fit(best, problem)
        predict(rig, frame, REFERENCE, work.bent, problem, False)
        linearise(rig, frame, problem, work)
        points_cost(problem)
    errors, bias = np.zeros((5, 10)), np.full(REFERENCE + 1, np.nan)
    needed = rung
    if model != REFERENCE:
        first_order_errors(rig, frame, rung, best, problem, errors, work)
        every_bias = np.empty(REFERENCE + 1)
        predicted_bias(errors, found, every_bias)
        if model == AUTO:
            put(every_bias, bias)
            needed = 0
            while needed < REFERENCE and not bias[needed] <= SMALL_BIAS:
                needed += 1
        else:
            bias[rung] = every_bias[rung]
    std = np.sqrt(found.covariance[0, 0])
    gain, place, shift, evidence = 0.0, 0.0, 0.0, np.nan
    if not given_up:
        gain, place, shift = second_force(rig, frame, rung, best, problem, std, work)
        evidence = contact_evidence(rig, rung, best, problem, work)
    extra = other_cost[0] - unscaled_cost(rig, best)
    scalars = np.array([evidence, extra, gain, place, shift])
    write_numbers(rig, frame, rung, found, bias, errors, other, scalars, ambiguous, pieces_m, numbers, index, work)
    numbers.rung[index], numbers.left_px[index] = needed, rig.focal * left
    if given_up:
        numbers.tip_std[index] = np.nan


@compiled
def _left(rig, exact, frame, grid, start, nearest, work):
    """Of a frame that no contact comes near to, how far many points stay from the nearest antenna, whose unknowns (4,)
    are left in `nearest`; else NaN."""
    put(start, nearest)
    few, every = thinned(frame, _COARSE_POINTS)
    far, scatter = largest_error(rig, work.free, every)
    left = beyond_reach(rig, few)
    if not left > far:
        left = most_distance(rig, frame, work.free, every, work.shift)
        if left > far:
            left = nearest_shape(exact, work.bent.lens, few, grid, start, far, scatter, nearest)
    return left if left > far else np.nan


@compiled
def _find_starts(rig, frame, warm, always, starts, costs, work):
    """Rough minima (S, 4), lowest first, and their costs (S,), infinite where there is none; and the free antenna.

    `warm` (4,), unknowns near the truth where finite, may take their place. A frame with several descends on a low rung
    to see which of them are useful; with `always`, each does.
    """
    free = work.free
    free_antenna(rig, frame, free, work)
    few, every = thinned(frame, _COARSE_POINTS)
    grid = grid_search(rig, frame, free, every, work)
    lowest_of_grid(rig, grid, starts, costs)
    distinct = always or largest_gain(grid) > _FAINT
    if distinct:
        warm_start(grid, warm, starts, costs)
    if distinct and (always or np.isfinite(costs[-1])):
        feet = free.foot_m[::every].copy()
        _coarse_minima(rig, work.bent.lens, few, feet, starts, costs)
        for k in range(0 if always else STARTS):
            limit_load(rig, starts[k])
    return grid


@compiled
def _coarse_minima(rig, lens, frame, feet_m, starts, costs):
    """Replace starts (S, 4) by the rough minima that they lead to on a low rung, lowest first, and their costs.

    feet_m : (N,) near the right ones. Starts of infinite cost, minima that another start reached too, and
    hopeless ones come out with infinite cost.
    """
    count = len(costs)
    work = empty_work(rig, lens, len(frame.u))
    fit = work.best
    for k in range(count):
        if not (np.isfinite(costs[k]) and np.isfinite(starts[k]).all()):
            costs[k] = np.inf
            continue
        put(starts[k], fit.unknowns)
        put(feet_m, fit.foot_m)
        coarse_minimum(rig, frame, LINEAR, fit, work, True, 1.0, COARSE_ITERATIONS)
        starts[k] = fit.unknowns
        costs[k] = fit.numbers[COST] if fit.numbers[COST] == fit.numbers[COST] else np.inf
    for a in range(count - 1):
        for b in range(a + 1, count):
            if costs[b] < costs[a]:
                costs[a], costs[b] = costs[b], costs[a]
                for k in range(UNKNOWNS):
                    starts[a, k], starts[b, k] = starts[b, k], starts[a, k]
    for k in range(1, count):
        apart = abs(starts[k, 0] - starts[0, 0]) > _SAME_MINIMUM
        if not (apart and costs[k] < _HOPELESS_FACTOR * costs[0] + _HOPELESS):
            costs[k] = np.inf


@compiled
def _fit_on_rung(rig, exact, frame, rung, grid, starts, costs, found, other, other_cost, work):
    """The best of a frame's minima on a rung and its uncertainty. Returns whether its mirror image looks like it."""
    best, distinct = work.best, largest_gain(grid) > _FAINT
    put(starts[0], best.unknowns)
    put(work.free.foot_m, best.foot_m)
    if distinct or not converge_there(rig, frame, rung, best, work):
        converge(rig, frame, rung, best, work, True)
    put(best.unknowns, other)
    other_cost[0] = np.inf
    if distinct:
        for k in range(1, STARTS):
            if np.isfinite(costs[k]):
                try_start(rig, frame, rung, starts[k].copy(), best, other, other_cost, work)
        _search_lost(rig, exact, frame, rung, grid, best, other, other_cost, work)
        polish(rig, frame, rung, best, work)
    uncertainty(best, found, work)
    ambiguous = _significant(best.unknowns, found.covariance) and mirror_ambiguous(rig, frame, best)
    explained = best.numbers[CONVERGED] > 0.0 and best.numbers[SCATTER] <= WRONG_SHAPE
    if ambiguous and explained:
        before = best.unknowns.copy()
        try_mirrors(rig, frame, rung, before, best, other, other_cost, work)
        if different(before, best.unknowns):
            # what turned out better has a mirror image of its own
            try_mirrors(rig, frame, rung, best.unknowns.copy(), best, other, other_cost, work)
        uncertainty(best, found, work)
        widen_by_profile(rig, frame, rung, best, found, work)
    return ambiguous


@compiled
def _significant(unknowns, covariance):
    """Whether the force stands out of its uncertainty in some direction across the antenna."""
    first, second = unknowns[1], unknowns[2]
    own, cross, opposite = covariance[1, 1], covariance[1, 2], covariance[2, 2]
    apart = opposite * first * first - 2.0 * cross * first * second + own * second * second
    return apart > _SIGNIFICANT_FORCE**2 * (own * opposite - cross * cross)


@compiled
def _search_lost(rig, exact, frame, rung, grid, best, other, other_cost, work):
    """Search a lost frame again: with new feet, and from the picture alone on the exact rig."""
    if not _lost(best):
        return
    try_start(rig, frame, rung, best.unknowns.copy(), best, other, other_cost, work)
    if not _lost(best):
        return
    begin_search(work)
    start = np.empty(UNKNOWNS)
    few, every = thinned(frame, _COARSE_POINTS)
    _, scatter = largest_error(rig, work.free, every)
    nearest_shape(exact, work.bent.lens, few, grid, best.unknowns.copy(), 0.0, scatter, start)
    try_start(rig, frame, rung, start, best, other, other_cost, work)


@compiled
def _lost(fit):
    steep = abs(fit.unknowns[UNKNOWNS - 1]) > _LOST_FRICTION
    return not fit.numbers[CONVERGED] > 0.0 or fit.numbers[SCATTER] > _LOST_SCATTER or steep
