"""From frames to fits: which valley, which rung of the ladder, and what else would explain them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import Array, counted, namespace, places

from .alternative_minima import Best, different, one_sided, other_sides
from .convergence import explored, polished, settle
from .frames import Frames
from .initialization import Free, Trials, free_antenna, tried
from .prediction import LEANING, look
from .second_contact import second_force
from .state import Settled, picked
from .uncertainty import REFERENCE, Worth, evidence, held_against, misled, predicted_bias, stretched, worth

EXPLORER = "linear"
"""The rung on which valleys are told apart."""
USUAL = "elastica"
"""The rung that most scenes need: on it `auto` finds out which one is."""
STARTS = 2
EXPLORED = 64
"""About so many points of a frame are enough to find its valleys."""
WIDE, WIDE_ITERATIONS = 4, 15
"""Frames that are lost are looked for from every fourth distance of the grid, with so many steps each."""
LOST = 2.0
"""A median misfit of so many deviations is a reason to look elsewhere."""
LEANT = 2.5
"""So is a force that leans by so many of the deviations that were thought possible."""
FAINT = 5.0
"""Where no distance explains more of the cost than this there is no contact, and which of several valleys would be the
deepest does not matter: evidence for one begins at three times as much."""
TOUCHED = 3.0
"""Without a force of so many deviations in any direction there is no contact whose mirror image would matter."""
SMALL = 1 / 3
"""A rung's predicted bias is small when it is below this fraction of the standard deviation."""
DOUBTED = SMALL
"""Where a demanded rung's bias is not, it is part of the deviations."""


@dataclass(frozen=True, eq=False)
class Solved:
    """Frames on one rung, and what belongs to them.

    Attributes
    ----------
    rows : (B,) their places among all that were asked for.
    evidence : (B,) for a contact, see `worth.evidence`.
    bias : rung → (B,) its predicted bias in standard deviations; of rungs that were looked at.
    rival : (B,) how much more another valley costs; infinite without one. rival_unknowns : (B, 4) where it lies.
    blind : (B,) bool, no reading tells the contact from its mirror image, see `rivals.one_sided`.
    second, second_place, second_harm : (B,) see `second.second_force`.
    misled : (B, 2, 10) see `worth.misled`; 0 where the rung's bias is small.
    """

    rows: Array
    fits: Settled
    worth: Worth
    free: Free
    evidence: Array
    bias: dict[str, Array]
    rival: Array
    rival_unknowns: Array
    blind: Array
    second: Array
    second_place: Array
    second_harm: Array
    misled: Array


@dataclass(frozen=True, eq=False)
class Ground:
    """What is known of B frames before a rung is chosen.

    Attributes
    ----------
    floors, costs : (B, S, 4) rough floors, lowest first, and their costs (B, S), infinite where there is none.
    """

    free: Free
    trials: Trials
    floors: Array
    costs: Array

    def below(self, found: Solved) -> Ground:
        """The same with the floors, the best and its rival, that were found on a rung."""
        xp, unknowns = namespace(self.costs), found.fits.state.unknowns
        floors = xp.stack([unknowns, found.rival_unknowns], 1)
        return replace(self, floors=floors, costs=xp.stack([xp.zeros_like(found.rival), found.rival], -1))


def explore(frames: Frames, warm: Array | None = None, descended: bool = False) -> Ground:
    """The valleys of each frame. `warm` (B, 4), unknowns near the truth where finite, may take their place.

    Frames with several are descended on a low rung, to see which of them are worth it; on demand, all are.
    """
    xp = namespace(frames.points)
    free = free_antenna(frames, REFERENCE)
    few, kept = frames.thinned(EXPLORED)
    found = free.found.thinned(kept)
    trials = tried(few, free, found)
    starts, costs = trials.lowest(STARTS)
    if warm is not None:
        starts, costs = trials.warmed(starts, costs, warm)
    several = places(xp.isfinite(costs[:, -1]) | descended)
    if len(several):
        part = few.picked(several), EXPLORER, starts[several], costs[several], found.foot_m[several]
        starts[several], costs[several] = explored(*part)
    return Ground(free, trials, starts, costs)


def solve(frames: Frames, model: str, warm: Array | None = None) -> list[Solved]:
    """Fit B frames; frames on the same rung come together. `warm` as in `explore`."""
    xp = namespace(frames.points)
    ground, every = explore(frames, warm), counted(frames.points, len(frames))
    if model != "auto":
        return [_solved(frames, ground, model, every, (model,))]
    first = _solved(frames, ground, USUAL, every, RUNGS)
    bias, level = first.bias, xp.zeros_like(ground.costs[:, 0])
    for index, rung in enumerate(RUNGS[:-1]):
        level = xp.where((level == index) & ~(bias[rung] <= SMALL), level + 1.0, level)
    ground = ground.below(first)
    found = []
    for index, rung in enumerate(RUNGS):
        rows = places(level == index)
        if rung == USUAL and len(rows):
            found.append(first if len(rows) == len(frames) else picked(first, rows))
        elif len(rows):
            found += _climbed(frames, ground, rung, rows, bias)
    return found


