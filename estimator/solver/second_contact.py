"""Is there a second contact? What another force elsewhere would still explain."""

from __future__ import annotations

from vbaa_calib.antenna.linear import deflection
from vbaa_calib.antenna.nodes import aligned_arclength
from vbaa_calib.core.arrays import Array, counted, like, namespace, places
from vbaa_calib.core.robust import MAD_SCALE, huber_weights

from .normal_equations import Problem, solved, solved_columns
from .prediction import by_point
from .state import Settled, evaluated, picked
from .uncertainty import REFERENCE, Worth

GRID = 16
"""Places tried for another force, evenly over the antenna."""
BLOCKS, STRUCTURE = 8, 22.0
"""Stretches of the antenna over which misfits are summed; χ² of these beyond which a second force is looked for: one
frame of noise in 200."""
DEPENDENT = 1e-4
"""A force whose deflection the first contact and the rig can make up for to this part, in squares, holds nothing."""


def second_force(fits: Settled, about: Problem, known: Worth) -> tuple[Array, Array, Array]:
    """What the best second force would do to B frames.

    Parameters
    ----------
    about : the problem with the residuals of the highest rung, whose shapes are right.

    Returns
    -------
    gain, place, harm : (B,) how much of the cost it takes away, at the scatter that neighbouring points have; where it
        acts, in antenna lengths; how far the first contact's distance would move, in standard deviations. 0 where the
        misfit has no structure.
    """
    xp = namespace(about.scatter)
    none = xp.zeros_like(about.scatter)
    structured = (structure(about) > STRUCTURE) | (about.scatter > 1.0)
    if not bool(structured.any()):
        return none, none, none
    rows = places(structured)
    part = picked(fits, rows)
    if fits.rung != REFERENCE:
        part = evaluated(part.frames, REFERENCE, part.table, part.state)
    found = []
    for values in _best_second(part, picked(known, rows)):
        whole = none + 0.0
        whole[rows] = values
        found.append(whole)
    return found[0], found[1], found[2]


def structure(about: Problem) -> Array:
    """(B,) sum of squares of the misfits' means over `BLOCKS` stretches of the antenna, in their deviations: χ², at the
    scatter that neighbours have, if the misfit is but noise."""
    xp = namespace(about.scatter)
    whitened = about.whitened(about.found.distance)
    summed = about.weighed(about.found.distance, whitened)
    # the hat functions of the nodes add up to one, so that a row's sum is the weight that lies on its node
    weight = summed.diagonal + 0.0
    weight[:, :-1] += summed.beside
    weight[:, 1:] += summed.beside
    width = weight.shape[1] // BLOCKS
    load, held = (v[:, -BLOCKS * width :].reshape(-1, BLOCKS, width).sum(-1) for v in (summed.load, weight))
    return (load * load / xp.clip(held, 1e-30, None)).sum(-1)


def _best_second(fits: Settled, known: Worth) -> tuple[Array, Array, Array]:
    """Gain, place and harm (B,) of the best second force, by its small deflection, with all that contact, friction and
    rig can do about it taken out: a score test."""
    about = fits.problem
    xp, frame = namespace(about.scatter), fits.frames.known
    places = like(about.scatter, [(g + 1.0) / GRID for g in range(GRID)])
    along = aligned_arclength(xp.clip(fits.view.contact_m / frame.length_m, None, 1.0 - 1e-6), 1.0)
    # scaled to a metre at the tip
    bent = deflection(along[..., None], places, 6.0, 1.0) / (places * places * (3.0 - places))
    lever = 6.0 * xp.exp(frame.parameters[6]) / (places * (3.0 - places) * frame.length_m**2)
    felt = frame.felt_by(lever).reshape(2, -1) * fits.frames.felt[..., None]
    columns = (bent[..., None] * by_point(frame, fits.view)[:, :, None, 1:]).reshape(*along.shape, 2 * GRID)
    summed = about.summed
    towards = summed.times(columns)
    held = huber_weights(about.misfit)[..., None]
    crossed = about.columns.mT @ towards + about.felt.mT @ (held * felt)
    # what is left for a second force once the first contact and the rig have made the most of it
    misfit, load = held * about.misfit[..., None], summed.load[..., None]
    here = fits.equations
    best = solved(here.information, here.pull)
    pull = (columns.mT @ load + felt.mT @ misfit - crossed.mT @ best[..., None])[..., 0]
    taken = solved_columns(here.information, crossed)
    own = _pairs(columns, towards) + _pairs(felt, held * felt)
    force, gain = _best_force(own, _pairs(crossed, taken), pull)
    every, best_place = counted(gain, len(gain)), xp.argmax(gain, -1)
    force = force[every, best_place]
    moved = sum(force[:, axis] * taken[every, 0, 2 * best_place + axis] for axis in (0, 1))
    harm = xp.abs(moved) / known.std[:, 0]
    louder = (about.scatter / _neighbour_scatter(about)) ** 2
    return gain[every, best_place] * louder, places[best_place], harm


def _pairs(first: Array, second: Array) -> Array:
    """(B, G, 3) inner products yy, yz, zz of columns (B, M, 2G), place by place."""
    xp = namespace(first)
    axes = ((0, 0), (0, 1), (1, 1))
    return xp.stack([(first[..., a::2] * second[..., b::2]).sum(1) for a, b in axes], -1)


def _best_force(own: Array, taken: Array, pull: Array) -> tuple[Array, Array]:
    """The best force (B, G, 2) at each place, in its columns' units, and what it takes off the cost (B, G).

    `own` (B, G, 3) is its information, `taken` (B, G, 3) what contact and rig take of it.
    """
    xp = namespace(pull)
    yy, yz, zz = ((own - taken)[..., index] for index in range(3))
    y, z = pull[:, 0::2], pull[:, 1::2]
    # directions along the line of sight, and what the first contact does as well, hold nothing
    floor = DEPENDENT * (own[..., 0] + own[..., 2]) + 1e-30
    middle, half = 0.5 * (yy + zz), xp.hypot(0.5 * (yy - zz), yz)
    angle = 0.5 * xp.atan2(yz, 0.5 * (yy - zz))
    cos, sin = xp.cos(angle), xp.sin(angle)
    major = xp.where(middle + half > floor, (cos * y + sin * z) / xp.clip(middle + half, 1e-300, None), 0.0)
    minor = xp.where(middle - half > floor, (cos * z - sin * y) / xp.clip(middle - half, 1e-300, None), 0.0)
    gain = 0.5 * (major * (cos * y + sin * z) + minor * (cos * z - sin * y))
    return xp.stack([cos * major - sin * minor, sin * major + cos * minor], -1), gain


def _neighbour_scatter(about: Problem) -> Array:
    """(B,) factor on the points' deviations by which neighbours along the antenna differ, at least 1.

    A second contact leaves a smooth misfit: the scatter about the fit would take it for noise.
    """
    xp = namespace(about.scatter)
    seen = about.found.precision > 0.0
    order = xp.argsort(xp.where(seen, about.found.foot_m, xp.inf), -1)
    every = counted(seen, len(seen))[:, None]
    ordered = (about.found.distance * xp.sqrt(about.found.precision))[every, order]
    gap = xp.where(seen[every, order][:, 1:], xp.abs(ordered[:, 1:] - ordered[:, :-1]), xp.inf)
    middle = xp.clip(seen.sum(-1) - 1, 1, None) // 2
    median = gap[every[:, 0], xp.argsort(gap, -1)[every[:, 0], middle]]
    return xp.clip(MAD_SCALE / 2.0**0.5 * xp.where(xp.isfinite(median), median, 1.0), 1.0, None)
