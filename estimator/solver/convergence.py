"""Levenberg–Marquardt for many frames at once, and the steps around it that make fits converge."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.core.arrays import Array, arange_like, namespace, true_indices
from vbaa_calib.core.robust import MAD_SCALE

from .frames import Frames
from .normal_equations import NormalEquations, Problem, solve_normal_equations
from .prediction import LINEAR, TIP, predict, rig_jacobian
from .rig_arrays import UNKNOWNS, RigArrays
from .rows import concatenate, select, where
from .state import Fits, State, evaluate, initial_state

NEAREST = 0.03
"""Least contact distance that is searched, in antenna lengths."""
EXCESS_SCATTER = 3.5
"""N points whose median residual exceeds its expectation by this over √N scatter more than noise: three deviations."""
_ITERATIONS, _COARSE_ITERATIONS = 40, 5
_TOLERANCE, _COARSE_TOLERANCE = 1e-4, 1e-2
"""A step that promises to lower the cost by less is the last: a hundredth of a standard deviation, or a tenth."""
_NEGLIGIBLE = 0.1
"""A step that promises less than this part of the tolerance is not even taken."""
_COST_NOISE = 1e-3
"""A rise of the cost by less is none: it is no better known while the feet are not yet the nearest."""
_LARGEST_FRICTION = 4.0
"""Largest friction angle that is searched, in standard deviations of its prior."""
_REPACK = 0.9
"""The batch is packed anew when no more than this part of it is still on its way."""
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
_MOST_SCATTER = 5.0
"""Largest scatter: with more, a fit would end at its priors."""
_ROUNDS, _SCATTER_CHANGE = 3, 0.1
"""The scatter is estimated again until it changes by less than this part."""
_HOPELESS, _HOPELESS_FACTOR = 50.0, 4.0
"""A minimum that costs this many times the lowest one, and this much more, is dropped."""
_POLISH_TOLERANCE, _POLISH_ITERATIONS = 1e-6, 3
_SAME_MINIMUM = 1e-2
"""Minima whose distances differ by less, in antenna lengths, are taken for the same."""


def converge(frames: Frames, rung: str, unknowns: Array, feet_m: Array | None = None) -> Fits:
    """The minima reached from unknowns (B, 4). `feet_m` (B, N): feet near the right ones, if known.

    What neither noise nor rig explains — a second contact, a kink — must not be fitted as if it were exact, nor must
    most points count as outliers for it: such frames are fitted again with the scatter of their points.
    """
    fits = _initial_fits(frames, rung, unknowns, feet_m)
    fits = _with_rig(fits) if frames.rig_arrays.steps else _descend(fits)
    for _ in range(_ROUNDS):
        estimate = _scatter(fits.problem)
        changed = abs(estimate - fits.state.scatter) > _SCATTER_CHANGE * fits.state.scatter
        if not bool(changed.any()):
            break
        rows, state = true_indices(changed), replace(fits.state, scatter=estimate)
        part = select(fits, rows)
        restart = evaluate(part.frames, part.rung, part.by_rig, select(state, rows), part.prediction)
        fits = fits.with_rows(rows, _descend(restart))
    near = fits.state.unknowns[:, 0] > TIP - _NEAR_TIP
    return _fixed_at_tip(fits, near) if bool(near.any()) else fits


def polish(fits: Fits) -> Fits:
    """The same minima to a few ten-thousandths of a deviation: whether a last step was taken must not show."""
    near = _descend(fits, _POLISH_TOLERANCE, _POLISH_ITERATIONS)
    return replace(near, state=replace(near.state, converged=fits.state.converged))


def coarse_minima(
    frames: Frames,
    rung: str,
    starts: Array,
    costs: Array,
    feet_m: Array | None = None,
    iterations: int = _COARSE_ITERATIONS,
) -> tuple[Array, Array]:
    """Rough minima (B, S, 4) reached from starts (B, S, 4), lowest first, and their costs (B, S).

    Starts of infinite cost, minima that another start reached too, and hopeless ones come out with infinite cost.
    """
    xp = namespace(starts)
    count, width = starts.shape[:2]
    useful = (xp.isfinite(costs) & xp.isfinite(starts).all(-1)).reshape(-1)
    if not bool(useful.any()):
        return starts, xp.full_like(costs, xp.inf)
    index = true_indices(useful)
    feet = None if feet_m is None else feet_m[index // width]
    first = _initial_fits(select(frames, index // width), rung, starts.reshape(-1, UNKNOWNS)[useful], feet)
    state = _descend(first, _COARSE_TOLERANCE, iterations).state
    minima, total = starts.reshape(-1, UNKNOWNS) + 0.0, xp.full_like(costs.reshape(-1), xp.inf)
    minima[useful] = state.unknowns
    total[useful] = state.cost
    minima, total = minima.reshape(count, width, UNKNOWNS), total.reshape(count, width)
    order = xp.argsort(total, -1)
    every = arange_like(total, count)[:, None]
    minima, total = minima[every, order], total[every, order]
    apart = xp.abs(minima[:, 1:, 0] - minima[:, :1, 0]) > _SAME_MINIMUM
    keep = apart & (total[:, 1:] < _HOPELESS_FACTOR * total[:, :1] + _HOPELESS)
    total[:, 1:] = xp.where(keep, total[:, 1:], xp.full_like(total[:, 1:], xp.inf))
    return minima, total


def _scatter(problem: Problem) -> Array:
    """(B,) median residual of the points over its expectation, 1 unless it is too large for noise."""
    xp = namespace(problem.scatter)
    present = problem.points.precision > 0.0
    size = xp.where(present, xp.abs(problem.whitened(problem.points.distance)), xp.inf)
    count = present.sum(-1)
    every, middle = arange_like(size, len(size)), count // 2
    median = MAD_SCALE * size[every, xp.argsort(size, -1)[every, middle]] * problem.scatter
    excess = median > 1.0 + EXCESS_SCATTER / xp.sqrt(count + 0.0)
    return xp.where(excess, xp.clip(median, None, _MOST_SCATTER), xp.ones_like(median))


def _initial_fits(frames: Frames, rung: str, unknowns: Array, feet_m: Array | None) -> Fits:
    """Fits at unknowns (B, 4), with the rig's derivatives for small deflections."""
    prediction = predict(frames, rung, unknowns)
    by_rig = rig_jacobian(frames, LINEAR, unknowns, prediction)
    return evaluate(frames, rung, by_rig, initial_state(frames, prediction, unknowns, feet_m), prediction)


