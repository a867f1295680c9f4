"""Derivatives of what the model predicts of a frame by the rig: antenna, camera's pose, sensor, lens."""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.camera.compiled_lens import normalized_by_lens
from vbaa_calib.core.compiled import compiled
from vbaa_calib.core.lanes import LANES, lane_of, load, load_from, spread, store_to, where_positive

from .fit import LAST, NODES, arclength_of_node
from .prediction import (
    ELASTICA,
    LINEAR,
    NEAREST_DEPTH_M,
    bend_and_see,
    fitted_tip_axis,
    lay,
    point_jacobian,
    predicted_moment,
)
from .rig_arrays import ANTENNA, POSES, UNKNOWNS

_PLACE = 2
"""Of the antenna's parameters the first ones are the clamp's place, y and z."""


@compiled
def rig_jacobian(rig, frame, rung, bent, fit):
    """The fit's columns along the rig's axes, on one rung, about the fit's prediction.

    The paper's rung has neither clamp angle nor weight nor bow: it takes their effect from the linear one.
    """
    shared, own = rig.axes.shape[1], len(rig.line)
    if shared + own == 0:
        return
    rung = max(rung, LINEAR)
    end = fitted_tip_axis(rig, frame, fit)
    # each writes whole vectors, whose ends the next one overwrites
    _by_pose(rig, bent, fit, end)
    _by_antenna(rig, frame, rung, bent, fit, end)
    _by_place(rig, frame, rung, bent, fit, end)
    _by_sensor(rig, frame, bent, fit)
    if rig.with_lens:
        _by_lens(rig, bent, fit, end)
    if rig.with_tip:
        bent.raw_readings[2, len(rig.axes) - 1] = end[2]
    _along_axes(rig, bent.raw, fit.columns)
    _along_axes(rig, bent.raw_readings, fit.reading_columns)
    _along_axes(rig, bent.raw_point_force, fit.point_force_columns)
    for reading in range(3):
        for k in range(UNKNOWNS, UNKNOWNS + shared):
            fit.reading_columns[reading, k] *= frame.available[reading]
    for k in range(own):
        column = UNKNOWNS + shared + k
        for j in range(NODES):
            along = 2.0 * arclength_of_node(fit, rig.length_m, 1.0 * j) / rig.length_m - 1.0
            shape = 1.0 if k == 0 else along if k == 1 else 1.5 * along * along - 0.5
            fit.columns[j, column] = shape * rig.line[k]
        for reading in range(3):
            fit.reading_columns[reading, column] = 0.0
        for q in range(6):
            fit.point_force_columns[q, column] = 0.0


@compiled
def _by_antenna(rig, frame, rung, bent, fit, end):
    """Raw derivatives by all of the antenna's parameters but its place: as many as fit beside the antenna as it is."""
    lay(rig, bent, fit.unknowns)
    base, by_step, count, first = LANES - 1, bent.by_step, ANTENNA - _PLACE, POSES + _PLACE
    by_step[base] = 0.0
    for lane in range(count):
        bent.parameters[_PLACE + lane, lane] += rig.antenna_steps[_PLACE + lane]
        by_step[lane] = 1.0 / rig.antenna_steps[_PLACE + lane]
    bend_and_see(rig, frame, rung, bent, bent.no_rows)
    u, v, normal_u, normal_v, raw = bent.u, bent.v, fit.normal_u, fit.normal_v, bent.raw
    steps = load(by_step)
    for j in range(NODES):
        moved_u, moved_v = load(u, j) - u[j, base], load(v, j) - v[j, base]
        store_to(raw, moved_u * (steps * normal_u[j]) + moved_v * (steps * normal_v[j]), j, first)
    tip_u, tip_v = load(u, LAST) - u[LAST, base], load(v, LAST) - v[LAST, base]
    store_to(bent.raw_readings, (tip_u * end[0] + tip_v * end[1]) * steps, 2, first)
    for about in range(2):
        for lane in range(count):
            change = predicted_moment(rig, frame, bent, lane, about) - predicted_moment(rig, frame, bent, base, about)
            bent.raw_readings[about, first + lane] = change * by_step[lane]
    for part in range(3):
        by_point = load(bent.points_m, part, CONTACT) - bent.points_m[part, CONTACT, base]
        store_to(bent.raw_point_force, by_point * steps, part, first)
        by_force = load(bent.force_N, part) - bent.force_N[part, base]
        store_to(bent.raw_point_force, by_force * steps, 3 + part, first)


