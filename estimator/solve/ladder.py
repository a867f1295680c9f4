"""From frames to fits: which valley, which rung of the ladder, and what else would explain them."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.arrays import Array, namespace

from .batch import picked, written
from .descend import begin
from .frames import Frames
from .settle import SAME, Settled, evaluated, explored, settle
from .starts import Free, free_antenna, start_values
from .view import look, rig_table
from .worth import REFERENCE, Worth, evidence, predicted_bias, worth

EXPLORER = "linear"
"""The rung on which valleys are told apart."""
STARTS = 2
SMALL = 1 / 3
"""A rung's predicted bias is small when it is below this fraction of the standard deviation."""


@dataclass(frozen=True, eq=False)
class Solved:
    """Frames on one rung, and what belongs to them.

    Attributes
    ----------
    rows : (B,) their places among all that were asked for.
    evidence : (B,) for a contact, see `worth.evidence`.
    bias : rung → (B,) its predicted bias in standard deviations; of rungs that were looked at.
    rival : (B,) how much more another valley costs; infinite without one. rival_distance : (B,) where it lies.
    """

    rows: Array
    fits: Settled
    worth: Worth
    free: Free
    evidence: Array
    bias: dict[str, Array]
    rival: Array
    rival_distance: Array


def explore(frames: Frames, warm: Array | None = None) -> tuple[Array, Array, Free]:
    """Rough floors (B, S, 4), lowest first, their costs (B, S), infinite where there is none, and the free antenna.

    `warm` (B, 4), unknowns near the truth where finite, is taken as it is where no other distance explains much more.
    """
    free = free_antenna(frames, REFERENCE)
    starts, costs = start_values(frames, free, STARTS, warm)
    floors, totals = explored(frames, EXPLORER, starts, costs)
    return floors, totals, free


def solve(frames: Frames, model: str, warm: Array | None = None) -> list[Solved]:
    """Fit B frames; frames on the same rung come together. `warm` as in `explore`."""
    xp = namespace(frames.points)
    floors, totals, free = explore(frames, warm)
    if model != "auto":
        return [_solved(frames, free, model, xp.arange(len(frames)), floors, totals, {})]
    bias = _biases_at(frames, floors[:, 0])
    level = xp.zeros_like(floors[:, 0, 0])
    for index, rung in enumerate(RUNGS[:-1]):
        level = xp.where((level == index) & ~(bias[rung] <= SMALL), level + 1.0, level)
    found = []
    for index, rung in enumerate(RUNGS):
        rows = xp.arange(len(frames))[level == index]
        if len(rows):
            found += _climbed(frames, free, rung, rows, floors, totals, bias)
    return found


def _climbed(
    frames: Frames, free: Free, rung: str, rows: Array, floors: Array, totals: Array, bias: dict[str, Array]
) -> list[Solved]:
    """Some frames on their rung, those for which it proves too low on the highest."""
    xp = namespace(rows)
    first = _solved(frames, free, rung, rows, floors[rows], totals[rows], {r: bias[r][rows] for r in bias})
    if rung == REFERENCE:
        return [first]
    low = first.bias[rung] > SMALL
    if not bool(low.any()):
        return [first]
    higher = first.fits.state.unknowns[low]
    again = rows[low]
    costs = xp.zeros_like(totals[again])
    costs[:, 1:] = xp.inf
    floors = xp.concat([higher[:, None], floors[again][:, 1:]], 1)
    second = _solved(frames, free, REFERENCE, again, floors, costs, {r: first.bias[r][low] for r in first.bias})
    return [second] if bool(low.all()) else [picked(first, ~low), second]


def _solved(
    frames: Frames, free: Free, rung: str, rows: Array, floors: Array, totals: Array, bias: dict[str, Array]
) -> Solved:
    """These rows of the frames settled on a rung, in the best of the valleys (B, S, 4) that are worth it."""
    xp = namespace(rows)
    part, free = frames.picked(rows), picked(free, rows)
    fits = settle(part, rung, floors[:, 0])
    rival, rival_distance = xp.full_like(totals[:, 0], xp.inf), floors[:, 0, 0]
    for other in range(1, floors.shape[1]):
        near = xp.isfinite(totals[:, other])
        if bool(near.any()):
            fits, rival, rival_distance = _compared(
                fits, xp.arange(len(rows))[near], floors[near, other], rival, rival_distance
            )
    known = worth(fits)
    above = None if rung == REFERENCE else look(part, REFERENCE, fits.state.unknowns)
    if rung != REFERENCE:
        bias = bias | predicted_bias(fits, known, (rung,))
    return Solved(rows, fits, known, free, evidence(fits, free, above), bias, rival, rival_distance)


def _compared(
    fits: Settled, rows: Array, unknowns: Array, rival: Array, rival_distance: Array
) -> tuple[Settled, Array, Array]:
    """The better of fits and what other floors (B', 4) lead to, and how much more the worse one costs, and where."""
    xp = namespace(rival)
    others = settle(fits.frames.picked(rows), fits.rung, unknowns)
    own, other = fits.plain_cost[rows], others.plain_cost
    mine, theirs = fits.state.unknowns[rows, 0], others.state.unknowns[:, 0]
    apart = (xp.abs(mine - theirs) > SAME) & others.state.converged
    rival, rival_distance = rival + 0.0, rival_distance + 0.0
    rival[rows] = xp.where(apart, xp.abs(own - other), rival[rows])
    rival_distance[rows] = xp.where(other < own, mine, theirs)
    better = apart & (other < own)
    if bool(better.any()):
        state = written(fits.state, rows[better], picked(others.state, better))
        table = written(fits.table, rows[better], picked(others.table, better))
        fits = evaluated(fits.frames, fits.rung, table, state)
    return fits, rival, rival_distance


def _biases_at(frames: Frames, unknowns: Array) -> dict[str, Array]:
    """Every rung's predicted bias (B,) at rough unknowns (B, 4)."""
    view = look(frames, EXPLORER, unknowns)
    table = rig_table(frames, EXPLORER, unknowns, view)
    rough = evaluated(frames, EXPLORER, table, begin(frames, view, unknowns))
    return predicted_bias(rough, worth(rough))
