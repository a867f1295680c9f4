"""Frames settled on one rung: polished, weighed by what their points scatter, held at the tip if need be."""

from __future__ import annotations

from dataclasses import replace

from vbaa_calib.core.arrays import Array, counted, namespace, places
from vbaa_calib.core.robust import MAD_SCALE

from .descent import COARSE_ITERATIONS, COARSE_STANDSTILL, descend
from .frames import Frames
from .normal_equations import Problem
from .prediction import LINEAR, TIP, look, rig_table
from .rig_arrays import UNKNOWNS, Known
from .state import Settled, State, begin, evaluated, picked

NEAR_TIP, TIP_OBJECTION = 0.03, 2.0
"""A distance this near to the tip is held there if that costs no more than this: if it lies within two deviations."""
SCATTERED = 3.5
"""N points whose median misfit exceeds its expectation by this over √N scatter more than noise: three deviations."""
FAR = 0.02
"""A way, in antenna lengths along the antenna or of its tip, after which the rig's influence is taken anew."""
MOST_SCATTER = 5.0
"""More is not believed: the fit is lost, and would settle on what was thought likely beforehand."""
ROUNDS, CHANGED = 3, 0.1
"""The scatter is measured anew until it changes by less than this part: a lost fit that comes home scatters less."""
HOPELESS, HOPELESS_FACTOR = 50.0, 4.0
"""A valley whose floor lies higher than so many times the lowest one's, and by so much, is left."""
POLISHED, POLISHING = 1e-6, 3
"""What is left of the cost for the last step of fits that are reported, and how many steps there are at most."""
SAME_VALLEY = 1e-2
"""Distances closer than this, in antenna lengths, are taken for the same valley."""


def settle(frames: Frames, rung: str, unknowns: Array, feet_m: Array | None = None) -> Settled:
    """The floors of the valleys that unknowns (B, 4) lie in. `feet_m` (B, N): feet near the right ones, if known.

    What neither noise nor rig explains — a second contact, a kink — must not be fitted as if it were exact, nor must
    most points count as outliers for it: such frames are fitted again with what their points scatter.
    """
    fits = _begun(frames, rung, unknowns, feet_m)
    fits = _with_rig(fits) if frames.known.axes.shape[1] else descend(fits)
    for _ in range(ROUNDS):
        spread = scatter(fits.problem)
        changed = abs(spread - fits.state.scatter) > CHANGED * fits.state.scatter
        if not bool(changed.any()):
            break
        fits = _anew(fits, changed, replace(fits.state, scatter=spread))
    near = fits.state.unknowns[:, 0] > TIP - NEAR_TIP
    return _held_at_tip(fits, near) if bool(near.any()) else fits


def polished(fits: Settled) -> Settled:
    """The same floors, to a few ten-thousandths of a deviation: whether a last step was taken must not show."""
    near = descend(fits, POLISHED, POLISHING)
    return replace(near, state=replace(near.state, converged=fits.state.converged))


def _with_rig(begun: Settled) -> Settled:
    """The floors below, with the rig's influence taken beside them: where rough descents end."""
    rough = descend(begun, COARSE_STANDSTILL)
    fits, unknowns = descend(_own_table(rough)), rough.state.unknowns
    for _ in range(ROUNDS):
        far = _far(fits.frames.known, unknowns, fits.state.unknowns)
        if not bool(far.any()):
            break
        rows, unknowns = places(far), fits.state.unknowns
        fits = fits.having(rows, descend(_own_table(picked(fits, rows))))
    return fits


def _begun(frames: Frames, rung: str, unknowns: Array, feet_m: Array | None) -> Settled:
    """Fits at unknowns (B, 4), with the rig's influence on small deflections."""
    view = look(frames, rung, unknowns)
    table = rig_table(frames, LINEAR, unknowns, view)
    return evaluated(frames, rung, table, begin(frames, view, unknowns, feet_m), view)


