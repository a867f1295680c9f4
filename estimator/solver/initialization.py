"""Where to begin: for each distance on a grid, the best force and the cost it explains, for small deflections."""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.nodes import aligned_arclength
from vbaa_calib.core.compiled import compiled, record
from vbaa_calib.core.lanes import LANES, lane_of, load_from, spread, store_to

from .fit import LAST, NODES, SCATTER
from .linear_algebra import factorise, fill, inner_products, put, solve_many
from .normal_equations import (
    feet_along_chord,
    huber_weight,
    point_residuals,
    shift_by_steps,
    times_tridiagonal,
)
from .prediction import LINEAR, REFERENCE, point_jacobian, predict
from .rig_arrays import TIP_DEFLECTION_STD, UNKNOWNS, tip_deflection
from .rig_jacobian import rig_jacobian

GRID = 3 * LANES
"""Distances, evenly from `_NEAREST` to the tip."""
_NEAREST = 0.05
_ROUNDS = 2
"""Reweightings of the points by the residuals of the best distance."""
_WARM_COST = 8.0
"""A start from the frame before is taken unless another distance explains the frame better by so much."""
_FREE = 0.5
"""The free antenna is a contact here without a force: it only places the nodes."""
STARTS = 2
"""Minima that are searched for each frame."""
_LARGEST_LOAD = 3.0
"""F·l²/EI of a start: where the antenna is bent far, small deflections ask for a force many times too large."""
_ALONG = aligned_arclength(np.array([_FREE]), 1.0)[0]
_DISTANCES = _NEAREST + (1.0 - _NEAREST) * np.arange(GRID) / (GRID - 1)
_NEAR, _FAR = np.minimum(_ALONG[:, None], _DISTANCES), np.maximum(_ALONG[:, None], _DISTANCES)
_BENT = (3.0 * _FAR - _NEAR) * _NEAR * _NEAR / 6.0
"""(M, GRID) `deflection` of the free antenna's nodes by unit forces at all distances."""


@record
class _Grid:
    """Distances of the grid, what unit forces there do, and what the best forces explain.

    Attributes
    ----------
    distance : (G,) antenna lengths. image : (2, M) the picture's displacement by a unit force along y, and z, per
        `_BENT`. moment : (2, 2, G) sensors' response, by axis.
    force : (G, 2) best forces. gain : (G,) the cost that each explains. best_steps : (R,) of the rig, at the best one.
    weight : (N,) of the points. crossed : (R, 2 G + LANES). along : (2, M) scratch room.
    """

    distance: np.ndarray
    image: np.ndarray
    moment: np.ndarray
    force: np.ndarray
    gain: np.ndarray
    best_steps: np.ndarray
    weight: np.ndarray
    crossed: np.ndarray
    along: np.ndarray


@compiled
def free_antenna(rig, frame, fit, work):
    """The free antenna, with the rig's derivatives for small deflections, and the points' residuals from it."""
    fill(fit.unknowns, 0.0)
    fit.unknowns[0] = _FREE
    fit.numbers[SCATTER] = 1.0
    fill(fit.steps, 0.0)
    predict(rig, frame, REFERENCE, work.bent, fit, False)
    rig_jacobian(rig, frame, LINEAR, work.bent, fit)
    feet_along_chord(rig, frame, fit)
    point_residuals(rig, frame, fit)
    put(fit.predicted_residual, fit.residual)


@compiled
def deflection(along, contact):
    """Deflection of a beam of unit length and stiffness at a place by a unit force at another: Eq. (1), Eq. (2)."""
    near, far = min(along, contact), max(along, contact)
    return (3.0 * far - near) * near * near / 6.0


