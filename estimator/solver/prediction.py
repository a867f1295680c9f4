"""What the model predicts of a frame at given unknowns, and its derivatives by the unknowns and by the rig.

Everything lives on the nodes of the predicted curve. Between nodes the picture's displacement along the normal is taken
as linear, which costs a ten-thousandth of it; the curve itself is a cubic.
"""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.lanes import lane_of, load_from, spread
from vbaa_calib.antenna.nodes import CONTACT, NODES_BEYOND
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.antenna.shape_kernel import LANES, bend_lanes
from vbaa_calib.camera.compiled_lens import CompiledLens, normalized_by_lens
from vbaa_calib.core.compiled import compiled, record

from .fit import CONTACT_M, INNER, LAST, NODES, arclength_of_node
from .linear_algebra import put
from .rig_arrays import ANTENNA, POSES, UNKNOWNS

_STEP = 1e-4
"""Finite-difference step of each unknown."""
TIP = 1.0
"""The tip's distance in antenna lengths."""
PAPER, LINEAR, ELASTICA, ROD = range(len(RUNGS))
"""The rungs. Those from `ELASTICA` on have shapes that depend on friction."""
REFERENCE = ROD
"""The rung that the others are compared with."""
_NEAREST_DEPTH_M = 1e-4
"""Nodes nearer to the camera's plane than this, or behind it, are taken to lie there: their picture is far off."""


@record
class Bent:
    """Shapes of the antenna side by side, and their ideal picture. Scratch room.

    Attributes
    ----------
    parameters : (9, L). contact_m, friction_rad, moment_Nm : (L,). push_N : (2, L).
    points_m : (3, M, L). tangents : (3, M, 1) of the first. force_N : (3, L). u, v, depth : (M, L).
    raw, raw_readings, raw_point_force : (M, Q), (3, Q), (6, Q) derivatives by the rig's parameters.
    by_lens : (2, 4 + k). lens : the camera's.
    """

    parameters: np.ndarray
    contact_m: np.ndarray
    push_N: np.ndarray
    friction_rad: np.ndarray
    points_m: np.ndarray
    tangents: np.ndarray
    force_N: np.ndarray
    moment_Nm: np.ndarray
    u: np.ndarray
    v: np.ndarray
    depth: np.ndarray
    raw: np.ndarray
    raw_readings: np.ndarray
    raw_point_force: np.ndarray
    by_lens: np.ndarray
    lens: CompiledLens


@compiled
def empty_bent(rig, lens):
    """Scratch room for one frame at a time."""
    rows = rig.axes.shape[0]
    return Bent(
        np.empty((ANTENNA, LANES)),
        np.empty(LANES),
        np.empty((2, LANES)),
        np.empty(LANES),
        np.empty((3, NODES, LANES)),
        np.empty((3, NODES, 1)),
        np.empty((3, LANES)),
        np.empty(LANES),
        np.empty((NODES, LANES)),
        np.empty((NODES, LANES)),
        np.empty((NODES, LANES)),
        np.zeros((NODES, rows)),
        np.zeros((3, rows)),
        np.zeros((6, rows)),
        np.empty((2, 4 + lens.distortions)),
        lens,
    )


@compiled
def _lay(rig, bent, unknowns, lane):
    """One lane's antenna, contact and force."""
    for k in range(ANTENNA):
        bent.parameters[k, lane] = rig.antenna_parameters[k]
    bent.contact_m[lane] = unknowns[0] * rig.length_m
    bent.push_N[0, lane] = unknowns[1] * rig.force_unit_N
    bent.push_N[1, lane] = unknowns[2] * rig.force_unit_N
    bent.friction_rad[lane] = unknowns[3] * rig.friction_rad


@compiled
def _shapes(rig, frame, rung, bent):
    """All lanes' shapes and pictures."""
    bend_lanes(
        rung,
        bent.parameters,
        rig.length_m,
        frame.gravity_m_s2,
        bent.contact_m,
        bent.push_N,
        bent.friction_rad,
        bent.points_m,
        bent.tangents,
        bent.force_N,
        bent.moment_Nm,
    )
    turn, shift = rig.rotations[0], rig.translations[0]
    for j in range(NODES):
        for lane in range(LANES):
            x, y, z = bent.points_m[0, j, lane], bent.points_m[1, j, lane], bent.points_m[2, j, lane]
            ahead = turn[2, 0] * x + turn[2, 1] * y + (turn[2, 2] * z + shift[2])
            # NaN stays NaN
            ahead = _NEAREST_DEPTH_M if ahead < _NEAREST_DEPTH_M else ahead
            bent.u[j, lane] = (turn[0, 0] * x + turn[0, 1] * y + (turn[0, 2] * z + shift[0])) / ahead
            bent.v[j, lane] = (turn[1, 0] * x + turn[1, 1] * y + (turn[1, 2] * z + shift[1])) / ahead
            bent.depth[j, lane] = ahead


