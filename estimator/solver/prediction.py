"""What the model predicts of a frame at given unknowns, and its derivatives by the unknowns and by the rig.

Everything lives on the nodes of the predicted curve. Between nodes the picture's displacement along the normal is taken
as linear, which costs a ten-thousandth of it; the curve itself is a cubic.
"""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.nodes import CONTACT, NODES_BEYOND
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.antenna.shape_kernel import NODE_ROWS, bend_lanes
from vbaa_calib.camera.compiled_lens import CompiledLens
from vbaa_calib.core.compiled import compiled, record
from vbaa_calib.core.lanes import LANES, lane_of, load, spread, store, where_positive

from .fit import CONTACT_M, INNER, LAST, NODES
from .rig_arrays import ANTENNA, UNKNOWNS

_STEP = 1e-4
"""Finite-difference step of each unknown."""
TIP = 1.0
"""The tip's distance in antenna lengths."""
PAPER, LINEAR, ELASTICA, ROD = range(len(RUNGS))
"""The rungs. Those from `ELASTICA` on have shapes that depend on friction."""
REFERENCE = ROD
"""The rung that the others are compared with."""
NEAREST_DEPTH_M = 1e-4
"""Nodes nearer to the camera's plane than this, or behind it, are taken to lie there: their picture is far off."""


@record
class Bent:
    """Shapes of the antenna side by side, and their ideal picture. Scratch room.

    Attributes
    ----------
    parameters : (9, L). contact_m, friction_rad, moment_Nm : (L,). push_N : (2, L).
    points_m : (3, M, L). tangents : (3, M′) of the first, node after node, and rows those by eights; no_rows without.
    force_N : (3, L). u, v, depth : (M, L). by_step : (L,) one over each lane's step.
    raw, raw_readings, raw_point_force : (M, Q′), (3, Q′), (6, Q′) derivatives by the rig's Q parameters; there is room
        to write whole vectors.
    by_lens : (2, 4 + k, L). seen : (6, L). lens : the camera's.
    """

    parameters: np.ndarray
    contact_m: np.ndarray
    push_N: np.ndarray
    friction_rad: np.ndarray
    points_m: np.ndarray
    tangents: np.ndarray
    rows: np.ndarray
    no_rows: np.ndarray
    force_N: np.ndarray
    moment_Nm: np.ndarray
    u: np.ndarray
    v: np.ndarray
    depth: np.ndarray
    by_step: np.ndarray
    raw: np.ndarray
    raw_readings: np.ndarray
    raw_point_force: np.ndarray
    by_lens: np.ndarray
    seen: np.ndarray
    lens: CompiledLens


@compiled
def empty_bent(rig, lens):
    """Scratch room for one frame at a time."""
    room = rig.axes.shape[0] + LANES
    rows = np.empty((3, NODE_ROWS, LANES))
    return Bent(
        np.empty((ANTENNA, LANES)),
        np.empty(LANES),
        np.empty((2, LANES)),
        np.empty(LANES),
        np.empty((3, NODES, LANES)),
        rows.reshape((3, NODE_ROWS * LANES)),
        rows,
        np.empty((3, 0, LANES)),
        np.empty((3, LANES)),
        np.empty(LANES),
        np.empty((NODES, LANES)),
        np.empty((NODES, LANES)),
        np.empty((NODES, LANES)),
        np.zeros(LANES),
        np.zeros((NODES, room)),
        np.zeros((3, room)),
        np.zeros((6, room)),
        np.empty((2, 4 + lens.distortions, LANES)),
        np.empty((6, LANES)),
        lens,
    )


@compiled
def lay(rig, bent, unknowns):
    """All lanes' antenna, contact and force alike."""
    for k in range(ANTENNA):
        store(bent.parameters, spread(rig.antenna_parameters[k]), k)
    store(bent.contact_m, spread(unknowns[0] * rig.length_m))
    store(bent.push_N, spread(unknowns[1] * rig.force_unit_N), 0)
    store(bent.push_N, spread(unknowns[2] * rig.force_unit_N), 1)
    store(bent.friction_rad, spread(unknowns[3] * rig.friction_rad))