@compiled
def grid_search(rig, frame, free, every, work):
    """The best force at each distance of the grid, from every n-th of the points' residuals from the free antenna.

    For small deflections the picture is linear in the force once the distance is given, so force and rig are profiled
    out. A force along y or z displaces the picture by one shape for all frames times `point_jacobian` of each frame, so
    that sums over nodes are matrix products with shapes.
    """
    steps, count = len(free.steps), (len(free.distance) + every - 1) // every
    grid = _Grid(
        _DISTANCES.copy(),
        np.empty((2, NODES)),
        np.zeros((2, 2, GRID)),
        np.empty((GRID, 2)),
        np.empty(GRID),
        np.zeros(steps),
        np.empty(count),
        np.empty((steps, 2 * GRID + LANES)),
        np.empty((2, NODES)),
    )
    point_jacobian(rig, free, grid.image)
    unit = rig.unit_load * rig.length_m
    for j in range(NODES):
        grid.image[0, j] *= unit
        grid.image[1, j] *= unit
    for g in range(GRID):
        # the sensor about y feels a force along z, the one about z a force along y
        moment = grid.distance[g] * rig.force_unit_N * rig.length_m
        grid.moment[0, 1, g] = rig.gain[1] / rig.std[1] * moment * frame.available[1]
        grid.moment[1, 0, g] = rig.gain[0] / rig.std[0] * moment * frame.available[0]
    # what is looked up in a record within a loop is looked up again each time
    weights, distances, precisions, nodes, shares = grid.weight, free.distance, free.precision, free.node, free.share
    shift = work.shift
    for i in range(count):
        weights[i] = precisions[i * every]
    for _ in range(_ROUNDS):
        best = _best_forces(rig, free, every, grid, work)
        _shift(free, grid, best, shift)
        for i in range(count):
            node, precision = nodes[i * every], precisions[i * every]
            off = distances[i * every] - shift[node] - shares[i * every] * (shift[node + 1] - shift[node])
            weights[i] = precision * huber_weight(off * np.sqrt(precision))
    return grid


@compiled
def _sums(free, every, weights):
    """Weighted sums of every n-th point over the nodes, into the fit's."""
    diagonal, beside, load, nodes, shares, distances = (
        free.diagonal,
        free.beside,
        free.load,
        free.node,
        free.share,
        free.distance,
    )
    fill(diagonal, 0.0)
    fill(beside, 0.0)
    fill(load, 0.0)
    for i in range(len(weights)):
        node, share, weight = nodes[i * every], shares[i * every], weights[i]
        first = weight * share
        second, pull = first * share, weight * distances[i * every]
        diagonal[node] += weight - 2.0 * first + second
        diagonal[node + 1] += second
        beside[node] += first - second
        load[node] += pull - pull * share
        load[node + 1] += pull * share


@compiled
def _best_forces(rig, free, every, grid, work):
    """Best forces, the cost that each explains, the rig's steps at the best. Returns the best distance's index."""
    _sums(free, every, grid.weight)
    steps, crossed, product, size = len(free.steps), grid.crossed, work.product, free.size
    # the unknowns' own columns, which are not used, come along
    times_tridiagonal(free, free.columns, product)
    inner_products(free.columns, product, free.information)
    for a in range(UNKNOWNS, size):
        _cross(free, grid, product, a)
    # moments only: where the antenna ends may be wrong
    for a in range(UNKNOWNS, size):
        free.information[a, a] += 1.0
        for b in range(UNKNOWNS, a + 1):
            for reading in range(2):
                by_both = free.reading_columns[reading, a] * free.reading_columns[reading, b]
                free.information[a, b] += by_both
            free.information[b, a] = free.information[a, b]
    factorise(free.information, UNKNOWNS, steps, 0.0, work.factor, work.scale)
    solve_many(work.factor, work.scale, steps, crossed, False)
    _every_force(rig, free, grid)
    best = 0
    for g in range(GRID):
        if grid.gain[g] > grid.gain[best] or grid.gain[best] != grid.gain[best]:
            best = g
    _rig_steps(grid, best, steps, work)
    return best


