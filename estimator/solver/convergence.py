"""Levenberg–Marquardt for one frame, and the steps around it that make a fit converge."""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.compiled import compiled, record
from vbaa_calib.core.lanes import LANES
from vbaa_calib.core.robust import MAD_SCALE

from .fit import (
    AT_TIP,
    CONVERGED,
    COST,
    NODES,
    SCATTER,
    Fit,
    State,
    copy_fit,
    empty_fit,
    empty_state,
    go_back,
    keep,
)
from .linear_algebra import factorise, fill, put, solve_factorised
from .normal_equations import evaluate, linearise, nearest_feet, normal_equations
from .prediction import LINEAR, TIP, Bent, empty_bent, predict
from .rig_arrays import UNKNOWNS, tip_deflection
from .rig_jacobian import rig_jacobian

NEAREST = 0.03
"""Least contact distance that is searched, in antenna lengths."""
EXCESS_SCATTER = 3.5
"""N points whose median residual exceeds its expectation by this over √N scatter more than noise: three deviations."""
_ITERATIONS, COARSE_ITERATIONS = 40, 5
_TOLERANCE, _COARSE_TOLERANCE = 1e-4, 1e-2
"""A step that promises to lower the cost by less is the last: a hundredth of a standard deviation, or a tenth."""
_NEGLIGIBLE = 0.1
"""A step that promises less than this part of the tolerance is not even taken."""
_COST_NOISE = 1e-3
"""A rise of the cost by less is none: it is no better known while the feet are not yet the nearest."""
_LARGEST_FRICTION = 4.0
"""Largest friction angle that is searched, in standard deviations of its prior."""
_DAMPING = 1e-3
"""Least damping, on a unit diagonal, after a step that was poorly predicted."""
_MOST_COST = 100.0
"""A step to more than this many times the lowest cost is not followed."""
_LONGEST = 0.2
"""Longest step of the tip's deflection, in antenna lengths: along the line of sight hardly anything holds it."""
_AHEAD = 1e-3
"""Part of a step over which the lever's derivative is taken."""
_NEAR_TIP, _TIP_COST = 0.03, 2.0
"""A distance this near to the tip is fixed there if that costs no more than this: two standard deviations."""
_FAR = 0.02
"""Change of the distance or the tip's deflection, in antenna lengths, after which the rig's derivatives are renewed."""
WRONG_SHAPE = 3.0
"""Median residual, in standard deviations, beyond which the shape is not that of one contact."""
MOST_SCATTER = 5.0
"""Largest scatter: with more, a fit would end at its priors."""
_ROUNDS, _SCATTER_CHANGE = 3, 0.1
"""The scatter is estimated again until it changes by less than this part."""
MOST_EVALUATIONS, _MOST_HOPELESS = 400, 60
"""Evaluations of the model after which a frame is given up: sound frames take 3 to 30, by vision alone up to 200. While
most points lie far off every fit so far, `_MOST_HOPELESS` for each search."""
_POLISH_TOLERANCE, _POLISH_ITERATIONS = 1e-6, 3


@record
class Work:
    """Scratch room for one frame at a time.

    Attributes
    ----------
    free : the free antenna. best, found : of the frame's minima. other : a fit for whatever is done at the moment.
    kept : the lowest state of a descent.
    shift : (M,). product : (M, K). factor : (K, K). scale, step : (K,). start : (4,).
    evaluations, most : (1,) of the model so far, and after how many to give up.
    """

    bent: Bent
    free: Fit
    best: Fit
    found: Fit
    other: Fit
    kept: State
    shift: np.ndarray
    product: np.ndarray
    factor: np.ndarray
    scale: np.ndarray
    step: np.ndarray
    start: np.ndarray
    evaluations: np.ndarray
    most: np.ndarray


@compiled
def empty_work(rig, lens, points):
    """Scratch room for frames of so many points."""
    steps = rig.axes.shape[1] + len(rig.line)
    wide = (UNKNOWNS + steps + LANES - 1) // LANES * LANES
    return Work(
        empty_bent(rig, lens),
        empty_fit(points, steps),
        empty_fit(points, steps),
        empty_fit(points, steps),
        empty_fit(points, steps),
        empty_state(points, steps),
        np.empty(NODES),
        np.empty((NODES, wide)),
        np.empty((wide, wide)),
        np.empty(wide),
        np.empty(wide),
        np.empty(UNKNOWNS),
        np.zeros(1, np.int64),
        np.full(1, MOST_EVALUATIONS),
    )