def explored(
    frames: Frames,
    rung: str,
    starts: Array,
    costs: Array,
    feet_m: Array | None = None,
    iterations: int = COARSE_ITERATIONS,
) -> tuple[Array, Array]:
    """Rough floors (B, S, 4) below starts (B, S, 4), lowest first, and their costs (B, S).

    Starts of infinite cost, floors that another one reached too, and hopeless ones come out with infinite cost.
    """
    xp = namespace(starts)
    count, width = starts.shape[:2]
    worth = (xp.isfinite(costs) & xp.isfinite(starts).all(-1)).reshape(-1)
    if not bool(worth.any()):
        return starts, xp.full_like(costs, xp.inf)
    index = places(worth)
    several = frames.picked(index // width)
    feet = None if feet_m is None else feet_m[index // width]
    first = _begun(several, rung, starts.reshape(-1, UNKNOWNS)[worth], feet)
    state = descend(first, COARSE_STANDSTILL, iterations).state
    floors, total = starts.reshape(-1, UNKNOWNS) + 0.0, xp.full_like(costs.reshape(-1), xp.inf)
    floors[worth] = state.unknowns
    total[worth] = state.cost
    floors, total = floors.reshape(count, width, UNKNOWNS), total.reshape(count, width)
    order = xp.argsort(total, -1)
    every = counted(total, count)[:, None]
    floors, total = floors[every, order], total[every, order]
    far = xp.abs(floors[:, 1:, 0] - floors[:, :1, 0]) > SAME_VALLEY
    keep = far & (total[:, 1:] < HOPELESS_FACTOR * total[:, :1] + HOPELESS)
    total[:, 1:] = xp.where(keep, total[:, 1:], xp.full_like(total[:, 1:], xp.inf))
    return floors, total


def scatter(about: Problem) -> Array:
    """(B,) median misfit of the points over its expectation, 1 unless it is too much."""
    xp = namespace(about.scatter)
    size = xp.where(about.found.precision > 0.0, xp.abs(about.whitened(about.found.distance)), xp.inf)
    count = (about.found.precision > 0.0).sum(-1)
    every, middle = counted(size, len(size)), count // 2
    median = MAD_SCALE * size[every, xp.argsort(size, -1)[every, middle]] * about.scatter
    much = median > 1.0 + SCATTERED / xp.sqrt(count + 0.0)
    return xp.where(much, xp.clip(median, None, MOST_SCATTER), xp.ones_like(median))


def _far(known: Known, start: Array, end: Array) -> Array:
    """(B,) whether a descent led so far that the rig's influence is no longer what it was at its start."""
    xp = namespace(start)
    first, last = (u[:, 1:3] * known.tip_per_force(u[:, :1]) for u in (start, end))
    bent = xp.hypot(last[:, 0] - first[:, 0], last[:, 1] - first[:, 1])
    return (xp.abs(end[:, 0] - start[:, 0]) > FAR) | (bent > FAR)


def _own_table(fits: Settled) -> Settled:
    """The fits with the rig's influence as it is where they stand."""
    table = rig_table(fits.frames, fits.rung, fits.state.unknowns, fits.view)
    return evaluated(fits.frames, fits.rung, table, fits.state, fits.view)


def _anew(fits: Settled, which: Array, begun: State) -> Settled:
    """Some of the fits descended once more, from other states of the same unknowns."""
    rows = places(which)
    part = picked(fits, rows)
    return fits.having(rows, descend(evaluated(part.frames, part.rung, part.table, picked(begun, rows), part.view)))


def _held_at_tip(fits: Settled, near: Array) -> Settled:
    """Distances that the data cannot tell from the tip are held there."""
    xp = namespace(near)
    rows = places(near)
    free = picked(fits, rows)
    unknowns = xp.concat([xp.ones_like(free.state.unknowns[:, :1]) * TIP, free.state.unknowns[:, 1:]], -1)
    state = replace(free.state, unknowns=unknowns, at_tip=near[rows])
    held = descend(evaluated(free.frames, free.rung, free.table, state))
    better = held.state.cost <= free.state.cost + TIP_OBJECTION
    return fits.having(rows[better], picked(held, better)) if bool(better.any()) else fits