def _with_rig(start: Fits) -> Fits:
    """Minima with the rig's derivatives taken near them: where a rough descent ends."""
    rough = _descend(start, _COARSE_TOLERANCE)
    fits, unknowns = _descend(_renewed(rough)), rough.state.unknowns
    for _ in range(_ROUNDS):
        far = _moved_far(fits.frames.rig_arrays, unknowns, fits.state.unknowns)
        if not bool(far.any()):
            break
        rows, unknowns = true_indices(far), fits.state.unknowns
        fits = fits.with_rows(rows, _descend(_renewed(select(fits, rows))))
    return fits


def _moved_far(rig_arrays: RigArrays, start: Array, end: Array) -> Array:
    """(B,) whether a descent went so far that the rig's derivatives have changed."""
    xp = namespace(start)
    first, last = (u[:, 1:3] * rig_arrays.tip_deflection(u[:, :1]) for u in (start, end))
    bent = xp.hypot(last[:, 0] - first[:, 0], last[:, 1] - first[:, 1])
    return (xp.abs(end[:, 0] - start[:, 0]) > _FAR) | (bent > _FAR)


def _renewed(fits: Fits) -> Fits:
    """The fits with the rig's derivatives at their own state."""
    by_rig = rig_jacobian(fits.frames, fits.rung, fits.state.unknowns, fits.prediction)
    return evaluate(fits.frames, fits.rung, by_rig, fits.state, fits.prediction)


