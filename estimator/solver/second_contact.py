"""Is there a second contact? A score test: what another force elsewhere would still explain."""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.nodes import NODES_BEYOND, NODES_TO_CONTACT
from vbaa_calib.core.compiled import compiled
from vbaa_calib.core.robust import MAD_SCALE

from .fit import CONTACT_M, LAST, NODES, SCATTER, copy_fit
from .initialization import deflection
from .linear_algebra import factorise, solve_factorised
from .normal_equations import evaluate, huber_weight, times_tridiagonal
from .prediction import REFERENCE, point_jacobian, tip_axis

_GRID = 16
"""Places of the other force, evenly over the antenna."""
_BLOCKS, _STRUCTURE = 8, 22.0
"""Stretches of the antenna over which residuals are summed, and the χ² of the sums beyond which a second force is
searched: one frame of noise in 200."""
_DEPENDENT = 1e-4
"""A force counts for nothing if the first contact and the rig explain all but this part of its deflection's square."""


@compiled
def second_force(rig, frame, rung, fit, problem, distance_std, work):
    """What the best second force would do to a frame.

    Parameters
    ----------
    problem : the fit with the residuals of the highest rung, whose shapes are right, and their sums.

    Returns
    -------
    gain, place, shift : how much it lowers the cost, at the scatter that neighbouring points have; where it acts,
        in antenna lengths; how far the first contact's distance would move, in standard deviations. 0 where the
        residuals have no structure.
    """
    if not (_structure(problem) > _STRUCTURE or fit.numbers[SCATTER] > 1.0):
        return 0.0, 0.0, 0.0
    part = work.other
    copy_fit(fit, part)
    if rung != REFERENCE:
        evaluate(rig, frame, REFERENCE, part, work)
    return _score_test(rig, frame, part, distance_std, work)


@compiled
def _structure(problem):
    """Sum of squares of the residuals' means over `_BLOCKS` stretches, in their deviations: χ² if all is noise."""
    width, pulls, diagonal, beside = NODES // _BLOCKS, problem.load, problem.diagonal, problem.beside
    total = 0.0
    for block in range(_BLOCKS):
        load, weight = 0.0, 0.0
        for j in range(NODES - (_BLOCKS - block) * width, NODES - (_BLOCKS - block - 1) * width):
            # the nodes' hat functions add up to one, so that a row's sum is the weight of its node
            load += pulls[j]
            weight += diagonal[j] + (beside[j] if j < LAST else 0.0) + beside[j - 1]
        total += load * load / max(weight, 1e-30)
    return total


@compiled
def force_columns(rig, frame, fit, places, bent, lever, columns, readings):
    """What forces along y and z at G places do: displacement (M, 2 G), and what is read (3, 2 G), in deviations.

    bent : (M, G) how far each deflects the antenna, m. lever : (G,) its moment at the clamp, N·m.
    """
    image = np.empty((2, NODES))
    point_jacobian(rig, fit, image)
    for j in range(NODES):
        for g in range(len(places)):
            columns[j, 2 * g], columns[j, 2 * g + 1] = bent[j, g] * image[0, j], bent[j, g] * image[1, j]
    # the picture's direction at the end
    slope_u, slope_v = fit.normal_v[LAST], -fit.normal_u[LAST]
    end_u, end_v, _ = tip_axis(frame, slope_u, slope_v)
    turn = rig.rotation
    ahead = end_u * fit.u[LAST] + end_v * fit.v[LAST]
    for g in range(len(places)):
        for axis in range(2):
            along = end_u * turn[0, 1 + axis] + end_v * turn[1, 1 + axis] - ahead * turn[2, 1 + axis]
            # a force along z acts about y, one along y about z
            about = 1 - axis
            readings[about, 2 * g + axis] = rig.gain[about] / rig.std[about] * lever[g] * frame.available[about]
            readings[1 - about, 2 * g + axis] = 0.0
            readings[2, 2 * g + axis] = bent[LAST, g] * along / fit.depth[LAST] * frame.available[2]