def _climbed(frames: Frames, ground: Ground, rung: str, rows: Array, bias: dict[str, Array]) -> list[Solved]:
    """Some frames on their rung, those for which it proves too low on a higher one."""
    first = _solved(frames, ground, rung, rows, (rung,), {each: bias[each][rows] for each in bias})
    low = ~(first.bias[rung] <= SMALL)
    if rung == REFERENCE or not bool(low.any()):
        return [first]
    above = RUNGS[RUNGS.index(rung) + 1]
    higher = _climbed(frames, ground, above, rows[low], bias | _told(bias, rows[low], first.bias[rung][low], rung))
    return higher if bool(low.all()) else [picked(first, ~low), *higher]


def _told(bias: dict[str, Array], rows: Array, found: Array, rung: str) -> dict[str, Array]:
    """A rung's bias (B,) of all frames with what was found of some of them."""
    told = bias[rung] + 0.0
    told[rows] = found
    return {rung: told}


def _solved(
    frames: Frames,
    ground: Ground,
    rung: str,
    rows: Array,
    weighed: tuple[str, ...],
    bias: Mapping[str, Array] = MappingProxyType({}),
) -> Solved:
    """These rows of the frames settled on a rung, in the best of the valleys that are worth it.

    `bias` is what was found already, `weighed` the rungs whose bias is asked for.
    """
    xp = namespace(rows)
    part, here = frames, ground
    if len(rows) < len(frames):
        part, here = frames.picked(rows), picked(ground, rows)
    telling = xp.amax(here.trials.gains, -1) > FAINT
    best = Best.of(settle(part, rung, here.floors[:, 0], here.free.found.foot_m))
    for other in range(1, here.floors.shape[1]):
        best = best.beside(xp.isfinite(here.costs[:, other]) & telling, here.floors[:, other])
    best = _found_again(part, rung, here, best, telling)
    best = replace(best, fits=polished(best.fits))
    known = worth(best.fits)
    unknowns = best.fits.state.unknowns
    blind = _touched(unknowns, known) & one_sided(part, unknowns, best.fits.table)
    if bool(blind.any()):
        best = best.beside(blind, *other_sides(part, unknowns))
        # what turned out better has sides of its own
        turned = blind & different(unknowns, best.fits.state.unknowns)
        best = best.beside(turned, *other_sides(part, best.fits.state.unknowns))
        known = stretched(best.fits, worth(best.fits), blind)
    fits = best.fits
    about, told = fits.problem, dict(bias)
    touch = xp.concat([fits.state.unknowns, fits.view.touch], -1)
    off = xp.stack([xp.zeros_like(touch)] * 2, 1)
    if rung != REFERENCE:
        reference = look(part, REFERENCE, fits.state.unknowns, slopes=False)
        about = held_against(fits, reference)
        told |= predicted_bias(fits, known, reference, weighed)
        large = (told[rung] > DOUBTED) & xp.isfinite(told[rung])
        if bool(large.any()):
            off = xp.where(large[:, None, None], misled(fits, reference), off)
    contact = evidence(fits, about, here.free)
    others = best.rival, best.rival_unknowns, blind, *second_force(fits, about, known), off
    return Solved(rows, fits, known, here.free, contact, told, *others)


def _touched(unknowns: Array, known: Worth) -> Array:
    """(B,) whether the force stands out of its uncertainty in some direction across the antenna."""
    first, second = unknowns[:, 1], unknowns[:, 2]
    own, cross, other = known.covariance[:, 1, 1], known.covariance[:, 1, 2], known.covariance[:, 2, 2]
    apart = other * first**2 - 2.0 * cross * first * second + own * second**2
    return apart > TOUCHED**2 * (own * other - cross**2)


def _found_again(frames: Frames, rung: str, ground: Ground, best: Best, telling: Array) -> Best:
    """Frames that are lost looked for anew: with feet from nothing, then from all over the antenna."""
    again = best.beside(_lost(best) & telling, best.fits.state.unknowns)
    lost = _lost(again) & telling
    if not bool(lost.any()):
        return again
    starts, costs = picked(ground.trials, lost).spread(WIDE)
    leaning = rung if rung in LEANING else LEANING[0]
    floors = ground.floors[:, 0] + 0.0
    floors[lost] = explored(frames.picked(lost), leaning, starts, costs, iterations=WIDE_ITERATIONS)[0][:, 0]
    return again.beside(lost, floors)


def _lost(best: Best) -> Array:
    state = best.fits.state
    return ~state.converged | (state.scatter > LOST) | (abs(state.unknowns[:, 3]) > LEANT)