@compiled
def _slope(rig, bent, j):
    """Slope of the first lane's picture by arc length at a node."""
    x, y, z = bent.tangents[0, j, 0], bent.tangents[1, j, 0], bent.tangents[2, j, 0]
    turn = rig.rotations[0]
    ahead = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
    u, v, depth = bent.u[j, 0], bent.v[j, 0], bent.depth[j, 0]
    across = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
    down = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
    return (across - u * ahead) / depth, (down - v * ahead) / depth


@compiled
def tip_axis(frame, slope_u, slope_v):
    """What turns a point of the picture into its place along the antenna's end, in deviations, and a length."""
    size = max(np.hypot(slope_u, slope_v), 1e-30)
    u, v = slope_u / size, slope_v / size
    xx, xy, yy = frame.tip_covariance
    std = np.sqrt(xx * u * u + 2.0 * xy * u * v + yy * v * v)
    return u / std, v / std, size / std


@compiled
def predicted_moment(rig, frame, bent, lane, about):
    """What the sensor about y (0) or z (1) would read of a lane's shape, in its deviations."""
    if about == 0:
        moment = bent.moment_Nm[lane]
    elif rig.with_second_sensor:
        moment = _moment_about_z(rig, frame, bent, lane)
    else:
        moment = 0.0
    return (rig.gain[about] * moment + rig.offset[about]) / rig.std[about]


@compiled
def _moment_about_z(rig, frame, bent, lane):
    """x·f_y − y·f_x of force and weight about the antenna frame's origin, N·m."""
    x, y = bent.points_m[0, :, lane], bent.points_m[1, :, lane]
    contact = min(bent.contact_m[lane], (1.0 - 1e-6) * rig.length_m)
    inner, outer = contact / INNER, (rig.length_m - contact) / NODES_BEYOND
    centre_x, centre_y = 0.0, 0.0
    for j in range(LAST):
        width = 0.5 * (inner if j < INNER else outer)
        centre_x += width * (x[j] + x[j + 1])
        centre_y += width * (y[j] + y[j + 1])
    mass = np.exp(rig.antenna_parameters[7])
    by_force = x[CONTACT] * bent.force_N[1, lane] - y[CONTACT] * bent.force_N[0, lane]
    return by_force + mass * (centre_x * frame.gravity_m_s2[1] - centre_y * frame.gravity_m_s2[0])


@compiled
def predict(rig, frame, rung, bent, fit, derivatives):
    """The prediction at the fit's unknowns; without `derivatives` its columns by the unknowns stay as they are."""
    free = 0
    if derivatives:
        free = UNKNOWNS if rig.friction_rad > 0.0 and rung >= ELASTICA else UNKNOWNS - 1
    moved = np.empty(UNKNOWNS)
    back = -_STEP if fit.unknowns[0] + _STEP > TIP else _STEP
    for lane in range(LANES):
        put(fit.unknowns, moved)
        if 0 < lane <= free:
            moved[lane - 1] += back if lane == 1 else _STEP
        _lay(rig, bent, moved, lane)
    _shapes(rig, frame, rung, bent)
    _curve(rig, bent, fit)
    slope_u, slope_v = _slope(rig, bent, LAST)
    end_u, end_v, end_m = tip_axis(frame, slope_u, slope_v)
    base = np.empty(3)
    for about in range(2):
        base[about] = predicted_moment(rig, frame, bent, 0, about)
        fit.predicted_residual[about] = (frame.moment_Nm[about] / rig.std[about] - base[about]) * frame.available[about]
    base[2] = bent.u[LAST, 0] * end_u + bent.v[LAST, 0] * end_v + rig.tip_offset_m * end_m
    fit.predicted_residual[2] = (frame.tip[0] * end_u + frame.tip[1] * end_v - base[2]) * frame.available[2]
    for axis in range(3):
        fit.point_force[axis] = bent.points_m[axis, CONTACT, 0]
        fit.point_force[3 + axis] = bent.force_N[axis, 0]
    for k in range(free):
        step = 1.0 / (back if k == 0 else _STEP)
        _by_lane(fit, bent, k + 1, k, step)
        for about in range(2):
            change = predicted_moment(rig, frame, bent, k + 1, about) - base[about]
            fit.reading_columns[about, k] = change * step * frame.available[about]
        tip = bent.u[LAST, k + 1] * end_u + bent.v[LAST, k + 1] * end_v + rig.tip_offset_m * end_m
        fit.reading_columns[2, k] = (tip - base[2]) * step * frame.available[2]
    if 0 < free < UNKNOWNS:
        _friction_column(rig, fit)