def _fixed_at_tip(fits: Fits, near: Array) -> Fits:
    """The fits, with distances fixed at the tip that the data cannot tell from it."""
    xp = namespace(near)
    rows = true_indices(near)
    free = select(fits, rows)
    unknowns = xp.concat([xp.ones_like(free.state.unknowns[:, :1]) * TIP, free.state.unknowns[:, 1:]], -1)
    state = replace(free.state, unknowns=unknowns, at_tip=near[rows])
    fixed = _descend(evaluate(free.frames, free.rung, free.by_rig, state))
    better = fixed.state.cost <= free.state.cost + _TIP_COST
    return fits.with_rows(rows[better], select(fixed, better)) if bool(better.any()) else fits


@dataclass(frozen=True, eq=False)
class _Descent:
    """B descents on their way.

    A step that raises the cost is accepted once, since along a bent valley the next one may lower it; if that one does
    not either, the descent goes on from its lowest state, damped.

    Attributes
    ----------
    now : the fits; those that went back have only their state and equations.
    lowest, lowest_equations : the lowest states so far, and their equations.
    damping : (B,) of the next step.
    uphill : (B,) bool, the last step raised the cost.
    stale : (B,) bool, the prediction is not the lowest state's.
    done : (B,) bool, nothing is left to be gained.
    """

    now: Fits
    lowest: State
    lowest_equations: NormalEquations
    damping: Array
    uphill: Array
    stale: Array
    done: Array


def _descend(start: Fits, tolerance: float = _TOLERANCE, iterations: int = _ITERATIONS) -> Fits:
    """The minima below B fits, each `converged` or not."""
    xp, no = namespace(start.state.scatter), start.state.at_tip & ~start.state.at_tip
    descent = _Descent(start, start.state, start.equations, xp.zeros_like(start.state.scatter), no, no, no)
    todo, arrived = arange_like(start.state.scatter, len(start.frames)), []
    for _ in range(iterations):
        step, promise = _step(descent)
        descent = replace(descent, done=descent.done | ((promise < _NEGLIGIBLE * tolerance) & ~descent.uphill))
        going = ~descent.done | descent.stale
        left = int(going.sum())
        if left == 0:
            break
        if left <= _REPACK * len(going):
            arrived.append((todo[~going], _lowest(select(descent, ~going))))
            descent, todo, step, promise = select(descent, going), todo[going], step[going], promise[going]
        descent = _advance(descent, step, promise, promise < tolerance)
    if not arrived:
        return _lowest(descent)
    arrived.append((todo, _lowest(descent)))
    order = xp.argsort(xp.concat([rows for rows, _ in arrived]))
    parts = ("state", "prediction", "problem", "equations")
    return replace(start, **{name: concatenate([getattr(one, name) for _, one in arrived], order) for name in parts})


def _advance(descent: _Descent, step: Array, promise: Array, last: Array) -> _Descent:
    """After a step, the last one for some (B,); who is done stays at the lowest state."""
    xp, before = namespace(promise), descent.now
    step = xp.where(descent.done[:, None], xp.zeros_like(step), step)
    unknowns = moved_unknowns(before.frames.rig_arrays, before.state.unknowns, step[:, :UNKNOWNS])
    state = replace(before.state, unknowns=unknowns, rig_steps=before.state.rig_steps + step[:, UNKNOWNS:])
    trial = evaluate(before.frames, before.rung, before.by_rig, state)
    better = (trial.state.cost <= descent.lowest.cost + _COST_NOISE) | descent.done
    done = descent.done | (last & ~descent.uphill)
    gain = (before.state.cost - trial.state.cost) / xp.clip(promise, 1e-300, None)
    damping = xp.where(gain > 0.75, 0.1 * descent.damping, descent.damping)
    damping = xp.where(gain < 0.25, xp.clip(4.0 * descent.damping, _DAMPING, None), damping)
    if bool(better.all()):
        return _Descent(trial, trial.state, trial.equations, damping, ~better, ~better, done)
    lowest = where(better, trial.state, descent.lowest)
    equations = where(better, trial.equations, descent.lowest_equations)
    back = ~better & (descent.uphill | done | ~(trial.state.cost < _MOST_COST * descent.lowest.cost))
    now = replace(trial, state=where(back, lowest, trial.state), equations=where(back, equations, trial.equations))
    raised = xp.where(back, xp.clip(10.0 * descent.damping, _DAMPING, None), descent.damping)
    return _Descent(now, lowest, equations, xp.where(better, damping, raised), ~better & ~back, ~better, done)