@compiled
def bend_and_see(rig, frame, rung, bent, tangents):
    """All lanes' shapes and pictures; tangents as in `shape_kernel.Bent`."""
    bend_lanes(
        rung,
        bent.parameters,
        rig.length_m,
        frame.gravity_m_s2,
        bent.contact_m,
        bent.push_N,
        bent.friction_rad,
        bent.points_m,
        tangents,
        bent.force_N,
        bent.moment_Nm,
    )
    turn, shift, points_m, u, v, depth = rig.rotation, rig.translation_m, bent.points_m, bent.u, bent.v, bent.depth
    for j in range(NODES):
        x, y, z = load(points_m, 0, j), load(points_m, 1, j), load(points_m, 2, j)
        ahead = turn[2, 0] * x + turn[2, 1] * y + (turn[2, 2] * z + shift[2])
        # NaN stays NaN
        ahead = where_positive(NEAREST_DEPTH_M - ahead, NEAREST_DEPTH_M, ahead)
        store(u, (turn[0, 0] * x + turn[0, 1] * y + (turn[0, 2] * z + shift[0])) / ahead, j)
        store(v, (turn[1, 0] * x + turn[1, 1] * y + (turn[1, 2] * z + shift[1])) / ahead, j)
        store(depth, ahead, j)


@compiled
def tip_axis(frame, slope_u, slope_v):
    """What turns a point of the picture into its place along the antenna's end, in deviations, and a length."""
    size = max(np.hypot(slope_u, slope_v), 1e-30)
    u, v = slope_u / size, slope_v / size
    xx, xy, yy = frame.tip_covariance
    std = np.sqrt(xx * u * u + 2.0 * xy * u * v + yy * v * v)
    return u / std, v / std, size / std


@compiled
def fitted_tip_axis(rig, frame, fit):
    """`tip_axis` of the fit's picture."""
    by_width = NODES_BEYOND / (rig.length_m - fit.numbers[CONTACT_M])
    last = fit.cubics[LAST - 1]
    slope_u = (last[1] + 2.0 * last[2] + 3.0 * last[3]) * by_width
    slope_v = (last[5] + 2.0 * last[6] + 3.0 * last[7]) * by_width
    return tip_axis(frame, slope_u, slope_v)


@compiled
def point_jacobian(rig, fit, image):
    """(2, M) displacement along the picture's normals per metre that a node moves along y, and z, antenna frame."""
    turn = rig.rotation
    for j in range(NODES):
        u, v = fit.normal_u[j], fit.normal_v[j]
        ahead = u * fit.u[j] + v * fit.v[j]
        for axis in range(2):
            along = u * turn[0, 1 + axis] + v * turn[1, 1 + axis] - ahead * turn[2, 1 + axis]
            image[axis, j] = along / fit.depth[j]


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
    unknowns, free = fit.unknowns, 0
    back = -_STEP if unknowns[0] + _STEP > TIP else _STEP
    lay(rig, bent, unknowns)
    if derivatives:
        free = UNKNOWNS if rig.friction_rad > 0.0 and rung >= ELASTICA else UNKNOWNS - 1
        # lanes 1 to 4 are moved
        bent.contact_m[1] += back * rig.length_m
        bent.push_N[0, 2] += _STEP * rig.force_unit_N
        bent.push_N[1, 3] += _STEP * rig.force_unit_N
        if free == UNKNOWNS:
            bent.friction_rad[4] += _STEP * rig.friction_rad
    bend_and_see(rig, frame, rung, bent, bent.rows)
    _curve(rig, bent, fit)
    end_u, end_v, end_m = fitted_tip_axis(rig, frame, fit)
    base, available, readings = np.empty(3), frame.available, fit.reading_columns
    for about in range(2):
        base[about] = predicted_moment(rig, frame, bent, 0, about)
        fit.predicted_residual[about] = (frame.moment_Nm[about] / rig.std[about] - base[about]) * available[about]
    base[2] = bent.u[LAST, 0] * end_u + bent.v[LAST, 0] * end_v + rig.tip_offset_m * end_m
    fit.predicted_residual[2] = (frame.tip[0] * end_u + frame.tip[1] * end_v - base[2]) * available[2]
    for axis in range(3):
        fit.point_force[axis] = bent.points_m[axis, CONTACT, 0]
        fit.point_force[3 + axis] = bent.force_N[axis, 0]
    for k in range(free):
        step = 1.0 / (back if k == 0 else _STEP)
        bent.by_step[1 + k] = step
        for about in range(2):
            change = predicted_moment(rig, frame, bent, k + 1, about) - base[about]
            readings[about, k] = change * step * available[about]
        tip = bent.u[LAST, k + 1] * end_u + bent.v[LAST, k + 1] * end_v + rig.tip_offset_m * end_m
        readings[2, k] = (tip - base[2]) * step * available[2]
        for axis in range(3):
            by_point = bent.points_m[axis, CONTACT, k + 1] - bent.points_m[axis, CONTACT, 0]
            fit.point_force_columns[axis, k] = by_point * step
            by_force = bent.force_N[axis, k + 1] - bent.force_N[axis, 0]
            fit.point_force_columns[3 + axis, k] = by_force * step
    if free:
        _by_unknowns(bent, fit, free == UNKNOWNS)
    if 0 < free < UNKNOWNS:
        _friction_column(rig, fit)