@compiled
def converge(rig, frame, rung, fit, work, with_feet):
    """The minimum reached from the fit's unknowns, with the rig as calibrated and feet near the right ones, if known.

    What neither noise nor rig explains — a second contact, a kink — must not be fitted as if it were exact, nor must
    most points count as outliers for it: such a frame is fitted again with the scatter of its points.
    """
    _begin(rig, frame, rung, fit, work, with_feet, 1.0)
    if len(fit.steps):
        _with_rig(rig, frame, rung, fit, work)
    else:
        _descend(rig, frame, rung, fit, work, _TOLERANCE, _ITERATIONS)
    for _ in range(_ROUNDS):
        before, scatter = fit.numbers[SCATTER], _scatter(fit)
        if not abs(scatter - before) > _SCATTER_CHANGE * before:
            break
        fit.numbers[SCATTER] = scatter
        _again(rig, frame, fit, work)
        _descend(rig, frame, rung, fit, work, _TOLERANCE, _ITERATIONS)
    if fit.numbers[SCATTER] < MOST_SCATTER:
        work.most[0] = MOST_EVALUATIONS
    if fit.unknowns[0] > TIP - _NEAR_TIP:
        _fixed_at_tip(rig, frame, rung, fit, work)


@compiled
def converge_there(rig, frame, rung, fit, work):
    """The minimum at the fit's distance, with feet near the right ones. Returns whether that explains the frame.

    A force that hardly anything asks for leaves its distance open: a descent would wander along the antenna.
    """
    _begin(rig, frame, rung, fit, work, True, 1.0)
    rig_jacobian(rig, frame, rung, work.bent, fit)
    _again(rig, frame, fit, work)
    fit.numbers[AT_TIP] = 1.0
    _descend(rig, frame, rung, fit, work, _TOLERANCE, _ITERATIONS)
    fit.numbers[AT_TIP] = 0.0
    return fit.numbers[CONVERGED] > 0.0 and _scatter(fit) == 1.0


@compiled
def begin_search(work):
    """Grant evaluations of the model for a search; a fit that explains most points grants all."""
    work.most[0] = max(work.most[0], min(work.evaluations[0] + _MOST_HOPELESS, MOST_EVALUATIONS))


@compiled
def polish(rig, frame, rung, fit, work):
    """The same minimum to a few ten-thousandths of a deviation: whether a last step was taken must not show."""
    converged = fit.numbers[CONVERGED]
    _descend(rig, frame, rung, fit, work, _POLISH_TOLERANCE, _POLISH_ITERATIONS)
    fit.numbers[CONVERGED] = converged


@compiled
def coarse_minimum(rig, frame, rung, fit, work, with_feet, scatter, iterations):
    """A rough minimum reached from the fit's unknowns, the points scattering so many times more than their noise."""
    _begin(rig, frame, rung, fit, work, with_feet, scatter)
    _descend(rig, frame, rung, fit, work, _COARSE_TOLERANCE, iterations)


@compiled
def _begin(rig, frame, rung, fit, work, with_feet, scatter):
    """The fit at its unknowns, with the rig as calibrated and its derivatives for small deflections."""
    fill(fit.steps, 0.0)
    fit.numbers[SCATTER] = scatter
    fit.numbers[CONVERGED] = 0.0
    fit.numbers[AT_TIP] = 0.0
    predict(rig, frame, rung, work.bent, fit, True)
    rig_jacobian(rig, frame, LINEAR, work.bent, fit)
    if not with_feet:
        nearest_feet(rig, frame, fit)
    _again(rig, frame, fit, work)


@compiled
def _again(rig, frame, fit, work):
    """Residuals and normal equations again, of the same prediction."""
    linearise(rig, frame, fit, work)
    normal_equations(rig, fit, 0, work.product)


@compiled
def _with_rig(rig, frame, rung, fit, work):
    """The minimum with the rig's derivatives taken near it: where a rough descent ends."""
    _descend(rig, frame, rung, fit, work, _COARSE_TOLERANCE, _ITERATIONS)
    for turn in range(1 + _ROUNDS):
        if turn > 0 and not _moved_far(rig, work.start, fit.unknowns):
            break
        put(fit.unknowns, work.start)
        rig_jacobian(rig, frame, rung, work.bent, fit)
        _again(rig, frame, fit, work)
        _descend(rig, frame, rung, fit, work, _TOLERANCE, _ITERATIONS)


@compiled
def _moved_far(rig, start, end):
    """Whether a descent went so far that the rig's derivatives have changed."""
    first, last = tip_deflection(rig, start[0]), tip_deflection(rig, end[0])
    bent = np.hypot(end[1] * last - start[1] * first, end[2] * last - start[2] * first)
    return abs(end[0] - start[0]) > _FAR or bent > _FAR