@compiled
def _curve(rig, bent, fit):
    """The first lane's picture: nodes, normals, and the cubics between them."""
    contact = min(fit.unknowns[0], 1.0 - 1e-6) * rig.length_m  # the last two nodes stay apart
    fit.numbers[CONTACT_M] = contact
    inner, outer = contact / INNER, (rig.length_m - contact) / NODES_BEYOND
    slope_u, slope_v = np.empty(NODES), np.empty(NODES)
    for j in range(NODES):
        slope_u[j], slope_v[j] = _slope(rig, bent, j)
        fit.u[j], fit.v[j], fit.depth[j] = bent.u[j, 0], bent.v[j, 0], bent.depth[j, 0]
        for axis in range(3):
            fit.points_m[axis, j] = bent.points_m[axis, j, 0]
            fit.tangents[axis, j] = bent.tangents[axis, j, 0]
        size = max(np.sqrt(slope_u[j] * slope_u[j] + slope_v[j] * slope_v[j]), 1e-30)
        fit.normal_u[j], fit.normal_v[j] = -slope_v[j] / size, slope_u[j] / size
    for j in range(LAST):
        width = inner if j < INNER else outer
        _cubic(fit.u[j], fit.u[j + 1], slope_u[j] * width, slope_u[j + 1] * width, fit.cubics[j, :4])
        _cubic(fit.v[j], fit.v[j + 1], slope_v[j] * width, slope_v[j + 1] * width, fit.cubics[j, 4:])
    fit.cubics[LAST] = fit.cubics[LAST - 1]


@compiled
def _cubic(start, end, leave, arrive, coefficients):
    gap = end - start
    coefficients[0], coefficients[1] = start, leave
    coefficients[2], coefficients[3] = 3.0 * gap - 2.0 * leave - arrive, leave + arrive - 2.0 * gap


@compiled
def _by_lane(fit, bent, lane, column, by_step):
    """A column of displacements, and of point and force, from a lane that was moved."""
    for j in range(NODES):
        along_u, along_v = bent.u[j, lane] - bent.u[j, 0], bent.v[j, lane] - bent.v[j, 0]
        fit.columns[j, column] = (along_u * fit.normal_u[j] + along_v * fit.normal_v[j]) * by_step
    for axis in range(3):
        by_point = bent.points_m[axis, CONTACT, lane] - bent.points_m[axis, CONTACT, 0]
        fit.point_force_columns[axis, column] = by_point * by_step
        fit.point_force_columns[3 + axis, column] = (bent.force_N[axis, lane] - bent.force_N[axis, 0]) * by_step


@compiled
def _friction_column(rig, fit):
    """By friction on the rungs whose shapes do not depend on it: only the force turns."""
    fit.columns[:, UNKNOWNS - 1] = 0.0
    fit.reading_columns[:, UNKNOWNS - 1] = 0.0
    force = fit.point_force[3:]
    size = np.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]) * rig.friction_rad
    for axis in range(3):
        fit.point_force_columns[axis, UNKNOWNS - 1] = 0.0
        fit.point_force_columns[3 + axis, UNKNOWNS - 1] = -size * fit.tangents[axis, CONTACT]


@compiled
def rig_jacobian(rig, frame, rung, bent, fit):
    """The fit's columns along the rig's axes, on one rung, about the fit's prediction.

    The paper's rung has neither clamp angle nor weight nor bow: it takes their effect from the linear one.
    """
    shared, own = rig.axes.shape[1], len(rig.line)
    if shared + own == 0:
        return
    rung = max(rung, LINEAR)
    first = LANES - 1
    end = _by_antenna(rig, frame, rung, bent, fit, 0, first)
    if first < ANTENNA:
        end = _by_antenna(rig, frame, rung, bent, fit, first, ANTENNA)
    _by_pose(rig, bent, fit, end)
    _by_sensor(rig, frame, bent)
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
        fit.reading_columns[:, column] = 0.0
        fit.point_force_columns[:, column] = 0.0


