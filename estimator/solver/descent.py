"""Down to the floor of a valley: Levenberg and Marquardt's steps, for many frames at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.core.arrays import Array, counted, namespace, places

from .normal_equations import Equations, solved
from .prediction import TIP
from .rig_arrays import UNKNOWNS, Known
from .state import Settled, State, chosen, evaluated, gathered, picked

ITERATIONS, COARSE_ITERATIONS = 40, 5
NEAREST = 0.03
"""Least contact distance that is looked for, in antenna lengths."""
STANDSTILL, COARSE_STANDSTILL = 1e-4, 1e-2
"""A step that promises less than this much of the cost is the last: a hundredth of a standard deviation, or a tenth."""
QUIET = 0.1
"""One that promises less than this part of that is not even taken."""
UNSURE = 1e-3
"""A cost is known no better while the feet are not yet the nearest: a rise by less is none."""
STEEPEST = 4.0
"""Friction angles beyond so many of its deviations are not looked for."""
SHRINK = 0.9
"""The batch is packed anew when no more than this part of it is still on its way."""
DAMPING = 1e-3
"""The least that is tried, on a unit diagonal."""
FAR = 100.0
"""A step to more than so many times the lowest cost is not followed."""
LONGEST = 0.2
"""A step moves the tip by at most this part of the length: along the line of sight hardly anything holds it."""
AHEAD = 1e-3
"""Part of a step over which the lever's slope is taken."""


def descend(start: Settled, standstill: float = STANDSTILL, iterations: int = ITERATIONS) -> Settled:
    """The floors below B fits, each `converged` or not."""
    walk, todo, arrived = _begun(start), counted(start.state.scatter, len(start.frames)), []
    for _ in range(iterations):
        step, promise = _step(walk, walk.damping)
        walk = replace(walk, done=walk.done | ((promise < QUIET * standstill) & ~walk.astray))
        going = ~walk.done | walk.aside
        left = int(going.sum())
        if left == 0:
            break
        if left <= SHRINK * len(going):
            arrived.append((todo[~going], _ended(picked(walk, ~going))))
            walk, todo, step, promise = picked(walk, going), todo[going], step[going], promise[going]
        walk = _walked(walk, step, promise, promise < standstill)
    arrived.append((todo, _ended(walk)))
    return _joined(start, arrived)


@dataclass(frozen=True, eq=False)
class Walk:
    """Where B descents stand.

    A step that does not lower the cost is tried once all the same, since along a bent valley the next one may; if that
    does not either, the walk goes on from its lowest point, damped.

    Attributes
    ----------
    now : the fits; those that went back have only their state and equations, and are `aside`.
    lowest, there : the lowest states so far, and their equations.
    damping : (B,) of the next step.
    astray : (B,) bool, the last step did not lower the cost.
    aside : (B,) bool, the view is not the lowest state's.
    done : (B,) bool, nothing is left to be gained.
    """

    now: Settled
    lowest: State
    there: Equations
    damping: Array
    astray: Array
    aside: Array
    done: Array


def _begun(start: Settled) -> Walk:
    xp, no = namespace(start.state.scatter), start.state.at_tip & ~start.state.at_tip
    none = xp.zeros_like(start.state.scatter)
    return Walk(start, start.state, start.equations, none, no, no, no)


def _walked(walk: Walk, step: Array, promise: Array, last: Array) -> Walk:
    """After a step, the last one for some (B,); who is done stays at the lowest state."""
    xp, before = namespace(promise), walk.now
    step = xp.where(walk.done[:, None], xp.zeros_like(step), step)
    state = _moved(before.frames.known, before.state, step)
    trial = evaluated(before.frames, before.rung, before.table, state)
    better = (trial.state.cost <= walk.lowest.cost + UNSURE) | walk.done
    done = walk.done | (last & ~walk.astray)
    kept = (before.state.cost - trial.state.cost) / xp.clip(promise, 1e-300, None)
    eased = xp.where(kept > 0.75, 0.1 * walk.damping, walk.damping)
    eased = xp.where(kept < 0.25, xp.clip(4.0 * walk.damping, DAMPING, None), eased)
    if bool(better.all()):
        return Walk(trial, trial.state, trial.equations, eased, ~better, ~better, done)
    lowest, there = chosen(better, trial.state, walk.lowest), chosen(better, trial.equations, walk.there)
    back = ~better & (walk.astray | done | ~(trial.state.cost < FAR * walk.lowest.cost))
    now = replace(trial, state=chosen(back, lowest, trial.state), equations=chosen(back, there, trial.equations))
    damping = xp.where(better, eased, xp.where(back, xp.clip(10.0 * walk.damping, DAMPING, None), walk.damping))
    return Walk(now, lowest, there, damping, ~better & ~back, ~better, done)


