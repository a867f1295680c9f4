"""Second derivatives of points by least-squares parabolas over neighbouring frames, whenever these were taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.arrays import Array, as_index, like, namespace

MOST = 64
"""At most so many frames on either side count: what a judge of a recording must remember is bounded."""
PATH, TESTED = 4, 7
"""Degree of the path about which points should scatter as they are said to, and the fewest frames that can test it."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """For each of R judged frames W others near to it in time, itself among them, out of n.

    Attributes
    ----------
    centre, at : (R,) index of the judged frame, (R, W) of its neighbours.
    after_s : (R, W) their time from the judged frame.
    inside : (R, W) which of them count.
    enough : (R,) whether that is enough for a parabola about the judged frame.
    """

    centre: Array
    at: Array
    after_s: Array
    inside: Array
    enough: Array


def neighbours(time_s: Array, judged: Array, reach_s: Array, longest_s: float, *, live: bool = False) -> Neighbours:
    """The frames around each judged one.

    Parameters
    ----------
    time_s : (n,)
    judged : (R,) indices.
    reach_s : (R,) how far from a judged frame others may be; the next on either side counts in any case.
    longest_s : a longer gap between two frames, or none at all, ends the neighbourhood.
    live : only earlier frames count, the last two in any case.
    """
    xp = namespace(time_s)
    gap = time_s[1:] - time_s[:-1]
    broken = like(time_s, ~((gap > 0.0) & (gap <= longest_s)))
    # frames that share a number have no wrong gap between them
    run = xp.cumsum(xp.concat([like(time_s, np.zeros(1)), broken]), 0)
    least = 2 if live else 1
    offsets = like(time_s, np.arange(-MOST, 1 if live else MOST + 1))
    place = like(time_s, judged)[:, None] + offsets
    at = as_index(xp.clip(place, 0.0, len(time_s) - 1.0))
    after = time_s[at] - time_s[judged][:, None]
    near = (abs(after) <= reach_s[:, None]) | (abs(offsets) <= least)
    inside = near & (run[at] == run[judged][:, None]) & (place == at)
    enough = inside[:, MOST - least : MOST + 1 if live else MOST + 2].all(-1)
    used = inside.any(0) | (offsets == 0.0)
    return Neighbours(judged, at[:, used], after[:, used], inside[:, used], enough)


def second_derivative(near: Neighbours, points: Array, std: Array) -> tuple[Array, Array, Array]:
    """Second derivatives (R, G, 3) of points (n, G, 3), their standard deviations (R, G, 3) and weights (R, W).

    `std` (n, 1) or (n, G) is that of one component of a point. Where there are `TESTED` frames or more, and the points
    scatter about a smooth path by more, the result's grows by as much; it never shrinks. NaN where there is not enough.
    """
    xp = namespace(points)
    unit, by_last, tested = _orthonormal(near)
    start = points[near.centre]
    parts = [0.0 * start] * (PATH + 1)
    squares, variance = 0.0 * start, 0.0 * std[near.centre]
    expected = variance
    for column in range(unit.shape[-1]):
        counts = like(points, near.inside[:, column])[:, None]
        moved = (points[near.at[:, column]] - start) * counts[..., None]
        parts = [part + unit[:, power, column, None, None] * moved for power, part in enumerate(parts)]
        squares = squares + moved**2
        own = std[near.at[:, column]] ** 2
        variance = variance + unit[:, 2, column, None] ** 2 * own
        expected = expected + counts * own
    count = like(points, near.inside).sum(-1)[:, None]
    spare = xp.where(tested[:, None], expected * (count - PATH - 1.0) / count, np.inf)
    scatter = (squares - sum(part**2 for part in parts)) / spare[..., None]
    std = xp.sqrt(variance[..., None] * xp.clip(scatter, 1.0, None))
    scale = xp.where(near.enough, by_last, np.nan)
    return scale[:, None, None] * parts[2], scale[:, None, None] * std, scale[:, None] * unit[:, 2]


def _orthonormal(near: Neighbours) -> tuple[Array, Array, Array]:
    """Polynomials (R, PATH + 1, W) of rising degree, orthonormal over each neighbourhood.

    Also the quadratic one's second derivative (R,), and which neighbourhoods have frames enough for those beyond it.
    """
    xp = namespace(near.after_s)
    counts = like(near.after_s, near.inside & near.enough[:, None])
    tested = counts.sum(-1) >= TESTED
    reach = xp.where(near.enough, xp.amax(abs(near.after_s) * counts, -1), 1.0)
    tau = near.after_s / reach[:, None]
    usable = xp.stack([near.enough] * 3 + [tested] * (PATH - 2), -1)
    powers = xp.stack([counts * tau**power for power in range(PATH + 1)], -2) * like(tau, usable)[..., None]
    # a unit in place of each one that there is not enough for
    gram = xp.einsum("riw,rjw->rij", powers, powers) + like(tau, ~usable)[..., None] * like(tau, np.eye(PATH + 1))
    lower = xp.linalg.cholesky(gram)
    return xp.linalg.solve(lower, powers), 2.0 / (reach**2 * lower[:, 2, 2]), tested
