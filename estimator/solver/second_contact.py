"""Is there a second contact? A score test: what another force elsewhere would still explain."""

from __future__ import annotations

from vbaa_calib.antenna.linear import deflection
from vbaa_calib.antenna.nodes import aligned_arclength
from vbaa_calib.core.arrays import Array, arange_like, like, namespace, true_indices
from vbaa_calib.core.robust import MAD_SCALE, huber_weights

from .normal_equations import Problem, solve_columns, solve_normal_equations
from .prediction import point_jacobian, reading_response
from .rows import select
from .state import Fits, evaluate
from .uncertainty import REFERENCE, Uncertainty

_GRID = 16
"""Places of the other force, evenly over the antenna."""
_BLOCKS, _STRUCTURE = 8, 22.0
"""Stretches of the antenna over which residuals are summed, and the χ² of the sums beyond which a second force is
searched: one frame of noise in 200."""
_DEPENDENT = 1e-4
"""A force counts for nothing if the first contact and the rig explain all but this part of its deflection's square."""


def second_force(fits: Fits, problem: Problem, uncertainty: Uncertainty) -> tuple[Array, Array, Array]:
    """What the best second force would do to B frames.

    Parameters
    ----------
    problem : with the residuals of the highest rung, whose shapes are right.

    Returns
    -------
    gain, place, shift : (B,) how much it lowers the cost, at the scatter that neighbouring points have; where it acts,
        in antenna lengths; how far the first contact's distance would move, in standard deviations. 0 where the
        residuals have no structure.
    """
    xp = namespace(problem.scatter)
    none = xp.zeros_like(problem.scatter)
    structured = (_structure(problem) > _STRUCTURE) | (problem.scatter > 1.0)
    if not bool(structured.any()):
        return none, none, none
    rows = true_indices(structured)
    part = select(fits, rows)
    if fits.rung != REFERENCE:
        part = evaluate(part.frames, REFERENCE, part.by_rig, part.state)
    whole = none + 0.0, none + 0.0, none + 0.0
    for target, values in zip(whole, _score_test(part, select(uncertainty, rows)), strict=True):
        target[rows] = values
    return whole


def _structure(problem: Problem) -> Array:
    """(B,) sum of squares of the residuals' means over `_BLOCKS` stretches, in their deviations: χ² if all is noise."""
    xp = namespace(problem.scatter)
    sums = problem.sums
    # the nodes' hat functions add up to one, so that a row's sum is the weight of its node
    weight = sums.diagonal + 0.0
    weight[:, :-1] += sums.off_diagonal
    weight[:, 1:] += sums.off_diagonal
    width = weight.shape[1] // _BLOCKS
    load, total = (v[:, -_BLOCKS * width :].reshape(-1, _BLOCKS, width).sum(-1) for v in (sums.load, weight))
    return (load * load / xp.clip(total, 1e-30, None)).sum(-1)