def _ended(walk: Walk) -> Settled:
    """The fits at the lowest states."""
    found = replace(walk.now, state=replace(walk.lowest, converged=walk.done))
    if bool(walk.aside.any()):
        rows = places(walk.aside)
        part = picked(found, rows)
        found = found.having(rows, evaluated(part.frames, part.rung, part.table, part.state))
    return found


def _joined(start: Settled, arrived: list[tuple[Array, Settled]]) -> Settled:
    """All fits, in the order in which they began."""
    if len(arrived) == 1:
        return arrived[0][1]
    xp = namespace(start.state.scatter)
    order = xp.argsort(xp.concat([rows for rows, _ in arrived]))
    parts = ("state", "view", "problem", "equations")
    return replace(start, **{name: gathered([getattr(one, name) for _, one in arrived], order) for name in parts})


def moved_unknowns(known: Known, unknowns: Array, step: Array) -> Array:
    """Unknowns (B, 4) after a step (B, 4), taken straight in the clamp's moment: in the force its valley is bent."""
    xp = namespace(unknowns)
    old, distance = unknowns[:, :1], unknowns[:, :1] + step[:, :1]
    distance = xp.minimum(xp.maximum(distance, xp.clip(0.5 * old, NEAREST, None)), xp.ones_like(old) * TIP)
    friction = xp.clip(unknowns[:, 3:] + step[:, 3:], -STEEPEST, STEEPEST)
    lever, ahead = _lever(known, unknowns), _lever(known, unknowns + AHEAD * step)
    force = unknowns[:, 1:3]
    moment = lever * (force + step[:, 1:3]) + (ahead - lever) / AHEAD * force
    for _ in range(2):
        force = moment / _lever(known, xp.concat([distance, force, friction], -1))
    return xp.concat([distance, force, friction], -1)


def _lever(known: Known, unknowns: Array) -> Array:
    """(B, 1) the clamp's moment per force, in antenna lengths: that of friction is the load a = F·l²/EI over 6."""
    xp = namespace(unknowns)
    distance, force, friction = unknowns[:, :1], unknowns[:, 1:3], unknowns[:, 3:]
    load = known.load * xp.hypot(force[:, :1], force[:, 1:]) * distance * distance
    return distance * xp.clip(1.0 - xp.tan(known.friction_rad * friction) * load / 6.0, 0.2, 5.0)


def _moved(known: Known, now: State, step: Array) -> State:
    unknowns = moved_unknowns(known, now.unknowns, step[:, :UNKNOWNS])
    return replace(now, unknowns=unknowns, steps=now.steps + step[:, UNKNOWNS:])


def _step(walk: Walk, damping: Array) -> tuple[Array, Array]:
    """Levenberg–Marquardt steps (B, K), and how much of the cost each promises to take (B,)."""
    here, now, known = walk.now.equations, walk.now.state, walk.now.frames.known
    xp = namespace(damping)
    step = solved(here.information, here.pull, damping)
    distance = now.unknowns[:, 0]
    held = now.at_tip | ((distance <= NEAREST) & (step[:, 0] < 0.0)) | ((distance >= TIP) & (step[:, 0] > 0.0))
    if bool(held.any()):
        free = xp.ones_like(step)
        free[:, 0] = xp.where(held, xp.zeros_like(distance), free[:, 0])
        information = here.information * (free[:, :, None] * free[:, None])
        information[:, 0, 0] += 1.0 - free[:, 0]
        step = solved(information, here.pull * free, damping) * free
    sway = xp.hypot(step[:, 1], step[:, 2]) * known.tip_per_force(distance)
    step = step * xp.clip(LONGEST / xp.clip(sway, 1e-12, None), None, 1.0)[:, None]
    bent = (here.information @ step[..., None])[..., 0]
    return step, ((here.pull - 0.5 * bent) * step).sum(-1)