@compiled
def _by_place(rig, frame, rung, bent, fit, end):
    """Raw derivatives by where the clamp stands across the antenna frame's x axis: the whole antenna goes with it."""
    image, raw, base, turn = np.empty((2, NODES)), bent.raw, LANES - 1, rig.rotation
    point_jacobian(rig, fit, image)
    pull = bent.force_N[0, base]
    weight = np.exp(rig.antenna_parameters[7]) * rig.length_m * frame.gravity_m_s2[0]
    # small deflections: only friction's part of the pull has a moment about the clamp's place
    lever = pull
    if rung < ELASTICA:
        lever = -np.hypot(bent.push_N[0, base], bent.push_N[1, base]) * np.tan(bent.friction_rad[base])
    for k in range(_PLACE):
        column = POSES + k
        for j in range(NODES):
            raw[j, column] = image[k, j]
        ahead = (end[0] * fit.u[LAST] + end[1] * fit.v[LAST]) * turn[2, 1 + k]
        along = end[0] * turn[0, 1 + k] + end[1] * turn[1, 1 + k] - ahead
        bent.raw_readings[2, column] = along / fit.depth[LAST]
        for q in range(6):
            bent.raw_point_force[q, column] = 1.0 if q == 1 + k else 0.0
    bent.raw_readings[0, POSES], bent.raw_readings[1, POSES + 1] = 0.0, 0.0
    bent.raw_readings[0, POSES + 1] = -(lever + weight) * rig.gain[0] / rig.std[0]
    about_z = -(pull + weight) if rig.with_second_sensor else 0.0
    bent.raw_readings[1, POSES] = about_z * rig.gain[1] / rig.std[1]


@compiled
def _by_pose(rig, bent, fit, end):
    """Raw derivatives by the pose's tangent, of the fit's points."""
    poses, points_m, raw, by_step = rig.pose_lanes, fit.points_m, bent.raw, load(rig.by_pose_step)
    own_u, own_v, normal_u, normal_v = fit.u, fit.v, fit.normal_u, fit.normal_v
    for j in range(NODES):
        x, y, z = points_m[0, j], points_m[1, j], points_m[2, j]
        ahead = x * load(poses, 2, 0) + y * load(poses, 2, 1) + z * load(poses, 2, 2) + load(poses, 2, 3)
        ahead = where_positive(NEAREST_DEPTH_M - ahead, NEAREST_DEPTH_M, ahead)
        across = x * load(poses, 0, 0) + y * load(poses, 0, 1) + z * load(poses, 0, 2) + load(poses, 0, 3)
        down = x * load(poses, 1, 0) + y * load(poses, 1, 1) + z * load(poses, 1, 2) + load(poses, 1, 3)
        u, v = (across / ahead - own_u[j]) * by_step, (down / ahead - own_v[j]) * by_step
        store_to(raw, u * normal_u[j] + v * normal_v[j], j, 0)
        if j == LAST:
            store_to(bent.raw_readings, u * end[0] + v * end[1], 2, 0)


@compiled
def _by_sensor(rig, frame, bent, fit):
    """Raw derivatives of what is read, in deviations, by gain and offset of the sensor about y."""
    column = POSES + ANTENNA
    gain = rig.gain[0] if rig.gain[0] != 0.0 else 1.0
    bent.raw_readings[0, column] = bent.moment_Nm[LANES - 1] * rig.gain[0] / gain / rig.std[0]
    bent.raw_readings[0, column + 1] = 1.0 / rig.std[0]


@compiled
def _by_lens(rig, bent, fit, end):
    """Raw derivatives by the lens, which moves the seen points, not the curve."""
    first, raw, by_lens, seen, count = POSES + ANTENNA + 2, bent.raw, bent.by_lens, bent.seen, 4 + bent.lens.distortions
    u, v, normal_u, normal_v = fit.u, fit.v, fit.normal_u, fit.normal_v
    for begin in range(0, NODES, LANES):
        some = min(LANES, NODES - begin)
        for lane in range(LANES):
            j = begin + min(lane, some - 1)
            seen[0, lane], seen[1, lane] = u[j], v[j]
        normalized_by_lens(bent.lens, seen, by_lens)
        for lane in range(some):
            j = begin + lane
            for k in range(count):
                raw[j, first + k] = -(normal_u[j] * by_lens[0, k, lane] + normal_v[j] * by_lens[1, k, lane])
    last = LAST % LANES
    for k in range(count):
        bent.raw_readings[2, first + k] = -(end[0] * by_lens[0, k, last] + end[1] * by_lens[1, k, last])


@compiled
def _along_axes(rig, raw, columns):
    """Derivatives by the rig's parameters (rows, Q) along its axes (Q, R), into the columns after the unknowns.

    Three rows at a time: there are 3, 6 or `NODES` of them.
    """
    axes, shared, count = rig.wide_axes, rig.axes.shape[1], len(rig.axes)
    for j in range(0, len(raw), 3):
        for first in range(0, shared, LANES):
            above, middle, below = spread(0.0), spread(0.0), spread(0.0)
            for q in range(count):
                axis = load_from(axes, q, first)
                above = above + raw[j, q] * axis
                middle = middle + raw[j + 1, q] * axis
                below = below + raw[j + 2, q] * axis
            _put_part(columns, above, j, UNKNOWNS + first, shared - first)
            _put_part(columns, middle, j + 1, UNKNOWNS + first, shared - first)
            _put_part(columns, below, j + 2, UNKNOWNS + first, shared - first)


@compiled
def _put_part(columns, values, row, first, count):
    """Write the first of a vector's numbers, all of them if there are so many."""
    if count >= LANES:
        store_to(columns, values, row, first)
    else:
        for k in range(count):
            columns[row, first + k] = lane_of(values, k)