@compiled
def _by_antenna(rig, frame, rung, bent, fit, begin, end):
    """Raw derivatives by some of the antenna's parameters. Returns the axis of the antenna's end."""
    for lane in range(LANES):
        _lay(rig, bent, fit.unknowns, lane)
        parameter = begin + lane - 1
        if lane > 0 and parameter < end:
            bent.parameters[parameter, lane] += rig.antenna_steps[parameter]
    _shapes(rig, frame, rung, bent)
    slope_u, slope_v = _slope(rig, bent, LAST)
    axis = tip_axis(frame, slope_u, slope_v)
    for parameter in range(begin, end):
        lane, column, step = parameter - begin + 1, POSES + parameter, 1.0 / rig.antenna_steps[parameter]
        for j in range(NODES):
            along_u, along_v = bent.u[j, lane] - bent.u[j, 0], bent.v[j, lane] - bent.v[j, 0]
            bent.raw[j, column] = (along_u * fit.normal_u[j] + along_v * fit.normal_v[j]) * step
        for about in range(2):
            change = predicted_moment(rig, frame, bent, lane, about) - predicted_moment(rig, frame, bent, 0, about)
            bent.raw_readings[about, column] = change * step
        tip_u, tip_v = bent.u[LAST, lane] - bent.u[LAST, 0], bent.v[LAST, lane] - bent.v[LAST, 0]
        bent.raw_readings[2, column] = (tip_u * axis[0] + tip_v * axis[1]) * step
        for part in range(3):
            by_point = bent.points_m[part, CONTACT, lane] - bent.points_m[part, CONTACT, 0]
            bent.raw_point_force[part, column] = by_point * step
            bent.raw_point_force[3 + part, column] = (bent.force_N[part, lane] - bent.force_N[part, 0]) * step
    return axis


@compiled
def _by_pose(rig, bent, fit, end):
    """Raw derivatives by the pose's tangent, of the first lane's points."""
    for k in range(POSES):
        turn, shift, step = rig.rotations[k + 1], rig.translations[k + 1], 1.0 / rig.pose_steps[k]
        for j in range(NODES):
            x, y, z = bent.points_m[0, j, 0], bent.points_m[1, j, 0], bent.points_m[2, j, 0]
            ahead = turn[2, 0] * x + turn[2, 1] * y + (turn[2, 2] * z + shift[2])
            ahead = _NEAREST_DEPTH_M if ahead < _NEAREST_DEPTH_M else ahead
            u = (turn[0, 0] * x + turn[0, 1] * y + (turn[0, 2] * z + shift[0])) / ahead - bent.u[j, 0]
            v = (turn[1, 0] * x + turn[1, 1] * y + (turn[1, 2] * z + shift[1])) / ahead - bent.v[j, 0]
            bent.raw[j, k] = (u * fit.normal_u[j] + v * fit.normal_v[j]) * step
            if j == LAST:
                bent.raw_readings[2, k] = (u * end[0] + v * end[1]) * step


@compiled
def _by_sensor(rig, frame, bent):
    """Raw derivatives of what is read, in deviations, by gain and offset of the sensor about y."""
    column = POSES + ANTENNA
    read = predicted_moment(rig, frame, bent, 0, 0)
    gain = rig.gain[0] if rig.gain[0] != 0.0 else 1.0
    bent.raw_readings[0, column] = (read * rig.std[0] - rig.offset[0]) / gain / rig.std[0]
    bent.raw_readings[0, column + 1] = 1.0 / rig.std[0]


@compiled
def _by_lens(rig, bent, fit, end):
    """Raw derivatives by the lens, which moves the seen points, not the curve."""
    first = POSES + ANTENNA + 2
    for j in range(NODES):
        normalized_by_lens(bent.lens, fit.u[j], fit.v[j], bent.by_lens)
        for k in range(4 + bent.lens.distortions):
            u, v = bent.by_lens[0, k], bent.by_lens[1, k]
            bent.raw[j, first + k] = -(fit.normal_u[j] * u + fit.normal_v[j] * v)
            if j == LAST:
                bent.raw_readings[2, first + k] = -(end[0] * u + end[1] * v)


@compiled
def _along_axes(rig, raw, columns):
    """Derivatives by the rig's parameters (rows, Q) along its axes (Q, R), into the columns after the unknowns."""
    axes, shared = rig.wide_axes, rig.axes.shape[1]
    for j in range(len(raw)):
        for first in range(0, shared, LANES):
            total = spread(0.0)
            for q in range(len(axes)):
                total = total + raw[j, q] * load_from(axes, q, first)
            for k in range(min(LANES, shared - first)):
                columns[j, UNKNOWNS + first + k] = lane_of(total, k)