@compiled
def _cross(free, grid, product, a):
    """What the rig's column a has in common with unit forces along y and z at all distances, and with the residuals."""
    readings, columns, load, image, moment = free.reading_columns, free.columns, free.load, grid.image, grid.moment
    rest = readings[0, a] * free.residual[0] + readings[1, a] * free.residual[1]
    y, z = grid.along[0], grid.along[1]
    for j in range(NODES):
        rest += columns[j, a] * load[j]
        y[j], z[j] = product[j, a] * image[0, j], product[j, a] * image[1, j]
    crossed, row = grid.crossed, a - UNKNOWNS
    by_y, by_z = readings[1, a], readings[0, a]
    # six sums side by side: one alone would wait for itself
    first_y, second_y, third_y = spread(0.0), spread(0.0), spread(0.0)
    first_z, second_z, third_z = spread(0.0), spread(0.0), spread(0.0)
    for j in range(NODES):
        first, second, third = load_from(_BENT, j, 0), load_from(_BENT, j, LANES), load_from(_BENT, j, 2 * LANES)
        first_y, second_y, third_y = first_y + y[j] * first, second_y + y[j] * second, third_y + y[j] * third
        first_z, second_z, third_z = first_z + z[j] * first, second_z + z[j] * second, third_z + z[j] * third
    store_to(crossed, first_y + by_y * load_from(moment, 0, 1, 0), row, 0)
    store_to(crossed, second_y + by_y * load_from(moment, 0, 1, LANES), row, LANES)
    store_to(crossed, third_y + by_y * load_from(moment, 0, 1, 2 * LANES), row, 2 * LANES)
    store_to(crossed, first_z + by_z * load_from(moment, 1, 0, 0), row, GRID)
    store_to(crossed, second_z + by_z * load_from(moment, 1, 0, LANES), row, GRID + LANES)
    store_to(crossed, third_z + by_z * load_from(moment, 1, 0, 2 * LANES), row, GRID + 2 * LANES)
    for k in range(2 * GRID, crossed.shape[1]):
        crossed[row, k] = 0.0
    crossed[row, 2 * GRID] = rest


@compiled
def _every_force(rig, free, grid):
    """The best forces at all distances, and the costs that they explain."""
    image, crossed, moment = grid.image, grid.crossed, grid.moment
    diagonal, beside, pulls = free.diagonal, free.beside, free.load
    for first in range(0, GRID, LANES):
        yy, yz, zz, y, z = spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)
        for j in range(NODES):
            bent = load_from(_BENT, j, first)
            own = diagonal[j] * bent * bent
            pull = pulls[j] * bent
            y, z = y + image[0, j] * pull, z + image[1, j] * pull
            yy = yy + image[0, j] * image[0, j] * own
            yz = yz + image[0, j] * image[1, j] * own
            zz = zz + image[1, j] * image[1, j] * own
            if j < LAST:
                mixed = beside[j] * bent * load_from(_BENT, j + 1, first)
                yy = yy + 2.0 * image[0, j] * image[0, j + 1] * mixed
                zz = zz + 2.0 * image[1, j] * image[1, j + 1] * mixed
                yz = yz + (image[0, j] * image[1, j + 1] + image[0, j + 1] * image[1, j]) * mixed
        # a force along y is felt about z, and one along z about y
        by_y, by_z = load_from(moment, 0, 1, first), load_from(moment, 1, 0, first)
        yy, zz = yy + by_y * by_y, zz + by_z * by_z
        y, z = y + free.residual[1] * by_y, z + free.residual[0] * by_z
        for a in range(len(crossed)):
            by_y, by_z = load_from(crossed, a, first), load_from(crossed, a, GRID + first)
            rest = crossed[a, 2 * GRID]
            yy, yz, zz = yy - by_y * by_y, yz - by_y * by_z, zz - by_z * by_z
            y, z = y - rest * by_y, z - rest * by_z
        for lane in range(LANES):
            sums = lane_of(yy, lane), lane_of(yz, lane), lane_of(zz, lane), lane_of(y, lane), lane_of(z, lane)
            _best_force(rig, grid, first + lane, sums)


@compiled
def _best_force(rig, grid, g, sums):
    yy, yz, zz, y, z = sums
    prior = tip_deflection(rig, grid.distance[g]) / TIP_DEFLECTION_STD
    yy += prior * prior
    zz += prior * prior
    over = 1.0 / max(yy * zz - yz * yz, 1e-300)
    grid.force[g, 0], grid.force[g, 1] = (zz * y - yz * z) * over, (yy * z - yz * y) * over
    grid.gain[g] = 0.5 * (grid.force[g, 0] * y + grid.force[g, 1] * z)