@compiled
def _score_test(rig, frame, fit, distance_std, work):
    """Gain, place and shift of the best second force, by its small deflection, with all that contact, friction and rig
    can do about it projected out."""
    size = fit.size
    places, lever, bent = np.empty(_GRID), np.empty(_GRID), np.empty((NODES, _GRID))
    contact = min(fit.numbers[CONTACT_M] / rig.length_m, 1.0 - 1e-6)
    stiffness = rig.stiffness_Nm2
    for g in range(_GRID):
        place = (g + 1.0) / _GRID
        places[g] = place
        # scaled to a metre at the tip
        lever[g] = 6.0 * stiffness / (place * (3.0 - place) * rig.length_m**2)
        for j in range(NODES):
            along = contact * j / (NODES_TO_CONTACT - 1)
            if j >= NODES_TO_CONTACT:
                along = contact + (1.0 - contact) * (j - NODES_TO_CONTACT + 1) / NODES_BEYOND
            bent[j, g] = 6.0 * deflection(along, place) / (place * place * (3.0 - place))
    columns, readings = np.empty((NODES, 2 * _GRID)), np.empty((3, 2 * _GRID))
    force_columns(rig, frame, fit, places, bent, lever, columns, readings)
    weighted = np.empty((NODES, 2 * _GRID))
    times_tridiagonal(fit, columns, weighted)
    factorise(fit.information, 0, size, 0.0, work.factor, work.scale)
    best = np.empty(size)
    solve_factorised(work.factor, work.scale, size, fit.side, best)
    crossed, explained, side = np.zeros((2 * _GRID, size)), np.empty((2 * _GRID, size)), np.zeros(2 * _GRID)
    weight = np.empty(3)
    for reading in range(3):
        weight[reading] = huber_weight(fit.residual[reading])
    for k in range(2 * _GRID):
        for j in range(NODES):
            side[k] += columns[j, k] * fit.load[j]
            for a in range(size):
                crossed[k, a] += weighted[j, k] * fit.columns[j, a]
        for reading in range(3):
            pull = weight[reading] * readings[reading, k]
            side[k] += pull * fit.residual[reading]
            for a in range(size):
                crossed[k, a] += pull * fit.reading_columns[reading, a]
        for a in range(size):
            side[k] -= crossed[k, a] * best[a]
        solve_factorised(work.factor, work.scale, size, crossed[k], explained[k])
    most, gain, force_y, force_z = 0, -np.inf, 0.0, 0.0
    for g in range(_GRID):
        own, left = np.zeros(3), np.zeros(3)
        for pair in range(3):
            a, b = 2 * g + (pair == 2), 2 * g + (pair > 0)
            for j in range(NODES):
                own[pair] += columns[j, a] * weighted[j, b]
            for reading in range(3):
                own[pair] += weight[reading] * readings[reading, a] * readings[reading, b]
            left[pair] = own[pair]
            for k in range(size):
                left[pair] -= crossed[a, k] * explained[b, k]
        y, z, lowers = _best_force(own, left, side[2 * g], side[2 * g + 1])
        if lowers > gain:
            most, gain, force_y, force_z = g, lowers, y, z
    moved = force_y * explained[2 * most, 0] + force_z * explained[2 * most + 1, 0]
    rescaled = (fit.numbers[SCATTER] / _neighbour_scatter(fit)) ** 2
    return gain * rescaled, places[most], abs(moved) / distance_std


@compiled
def _best_force(own, left, y, z):
    """The best force at a place, in its columns' units, and how much it lowers the cost.

    own : (3,) its information yy, yz, zz; left : (3,) what contact and rig leave of it. y, z : the right side.
    """
    least = _DEPENDENT * (own[0] + own[2]) + 1e-30
    middle, half = 0.5 * (left[0] + left[2]), np.hypot(0.5 * (left[0] - left[2]), left[1])
    angle = 0.5 * np.arctan2(left[1], 0.5 * (left[0] - left[2]))
    cos, sin = np.cos(angle), np.sin(angle)
    along, across = cos * y + sin * z, cos * z - sin * y
    major = along / max(middle + half, 1e-300) if middle + half > least else 0.0
    minor = across / max(middle - half, 1e-300) if middle - half > least else 0.0
    return cos * major - sin * minor, sin * major + cos * minor, 0.5 * (major * along + minor * across)


@compiled
def _neighbour_scatter(fit):
    """Factor on the points' deviations by which neighbours along the antenna differ, at least 1.

    A second contact leaves smooth residuals: the scatter about the fit would take them for noise.
    """
    count = len(fit.distance)
    if count < 2:
        return 1.0
    order = np.argsort(fit.foot_m)
    gaps = np.empty(count - 1)
    for i in range(count - 1):
        first, second = order[i], order[i + 1]
        here = fit.distance[first] * np.sqrt(fit.precision[first])
        gaps[i] = abs(fit.distance[second] * np.sqrt(fit.precision[second]) - here)
    middle = (count - 1) // 2
    median = np.partition(gaps, middle)[middle]
    return max(MAD_SCALE / np.sqrt(2.0) * median, 1.0)
