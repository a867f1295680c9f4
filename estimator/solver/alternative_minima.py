"""Other contacts that explain the same frame: searched, compared, and remembered."""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.compiled import compiled

from .convergence import coarse_minimum, converge, empty_work
from .fit import CONVERGED, INNER, LAST, NODES, copy_fit
from .initialization import GRID, start_at
from .linear_algebra import put
from .normal_equations import unscaled_cost
from .prediction import ELASTICA
from .rig_arrays import UNKNOWNS, tip_deflection

_SAME_DISTANCE, _SAME_FORCE = 1e-2, 0.05
"""Contacts closer than this, in antenna lengths and in parts of the force, are taken for the same."""
_MIRRORED = (-2.0, -1.0)
"""Parts of the force along the line of sight that lead to the mirror image, and to the least force."""
_LARGE_DEFLECTIONS = (0.1, 0.3, -0.1, -0.3)
"""Deflections of the tip along the line of sight, in antenna lengths, from which other contacts are searched."""
_LARGEST_ERROR = 0.005, 30.0, 6.0
"""Of a point: parts of the antenna's length, deviations of its own, and of the rig's errors there."""
_NEAR, _BEYOND = 0.4, 0.15
"""So many points are near the antenna by chance at most, or where it cannot reach by mistake."""
_APART, _FIRST, _GO_ON, _MORE = 6, 5, 3, 15
"""A search for whatever is near begins at every sixth distance of the grid; iterations of each; how many of them go on,
and for how many more."""
_DISTINGUISHABLE = 5.0
"""Moments that differ by fewer deviations do not distinguish a contact from its mirror image."""


@compiled
def try_start(rig, frame, rung, start, best, other, other_cost, work):
    """Fit a frame from another start (4,): the better fit is kept, the next best remembered if it is different.

    best : the fit so far, replaced by a better one. other : (4,) unknowns of the next best, other_cost : (1,).
    """
    found = work.found
    put(start, found.unknowns)
    converge(rig, frame, rung, found, work, False)
    own, cost = unscaled_cost(rig, best), unscaled_cost(rig, found)
    mine, theirs = best.numbers[CONVERGED] > 0.0, found.numbers[CONVERGED] > 0.0
    better = theirs and (cost < own or not mine)
    loser = own if better else cost
    if mine and theirs and different(best.unknowns, found.unknowns) and loser < other_cost[0]:
        other_cost[0] = loser
        other[:] = best.unknowns if better else found.unknowns
    if better:
        copy_fit(found, best)


@compiled
def different(first, second):
    """Whether unknowns (4,) are those of different contacts."""
    gap = np.hypot(first[1] - second[1], first[2] - second[2])
    return abs(first[0] - second[0]) > _SAME_DISTANCE or gap > _SAME_FORCE * np.hypot(first[1], first[2])


@compiled
def most_distance(rig, frame, fit, every, shift):
    """Distance, in the ideal picture, that most of every n-th point have at least from the fit's curve, which is
    displaced along its normals (M,); beyond its ends from them."""
    count = (len(frame.u) + every - 1) // every
    size = np.empty(count)
    for k in range(count):
        i = k * every
        node, foot, along = fit.node[i], fit.foot_m[i], 0.0
        across = fit.distance[i] - shift[node] - fit.share[i] * (shift[node + 1] - shift[node])
        if not 0.0 < foot < rig.length_m:
            end = 0 if foot <= 0.0 else LAST
            along = (frame.u[i] - fit.u[end]) * fit.normal_v[end] - (frame.v[i] - fit.v[end]) * fit.normal_u[end]
        size[k] = np.hypot(across, along)
    near = int(_NEAR * count)
    return np.partition(size, near)[near]


@compiled
def beyond_reach(rig, frame):
    """How much further from the clamp than the antenna is long the rays of many of the points pass it at least, in the
    ideal picture."""
    count, x, y, z = len(frame.u), rig.translation_m[0], rig.translation_m[1], rig.translation_m[2]
    further = np.empty(count)
    for i in range(count):
        u, v = frame.u[i], frame.v[i]
        square = (y - z * v) ** 2 + (z * u - x) ** 2 + (x * v - y * u) ** 2
        further[i] = np.sqrt(square / (1.0 + u * u + v * v)) - rig.length_m
    last = count - 1 - int(_BEYOND * count)
    return np.partition(further, last)[last] / np.sqrt(x * x + y * y + z * z)