@compiled
def _rig_steps(grid, best, steps, work):
    """The rig's likeliest steps at the best distance and force."""
    force, crossed, found = grid.force[best], grid.crossed, grid.best_steps
    for k in range(steps - 1, -1, -1):
        total = crossed[k, 2 * GRID] - force[0] * crossed[k, best] - force[1] * crossed[k, GRID + best]
        for b in range(k + 1, steps):
            total -= work.factor[k, b] * found[b]
        found[k] = total / work.factor[k, k]
    for k in range(steps):
        found[k] *= work.scale[k]


@compiled
def _shift(free, grid, best, shift):
    """Displacement (M,) by the best force and the rig's steps that go with it."""
    shift_by_steps(free, UNKNOWNS, grid.best_steps, shift)
    image, force_y, force_z = grid.image, grid.force[best, 0], grid.force[best, 1]
    for j in range(NODES):
        shift[j] += (force_y * image[0, j] + force_z * image[1, j]) * _BENT[j, best]


@compiled
def largest_gain(grid):
    """The most that any force of the grid explains."""
    most = -np.inf
    for g in range(GRID):
        if not grid.gain[g] <= most:
            most = grid.gain[g]
    return most


@compiled
def limit_load(rig, start):
    """Reduce the force of a start (4,) that is too large to be one for large deflections."""
    load = rig.unit_load * np.hypot(start[1], start[2]) * start[0] * start[0]
    for axis in range(1, 3):
        start[axis] *= min(_LARGEST_LOAD / max(load, 1e-12), 1.0)


@compiled
def start_at(rig, grid, g, beside, part, start):
    """Unknowns (4,) at a part of the way from one distance of the grid to another, the force within `limit_load`."""
    here, there = grid.distance[g], grid.distance[beside]
    distance = here + part * (there - here)
    start[0], start[3] = distance, 0.0
    for axis in range(2):
        # the tip's deflection changes little from one distance to the next, the force much
        sway = grid.force[g, axis] * here * here * (3.0 - here)
        sway_there = grid.force[beside, axis] * there * there * (3.0 - there)
        force = (sway + part * (sway_there - sway)) / (distance * distance * (3.0 - distance))
        # where no force could be fitted the free antenna is as good a start as any
        start[1 + axis] = force if np.isfinite(force) else 0.0
    limit_load(rig, start)


@compiled
def lowest_of_grid(rig, grid, starts, costs):
    """Unknowns (S, 4) at the lowest local minima over the grid, lowest first, and their costs (S,), else infinite."""
    fill(costs, np.inf)
    gain, places = grid.gain, np.zeros(len(costs), np.int64)
    for g in range(GRID):
        if (g > 0 and gain[g] < gain[g - 1]) or (g < GRID - 1 and gain[g] < gain[g + 1]):
            continue
        cost, place = -gain[g], g
        for k in range(len(costs)):
            if cost < costs[k]:
                costs[k], cost = cost, costs[k]
                places[k], place = place, places[k]
    for k in range(len(costs)):
        g = places[k]
        part, beside = 0.0, g
        if 0 < g < GRID - 1:
            bend = 2.0 * gain[g] - gain[g - 1] - gain[g + 1]
            if bend > 0.0:
                part = min(max(0.5 * (gain[g + 1] - gain[g - 1]) / bend, -0.5), 0.5)
            beside = g - 1 if part < 0.0 else g + 1
        start_at(rig, grid, g, beside, abs(part), starts[k])


@compiled
def warm_start(grid, warm, starts, costs):
    """A known start alone, where no other distance explains the frame much better."""
    if not np.isfinite(warm).all():
        return
    near = 0
    for g in range(GRID):
        if abs(grid.distance[g] - warm[0]) < abs(grid.distance[near] - warm[0]):
            near = g
    if grid.gain[near] > largest_gain(grid) - _WARM_COST:
        starts[0] = warm
        costs[1:] = np.inf