def _lowest(descent: _Descent) -> Fits:
    """The fits at the lowest states."""
    found = replace(descent.now, state=replace(descent.lowest, converged=descent.done))
    if bool(descent.stale.any()):
        rows = true_indices(descent.stale)
        part = select(found, rows)
        found = found.with_rows(rows, evaluate(part.frames, part.rung, part.by_rig, part.state))
    return found


def moved_unknowns(rig_arrays: RigArrays, unknowns: Array, step: Array) -> Array:
    """Unknowns (B, 4) after a step (B, 4), taken straight in the clamp's moment: in the force its valley is bent."""
    xp = namespace(unknowns)
    old, distance = unknowns[:, :1], unknowns[:, :1] + step[:, :1]
    distance = xp.minimum(xp.maximum(distance, xp.clip(0.5 * old, NEAREST, None)), xp.ones_like(old) * TIP)
    friction = xp.clip(unknowns[:, 3:] + step[:, 3:], -_LARGEST_FRICTION, _LARGEST_FRICTION)
    lever, ahead = _lever(rig_arrays, unknowns), _lever(rig_arrays, unknowns + _AHEAD * step)
    force = unknowns[:, 1:3]
    moment = lever * (force + step[:, 1:3]) + (ahead - lever) / _AHEAD * force
    for _ in range(2):
        force = moment / _lever(rig_arrays, xp.concat([distance, force, friction], -1))
    return xp.concat([distance, force, friction], -1)


def _lever(rig_arrays: RigArrays, unknowns: Array) -> Array:
    """(B, 1) the clamp's moment per force, in antenna lengths; friction adds the load F·l²/EI over 6 to it."""
    xp = namespace(unknowns)
    distance, force, friction = unknowns[:, :1], unknowns[:, 1:3], unknowns[:, 3:]
    load = rig_arrays.unit_load * xp.hypot(force[:, :1], force[:, 1:]) * distance * distance
    return distance * xp.clip(1.0 - xp.tan(rig_arrays.friction_rad * friction) * load / 6.0, 0.2, 5.0)


def _step(descent: _Descent) -> tuple[Array, Array]:
    """Levenberg–Marquardt steps (B, K), and by how much each promises to lower the cost (B,)."""
    equations, state, rig_arrays = descent.now.equations, descent.now.state, descent.now.frames.rig_arrays
    xp = namespace(descent.damping)
    step = solve_normal_equations(equations.information, equations.right_side, descent.damping)
    distance = state.unknowns[:, 0]
    fixed = state.at_tip | ((distance <= NEAREST) & (step[:, 0] < 0.0)) | ((distance >= TIP) & (step[:, 0] > 0.0))
    if bool(fixed.any()):
        free = xp.ones_like(step)
        free[:, 0] = xp.where(fixed, xp.zeros_like(distance), free[:, 0])
        information = equations.information * (free[:, :, None] * free[:, None])
        information[:, 0, 0] += 1.0 - free[:, 0]
        step = solve_normal_equations(information, equations.right_side * free, descent.damping) * free
    sway = xp.hypot(step[:, 1], step[:, 2]) * rig_arrays.tip_deflection(distance)
    step = step * xp.clip(_LONGEST / xp.clip(sway, 1e-12, None), None, 1.0)[:, None]
    curvature = (equations.information @ step[..., None])[..., 0]
    return step, ((equations.right_side - 0.5 * curvature) * step).sum(-1)