def _score_test(fits: Fits, uncertainty: Uncertainty) -> tuple[Array, Array, Array]:
    """Gain, place and shift (B,) of the best second force, by its small deflection, with all that contact, friction and
    rig can do about it projected out."""
    problem, equations = fits.problem, fits.equations
    xp, rig_arrays = namespace(problem.scatter), fits.frames.rig_arrays
    places = like(problem.scatter, [(g + 1.0) / _GRID for g in range(_GRID)])
    along = aligned_arclength(xp.clip(fits.prediction.contact_m / rig_arrays.length_m, None, 1.0 - 1e-6), 1.0)
    # scaled to a metre at the tip
    bent = deflection(along[..., None], places, 6.0, 1.0) / (places * places * (3.0 - places))
    lever = 6.0 * xp.exp(rig_arrays.antenna_parameters[6]) / (places * (3.0 - places) * rig_arrays.length_m**2)
    moment = reading_response(fits.frames, fits.prediction, lever, bent[:, -1])
    image = point_jacobian(rig_arrays, fits.prediction)[:, :, None, 1:]
    columns = (bent[..., None] * image).reshape(*along.shape, 2 * _GRID)
    sums = problem.sums
    weighted = sums.times(columns)
    weights = huber_weights(problem.reading_residual)[..., None]
    crossed = problem.jacobian.mT @ weighted + problem.reading_jacobian.mT @ (weights * moment)
    # what is left for a second force once the first contact and the rig have made the most of it
    residual, load = weights * problem.reading_residual[..., None], sums.load[..., None]
    best = solve_normal_equations(equations.information, equations.right_side)
    right_side = (columns.mT @ load + moment.mT @ residual - crossed.mT @ best[..., None])[..., 0]
    explained = solve_columns(equations.information, crossed)
    own = _inner_products(columns, weighted) + _inner_products(moment, weights * moment)
    force, gain = _best_force(own, _inner_products(crossed, explained), right_side)
    every, best_place = arange_like(gain, len(gain)), xp.argmax(gain, -1)
    force = force[every, best_place]
    moved = sum(force[:, axis] * explained[every, 0, 2 * best_place + axis] for axis in (0, 1))
    shift = xp.abs(moved) / uncertainty.std[:, 0]
    rescaled = (problem.scatter / _neighbour_scatter(problem)) ** 2
    return gain[every, best_place] * rescaled, places[best_place], shift


def _inner_products(first: Array, second: Array) -> Array:
    """(B, G, 3) inner products yy, yz, zz of columns (B, M, 2G), place by place."""
    pairs = [(first[..., a::2] * second[..., b::2]).sum(1) for a, b in ((0, 0), (0, 1), (1, 1))]
    return namespace(first).stack(pairs, -1)


def _best_force(own: Array, explained: Array, right_side: Array) -> tuple[Array, Array]:
    """The best force (B, G, 2) at each place, in its columns' units, and how much it lowers the cost (B, G).

    `own` (B, G, 3) is its information, `explained` (B, G, 3) what contact and rig take of it.
    """
    xp = namespace(right_side)
    yy, yz, zz = ((own - explained)[..., index] for index in range(3))
    y, z = right_side[:, 0::2], right_side[:, 1::2]
    least = _DEPENDENT * (own[..., 0] + own[..., 2]) + 1e-30
    middle, half = 0.5 * (yy + zz), xp.hypot(0.5 * (yy - zz), yz)
    angle = 0.5 * xp.atan2(yz, 0.5 * (yy - zz))
    cos, sin = xp.cos(angle), xp.sin(angle)
    major = xp.where(middle + half > least, (cos * y + sin * z) / xp.clip(middle + half, 1e-300, None), 0.0)
    minor = xp.where(middle - half > least, (cos * z - sin * y) / xp.clip(middle - half, 1e-300, None), 0.0)
    gain = 0.5 * (major * (cos * y + sin * z) + minor * (cos * z - sin * y))
    return xp.stack([cos * major - sin * minor, sin * major + cos * minor], -1), gain


def _neighbour_scatter(problem: Problem) -> Array:
    """(B,) factor on the points' deviations by which neighbours along the antenna differ, at least 1.

    A second contact leaves smooth residuals: the scatter about the fit would take them for noise.
    """
    xp = namespace(problem.scatter)
    points = problem.points
    seen = points.precision > 0.0
    order = xp.argsort(xp.where(seen, points.foot_m, xp.inf), -1)
    every = arange_like(seen, len(seen))[:, None]
    ordered = (points.distance * xp.sqrt(points.precision))[every, order]
    gap = xp.where(seen[every, order][:, 1:], xp.abs(ordered[:, 1:] - ordered[:, :-1]), xp.inf)
    middle = xp.clip(seen.sum(-1) - 1, 1, None) // 2
    median = gap[every[:, 0], xp.argsort(gap, -1)[every[:, 0], middle]]
    return xp.clip(MAD_SCALE / 2.0**0.5 * xp.where(xp.isfinite(median), median, 1.0), 1.0, None)