@compiled
def largest_error(rig, free, every):
    """Distance in the ideal picture by which noise, rig and rung may put points of the antenna off a rough fit of it,
    and in the points' deviations."""
    square, noise, count = 0.0, 0.0, (len(free.precision) + every - 1) // every
    for j in range(NODES):
        for k in range(UNKNOWNS, free.size):
            square += free.columns[j, k] * free.columns[j, k]
    for k in range(count):
        noise += 1.0 / np.sqrt(free.precision[k * every])
    of_length, of_noise, of_rig = _LARGEST_ERROR
    noise /= count
    far = max(of_length * rig.length_m / free.depth[INNER], of_noise * noise, of_rig * np.sqrt(square / NODES))
    return far, far / noise


@compiled
def nearest_shape(exact, lens, frame, grid, start, far, scatter, nearest):
    """How near any contact brings the antenna to most of a frame's points, in the ideal picture; less than `far` is
    near enough. Leaves the unknowns (4,) in `nearest`.

    The search takes a few of the points, which scatter so many times more than their noise, and the rig as if it were
    exactly known: a tenth of a fit's work for each iteration. From the given start it heeds the readings, then the
    picture alone; the best of the starts go on.
    """
    work, still = empty_work(exact, lens, len(frame.u)), np.zeros(NODES)
    fit, count = work.best, 2 + GRID // _APART
    unknowns, starts, lefts = fit.unknowns, np.zeros((count, UNKNOWNS)), np.full(count, np.inf)
    put(start, starts[0])
    # the free antenna
    starts[1, 0] = start[0]
    for k in range(2, count):
        g = (k - 1) * _APART - 1
        start_at(exact, grid, g, g, 0.0, starts[k])
    least = np.inf
    for turn in range(count + _GO_ON):
        k = turn if turn < count else int(np.argmin(lefts))
        put(starts[k], unknowns)
        if turn == 1:
            frame.available = np.zeros(3)
        iterations = _FIRST if turn < count else _MORE
        coarse_minimum(exact, frame, ELASTICA, fit, work, False, scatter, iterations)
        left = most_distance(exact, frame, fit, 1, still)
        put(unknowns, starts[k])
        lefts[k] = left if turn < count else np.inf
        if left < least or turn == 0:
            least = left
            put(unknowns, nearest)
        if least <= far:
            break
    return least


@compiled
def mirror_ambiguous(rig, frame, fit):
    """Whether the moments do not distinguish the contact from its mirror image.

    The mirror is the plane through the antenna's x axis across the line of sight: small deflections before and behind
    it look alike, but for perspective.
    """
    along = fit.unknowns[1] * rig.to_camera[0] + fit.unknowns[2] * rig.to_camera[1]
    for about in range(2):
        # the sensor about y responds to f_z, the one about z to f_y
        response = rig.force_unit_N * rig.length_m * fit.unknowns[0] * rig.gain[about] / rig.std[about]
        variance = 1.0  # noise and calibration
        for k in range(len(fit.steps)):
            variance += fit.reading_columns[about, 4 + k] ** 2
        change = abs(2.0 * response * along * rig.to_camera[1 - about]) * frame.available[about] / np.sqrt(variance)
        if not change < _DISTINGUISHABLE:
            return False
    return True


@compiled
def try_mirrors(rig, frame, rung, unknowns, best, other, other_cost, work):
    """Fit from contacts that may look like these unknowns (4,): the mirror image, the least force that the picture asks
    for, and forces that bend the antenna far before and behind the mirror."""
    along = unknowns[1] * rig.to_camera[0] + unknowns[2] * rig.to_camera[1]
    sway = tip_deflection(rig, unknowns[0])
    start = unknowns.copy()
    for part in _MIRRORED:
        for axis in range(2):
            start[1 + axis] = unknowns[1 + axis] + part * along * rig.to_camera[axis]
        try_start(rig, frame, rung, start, best, other, other_cost, work)
    for large in _LARGE_DEFLECTIONS:
        for axis in range(2):
            start[1 + axis] = unknowns[1 + axis] + (large / sway - along) * rig.to_camera[axis]
        try_start(rig, frame, rung, start, best, other, other_cost, work)