@compiled
def _scatter(fit):
    """Median residual of the points over its expectation, 1 unless it is too large for noise."""
    count, distance, precision = len(fit.distance), fit.distance, fit.precision
    if count == 0:
        return 1.0
    largest, above = 1.0 + EXCESS_SCATTER / np.sqrt(count), 0
    bound = (largest / MAD_SCALE) ** 2
    for i in range(count):
        above += not distance[i] * distance[i] * precision[i] <= bound
    if above < count - count // 2:
        return 1.0
    size = np.abs(distance) * np.sqrt(precision)
    median = MAD_SCALE * np.partition(size, count // 2)[count // 2]
    if median > largest:
        return min(median, MOST_SCATTER)
    return 1.0


@compiled
def _fixed_at_tip(rig, frame, rung, fit, work):
    """The fit, its distance fixed at the tip if the data cannot tell it from there."""
    free = work.other
    copy_fit(fit, free)
    fit.unknowns[0] = TIP
    fit.numbers[AT_TIP] = 1.0
    evaluate(rig, frame, rung, fit, work)
    _descend(rig, frame, rung, fit, work, _TOLERANCE, _ITERATIONS)
    if not fit.numbers[COST] <= free.numbers[COST] + _TIP_COST:
        copy_fit(free, fit)


@compiled
def _descend(rig, frame, rung, fit, work, tolerance, iterations):
    """The minimum below a fit, `CONVERGED` or not.

    A step that raises the cost is accepted once, since along a bent valley the next one may lower it; if that one does
    not either, the descent goes on from its lowest state, damped.
    """
    kept, step, unknowns, steps, damping = work.kept, work.step, fit.unknowns, fit.steps, 0.0
    least = fit.numbers[COST]
    uphill, stale, done = False, False, False
    for _ in range(iterations):
        promise = _step(rig, fit, damping, work)
        done = done or (promise < _NEGLIGIBLE * tolerance and not uphill)
        if (done and not stale) or work.evaluations[0] >= work.most[0]:
            break
        if done:
            fill(step, 0.0)
        last, before = promise < tolerance, fit.numbers[COST]
        if not uphill:
            keep(fit, kept)
        moved_unknowns(rig, unknowns, step, unknowns)
        for k in range(len(steps)):
            steps[k] += step[UNKNOWNS + k]
        evaluate(rig, frame, rung, fit, work)
        cost = fit.numbers[COST]
        better = cost <= least + _COST_NOISE or done
        done = done or (last and not uphill)
        gain = (before - cost) / max(promise, 1e-300)
        if better:
            if gain > 0.75:
                damping *= 0.1
            elif gain < 0.25:
                damping = max(4.0 * damping, _DAMPING)
            least, uphill, stale = cost, False, False
            continue
        back = uphill or done or not cost < _MOST_COST * least
        if back:
            go_back(kept, fit)
            damping = max(10.0 * damping, _DAMPING)
        uphill, stale = not back, True
    if uphill:
        go_back(kept, fit)
    fit.numbers[CONVERGED] = 1.0 if done else 0.0
    if stale:
        evaluate(rig, frame, rung, fit, work)


@compiled
def moved_unknowns(rig, unknowns, step, moved):
    """Unknowns (4,) after a step, taken straight in the clamp's moment: in the force its valley is bent."""
    old = unknowns[0]
    distance = min(max(old + step[0], max(0.5 * old, NEAREST)), TIP)
    friction = min(max(unknowns[3] + step[3], -_LARGEST_FRICTION), _LARGEST_FRICTION)
    force_y, force_z = unknowns[1], unknowns[2]
    lever = _lever(rig, old, force_y, force_z, unknowns[3])
    ahead = _lever(
        rig,
        old + _AHEAD * step[0],
        force_y + _AHEAD * step[1],
        force_z + _AHEAD * step[2],
        unknowns[3] + _AHEAD * step[3],
    )
    change = (ahead - lever) / _AHEAD
    moment_y = lever * (force_y + step[1]) + change * force_y
    moment_z = lever * (force_z + step[2]) + change * force_z
    for _ in range(2):
        there = _lever(rig, distance, force_y, force_z, friction)
        force_y, force_z = moment_y / there, moment_z / there
    moved[0], moved[1], moved[2], moved[3] = distance, force_y, force_z, friction


@compiled
def _lever(rig, distance, force_y, force_z, friction):
    """The clamp's moment per force, in antenna lengths; friction adds the load F·l²/EI over 6 to it."""
    load = rig.unit_load * np.hypot(force_y, force_z) * distance * distance
    return distance * min(max(1.0 - np.tan(rig.friction_rad * friction) * load / 6.0, 0.2), 5.0)


@compiled
def _step(rig, fit, damping, work):
    """Levenberg–Marquardt's step (K,) from a fit, into `work.step`, and by how much it promises to lower the cost."""
    information, side, step, size = fit.information, fit.side, work.step, fit.size
    distance = fit.unknowns[0]
    fixed = fit.numbers[AT_TIP] > 0.0
    if not fixed:
        factorise(information, 0, size, damping, work.factor, work.scale)
        solve_factorised(work.factor, work.scale, size, side, step)
        fixed = (distance <= NEAREST and step[0] < 0.0) or (distance >= TIP and step[0] > 0.0)
    if fixed:
        step[0] = 0.0
        factorise(information, 1, size - 1, damping, work.factor, work.scale)
        solve_factorised(work.factor, work.scale, size - 1, side[1:], step[1:])
    bent = np.hypot(step[1], step[2]) * tip_deflection(rig, distance)
    shorter = min(_LONGEST / max(bent, 1e-12), 1.0)
    promise = 0.0
    for a in range(size):
        step[a] *= shorter
    for a in range(size):
        curvature = 0.0
        for b in range(size):
            curvature += information[a, b] * step[b]
        promise += (side[a] - 0.5 * curvature) * step[a]
    return promise