@compiled
def _curve(rig, bent, fit):
    """The first lane's picture: nodes, normals, and the cubics between them."""
    contact = min(fit.unknowns[0], 1.0 - 1e-6) * rig.length_m  # the last two nodes stay apart
    fit.numbers[CONTACT_M] = contact
    inner, outer = contact / INNER, (rig.length_m - contact) / NODES_BEYOND
    turn, points_m, tangents = rig.rotation, bent.points_m, bent.tangents
    bent_u, bent_v, bent_depth = bent.u, bent.v, bent.depth
    u, v, depth, normal_u, normal_v, cubics = fit.u, fit.v, fit.depth, fit.normal_u, fit.normal_v, fit.cubics
    own_points, own_tangents = fit.points_m, fit.tangents
    before_u, before_v = 0.0, 0.0
    for j in range(NODES):
        x, y, z = tangents[0, j], tangents[1, j], tangents[2, j]
        here_u, here_v, here_depth = bent_u[j, 0], bent_v[j, 0], bent_depth[j, 0]
        ahead = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
        by_depth = 1.0 / here_depth
        slope_u = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z - here_u * ahead) * by_depth
        slope_v = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z - here_v * ahead) * by_depth
        own_tangents[0, j], own_tangents[1, j], own_tangents[2, j] = x, y, z
        for axis in range(3):
            own_points[axis, j] = points_m[axis, j, 0]
        by_size = 1.0 / max(np.sqrt(slope_u * slope_u + slope_v * slope_v), 1e-30)
        normal_u[j], normal_v[j] = -slope_v * by_size, slope_u * by_size
        u[j], v[j], depth[j] = here_u, here_v, here_depth
        if j > 0:
            width, i = inner if j <= INNER else outer, j - 1
            _cubic(u[i], here_u, before_u * width, slope_u * width, cubics, i, 0)
            _cubic(v[i], here_v, before_v * width, slope_v * width, cubics, i, 4)
        before_u, before_v = slope_u, slope_v
    for k in range(8):
        cubics[LAST, k] = cubics[LAST - 1, k]


@compiled
def _cubic(start, end, leave, arrive, cubics, node, first):
    gap = end - start
    cubics[node, first], cubics[node, first + 1] = start, leave
    cubics[node, first + 2], cubics[node, first + 3] = 3.0 * gap - 2.0 * leave - arrive, leave + arrive - 2.0 * gap


@compiled
def _by_unknowns(bent, fit, with_friction):
    """Displacements along the normals, of the lanes that were moved."""
    u, v, normal_u, normal_v, columns = bent.u, bent.v, fit.normal_u, fit.normal_v, fit.columns
    by_step = load(bent.by_step)
    for j in range(NODES):
        moved = (load(u, j) - u[j, 0]) * (by_step * normal_u[j]) + (load(v, j) - v[j, 0]) * (by_step * normal_v[j])
        columns[j, 0], columns[j, 1], columns[j, 2] = lane_of(moved, 1), lane_of(moved, 2), lane_of(moved, 3)
        if with_friction:
            columns[j, 3] = lane_of(moved, 4)


@compiled
def _friction_column(rig, fit):
    """By friction on the rungs whose shapes do not depend on it: only the force turns."""
    for j in range(NODES):
        fit.columns[j, UNKNOWNS - 1] = 0.0
    for reading in range(3):
        fit.reading_columns[reading, UNKNOWNS - 1] = 0.0
    force = fit.point_force[3:]
    size = np.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]) * rig.friction_rad
    for axis in range(3):
        fit.point_force_columns[axis, UNKNOWNS - 1] = 0.0
        fit.point_force_columns[3 + axis, UNKNOWNS - 1] = -size * fit.tangents[axis, CONTACT]
