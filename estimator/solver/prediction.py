"""What the model predicts of frames at given unknowns, and its derivatives by the unknowns and by the rig.

Everything lives on the nodes of the predicted curves. Between nodes the image's displacement along the normal is taken
as linear, which costs a ten-thousandth of it; the curve itself is a cubic.
"""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.rungs import curves
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.core.arrays import Array, arange_like, as_index, namespace
from vbaa_calib.rig import RIG_STEPS

from .curves import INNER, LAST, cubics, dot, evaluate_cubics, flat_rows, image_slopes, project, spacing
from .frames import Frames
from .rig_arrays import ANTENNA, POSES, UNKNOWNS, RigArrays

_STEP = 1e-4
"""Finite-difference step of each unknown."""
TIP = 1.0
"""The tip's distance in antenna lengths."""
LINEAR = "linear"
FRICTION_RUNGS = ("elastica", "rod")
"""The rungs whose shapes depend on friction."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """B predicted curves on their M nodes, in the ideal picture, with their derivatives by the 4 unknowns.

    Attributes
    ----------
    points_m, tangents : (B, M, 3) antenna frame.
    contact_m : (B,) arc length of the contact, which is the node `antenna.nodes.CONTACT`.
    nodes : (B, M, 2) ideal image points. cubics : (B, M, 8) the curves between them, see `curves.cubics`.
    depth : (B, M, 1) before the camera, m.
    normals : (B, M, 2) unit normals of the image curve.
    jacobian : (B, M, 4) of the image's displacement along the normals.
    reading_residual : (B, 3) what was read less what is predicted, in deviations: moments about y and z, and the
        antenna's end along it in the picture; 0 where there is no reading.
    reading_jacobian : (B, 3, 4) of the predicted readings, in deviations.
    point_force : (B, 6) contact point, m, and force, N, antenna frame. point_force_jacobian : (B, 6, 4).
    """

    length_m: float
    points_m: Array
    tangents: Array
    contact_m: Array
    nodes: Array
    cubics: Array
    depth: Array
    normals: Array
    jacobian: Array
    reading_residual: Array
    reading_jacobian: Array
    point_force: Array
    point_force_jacobian: Array

    def locate(self, arclength_m: Array) -> tuple[Array, Array, Array]:
        """The node before each arc length (B, N), the share of the way to the next one, and the interval's width."""
        xp = namespace(arclength_m)
        contact, inner, outer = spacing(self.contact_m, self.length_m)
        beyond = xp.clip(arclength_m - contact, 0.0, None)
        along = (arclength_m - beyond) / inner + beyond / outer
        node = xp.floor(xp.clip(xp.nan_to_num(along, nan=0.0), 0.0, LAST - 1e-6))
        width = inner + (outer - inner) * xp.clip(node - (INNER - 1.0), 0.0, 1.0)
        return as_index(node), along - node, width

    def points_at(self, arclength_m: Array) -> Array:
        """(B, N, 3) points of the antenna at arc lengths (B, N), antenna frame."""
        table = cubics(self.points_m, self.tangents, self.contact_m, self.length_m)
        node, share, _ = self.locate(arclength_m)
        values = evaluate_cubics(table, flat_rows(node, table.shape[1]), share)
        return namespace(share).stack([value for value, _, _ in values], -1)

    def arclength(self, node: Array) -> Array:
        """Arc lengths (B, N) in m of places given in nodes."""
        _, inner, outer = spacing(self.contact_m, self.length_m)
        past = namespace(node).clip(node - INNER, 0.0, None)
        return (node - past) * inner + past * outer


@dataclass(frozen=True, eq=False)
class RigJacobian:
    """Derivatives of a prediction along the rig's R axes: image (B, M, R), reading (B, 3, R), point_force (B, 6, R)."""

    image: Array
    reading: Array
    point_force: Array


def bend(frames: Frames, rung: str, unknowns: Array, steps: Array | None = None) -> Curves:
    """B·K antenna shapes for unknowns (B, K, 4); `steps` (B, K, 9) are added to the antenna's parameters."""
    xp, rig_arrays = namespace(unknowns), frames.rig_arrays
    grid = unknowns.shape[:2]
    parameters = rig_arrays.antenna_parameters if steps is None else rig_arrays.antenna_parameters + steps
    flat = unknowns.reshape(-1, UNKNOWNS)
    return curves(
        rung,
        xp.broadcast_to(parameters, (*grid, ANTENNA)).reshape(-1, ANTENNA),
        rig_arrays.length_m,
        xp.broadcast_to(frames.gravity_m_s2[:, None], (*grid, 3)).reshape(-1, 3),
        flat[:, 0] * rig_arrays.length_m,
        flat[:, 1:3] * rig_arrays.force_unit_N,
        flat[:, 3] * rig_arrays.friction_rad if rig_arrays.friction_rad > 0.0 else None,
    )


def predict(frames: Frames, rung: str, unknowns: Array, derivatives: bool = True) -> Prediction:
    """The prediction at unknowns (B, 4); without `derivatives` its Jacobians have no columns."""
    xp, rig_arrays = namespace(unknowns), frames.rig_arrays
    free = (
        (UNKNOWNS if rig_arrays.friction_rad > 0.0 and rung in FRICTION_RUNGS else UNKNOWNS - 1) if derivatives else 0
    )
    ones = xp.ones_like(unknowns[:, :1])
    signs = xp.concat([xp.where(unknowns[:, :1] + _STEP > TIP, -ones, ones)] + [ones] * (UNKNOWNS - 1), -1)[:, :free]
    steps = xp.concat([ones, signs], -1)[..., None] * rig_arrays.unit_steps[: free + 1]
    shapes = bend(frames, rung, unknowns[:, None] + _STEP * steps)
    grid = len(frames), free + 1
    u, v, depth = (part.reshape(*grid, -1) for part in project(rig_arrays, shapes.points_m))
    points, tangents = (vectors.reshape(*grid, -1, 3)[:, 0] for vectors in (shapes.points_m, shapes.tangents))
    slope_u, slope_v = image_slopes(rig_arrays, tangents, u[:, 0], v[:, 0], depth[:, 0])
    size = xp.clip(xp.hypot(slope_u, slope_v), 1e-30, None)
    normal_u, normal_v = -slope_v / size, slope_u / size
    displacement = (u[:, 1:] - u[:, :1]) * normal_u[:, None] + (v[:, 1:] - v[:, :1]) * normal_v[:, None]
    jacobian = displacement / (_STEP * signs[..., None])
    along = _tip_axis(frames, slope_u[:, -1], slope_v[:, -1])
    tip = u[..., -1] * along[:, :1] + v[..., -1] * along[:, 1:2] + rig_arrays.tip_offset_m * along[:, 2:]
    reading = xp.concat([predicted_moment(frames, shapes).reshape(*grid, 2), tip[..., None]], -1)
    reading_jacobian = (reading[:, 1:] - reading[:, :1]) / (_STEP * signs[..., None])
    seen_tip = (frames.tip * along[:, :2]).sum(-1)[:, None]
    read = xp.concat([frames.moment_Nm / rig_arrays.std, seen_tip], -1)
    point_force = xp.concat([shapes.contact_m, shapes.force_N], -1).reshape(*grid, 6)
    point_force_jacobian = (point_force[:, 1:] - point_force[:, :1]) / (_STEP * signs[..., None])
    if 0 < free < UNKNOWNS:
        jacobian = xp.concat([jacobian, xp.zeros_like(jacobian[:, :1])], 1)
        reading_jacobian = xp.concat([reading_jacobian, xp.zeros_like(reading_jacobian[:, :1])], 1)
        by_friction = _force_by_friction(rig_arrays, shapes, point_force[:, :1])
        point_force_jacobian = xp.concat([point_force_jacobian, by_friction], 1)
    contact = xp.clip(unknowns[:, 0], None, 1.0 - 1e-6) * rig_arrays.length_m  # the last two nodes stay apart
    nodes = xp.stack([u[:, 0], v[:, 0]], -1)
    return Prediction(
        rig_arrays.length_m,
        points,
        tangents,
        contact,
        nodes,
        cubics(nodes, xp.stack([slope_u, slope_v], -1), contact, rig_arrays.length_m),
        depth[:, 0, :, None],
        xp.stack([normal_u, normal_v], -1),
        jacobian.mT,
        (read - reading[:, 0]) * frames.available,
        reading_jacobian.mT * frames.available[..., None],
        point_force[:, 0],
        point_force_jacobian.mT,
    )


def point_jacobian(rig_arrays: RigArrays, prediction: Prediction) -> Array:
    """(B, M, 3) displacement along the image normals per metre that a node moves along each antenna axis."""
    rotation = rig_arrays.rotations[0]
    along = prediction.normals @ rotation[:2]  # of n · (X/Z, Y/Z) by the point
    return (along - dot(prediction.normals, prediction.nodes)[..., None] * rotation[2]) / prediction.depth


def difference(prediction: Prediction, other: Prediction) -> tuple[Array, Array, Array]:
    """What another prediction of the same frames says, less this one.

    Along the normals (B, M), readings in deviations (B, 3), and contact point and force (B, 6).
    """
    displacement = dot(other.nodes - prediction.nodes, prediction.normals)
    reading = prediction.reading_residual - other.reading_residual
    return displacement, reading, other.point_force - prediction.point_force


def reading_response(frames: Frames, prediction: Prediction, moment_Nm: Array, end_m: Array) -> Array:
    """(B, 3, 2G) what is read, in deviations, of forces along y and z with moments (G,) at the clamp.

    end_m : (B, G) by how much each deflects the antenna's end, m.
    """
    xp, rig_arrays = namespace(moment_Nm), frames.rig_arrays
    node, depth = prediction.nodes[:, -1:], prediction.depth[:, -1]
    slopes = image_slopes(
        rig_arrays, prediction.tangents[:, -1:], node[..., 0], node[..., 1], prediction.depth[:, -1:, 0]
    )
    along = _tip_axis(frames, *(slope[:, 0] for slope in slopes))[:, :2]
    rotation = rig_arrays.rotations[0]
    by_point = (along @ rotation[:2] - dot(along, node[:, 0])[:, None] * rotation[2]) / depth
    end = (end_m[..., None] * by_point[:, None, 1:]).reshape(len(end_m), 1, -1)
    moment = rig_arrays.moment_response(moment_Nm).reshape(2, -1)
    moment = xp.broadcast_to(moment, (len(end_m), *moment.shape))
    return xp.concat([moment, end], 1) * frames.available[..., None]


def _tip_axis(frames: Frames, slope_u: Array, slope_v: Array) -> Array:
    """(B, 3) what turns a point of the picture into its place along the antenna's end, in deviations, and a length.

    slope_u, slope_v : (B,) of the picture by arc length there.
    """
    xp = namespace(slope_u)
    size = xp.clip(xp.hypot(slope_u, slope_v), 1e-30, None)
    u, v = slope_u / size, slope_v / size
    xx, xy, yy = frames.tip_covariance
    std = xp.sqrt(xx * u * u + 2.0 * xy * u * v + yy * v * v)
    return xp.stack([u / std, v / std, size / std], -1)


def predicted_moment(frames: Frames, shapes: Curves) -> Array:
    """(B·K, 2) what the sensors would read for B·K shapes, in their deviations."""
    xp, rig_arrays = namespace(shapes.points_m), frames.rig_arrays
    about_z = xp.zeros_like(shapes.moment_Nm)
    if rig_arrays.rig.second_moment_sensor is not None:
        about_z = _moment_about_z(frames, shapes)
    return (rig_arrays.gain * xp.stack([shapes.moment_Nm, about_z], -1) + rig_arrays.offset) / rig_arrays.std


def _moment_about_z(frames: Frames, shapes: Curves) -> Array:
    """(B·K,) x·f_y − y·f_x of force and weight about the antenna frame's origin, N·m."""
    xp = namespace(shapes.points_m)
    contact, force = shapes.points_m[:, CONTACT], shapes.force_N
    widths = shapes.arclength_m[:, 1:] - shapes.arclength_m[:, :-1]
    middles = 0.5 * (shapes.points_m[:, 1:, :2] + shapes.points_m[:, :-1, :2])
    centre = (middles * widths[..., None]).sum(1)
    weight = xp.exp(frames.rig_arrays.antenna_parameters[7]) * frames.gravity_m_s2
    weight = xp.broadcast_to(weight[:, None], (len(frames), len(force) // len(frames), 3)).reshape(-1, 3)
    by_force = contact[:, 0] * force[:, 1] - contact[:, 1] * force[:, 0]
    return by_force + centre[:, 0] * weight[:, 1] - centre[:, 1] * weight[:, 0]


def rig_jacobian(frames: Frames, rung: str, unknowns: Array, prediction: Prediction) -> RigJacobian:
    """Derivatives along the rig's axes at unknowns (B, 4), on one rung.

    The paper's rung has neither clamp angle nor weight nor bow: it takes their effect from the linear one.
    """
    xp, rig_arrays = namespace(unknowns), frames.rig_arrays
    if rig_arrays.steps == 0:
        return RigJacobian(
            prediction.nodes[..., :0], prediction.reading_jacobian[..., :0], prediction.point_force_jacobian[..., :0]
        )
    grid = len(frames), ANTENNA + 1
    steps = xp.broadcast_to(rig_arrays.antenna_steps, (*grid, ANTENNA))
    rung = LINEAR if rung == "paper" else rung
    shapes = bend(frames, rung, xp.broadcast_to(unknowns[:, None], (*grid, UNKNOWNS)), steps)
    u, v, depth = (part.reshape(*grid, -1) for part in project(rig_arrays, shapes.points_m))
    points, normals = shapes.points_m.reshape(*grid, -1, 3)[:, 0], prediction.normals
    sizes = rig_arrays.antenna_steps[1:].sum(0)
    normal_u, normal_v = normals[:, None, :, 0], normals[:, None, :, 1]
    by_antenna = ((u[:, 1:] - u[:, :1]) * normal_u + (v[:, 1:] - v[:, :1]) * normal_v).mT / sizes
    tangents = shapes.tangents.reshape(*grid, -1, 3)[:, 0, -1:]
    slopes = image_slopes(rig_arrays, tangents, *(part[:, 0, -1:] for part in (u, v, depth)))
    along = _tip_axis(frames, *(slope[:, 0] for slope in slopes))
    moments = predicted_moment(frames, shapes).reshape(*grid, 2)
    tips = u[..., -1] * along[:, :1] + v[..., -1] * along[:, 1:2]
    readings = xp.concat([moments, tips[..., None]], -1)
    reading_by_antenna = (readings[:, 1:] - readings[:, :1]).mT / sizes
    point_force = xp.concat([shapes.contact_m, shapes.force_N], -1).reshape(*grid, 6)
    point_force_by_antenna = (point_force[:, 1:] - point_force[:, :1]).mT / sizes
    by_pose, tip_by_pose = _by_pose(rig_arrays, points, u[:, 0], v[:, 0], normals, along)
    image = [by_pose, by_antenna, xp.zeros_like(by_antenna[..., :2])]
    no_moment = xp.zeros_like(reading_by_antenna[:, :2, :POSES])
    reading = [xp.concat([no_moment, tip_by_pose], 1), reading_by_antenna, _by_sensor(rig_arrays, moments[:, 0])]
    if rig_arrays.rig.with_lens:
        by_lens = rig_arrays.rig.camera.lens_slopes_at(prediction.nodes)
        by_lens = xp.where(xp.isfinite(by_lens), by_lens, xp.zeros_like(by_lens))
        image.append(-dot(normals[..., None, :], by_lens.mT))  # the lens moves the seen points, not the curve
        tip_by_lens = -dot(along[:, None, :2], by_lens[:, -1].mT)[:, None]
        reading.append(xp.concat([0.0 * image[-1][:, :2], tip_by_lens], 1))
    if rig_arrays.rig.tip is not None:
        image.append(xp.zeros_like(by_antenna[..., :1]))
        reading.append(xp.stack([0.0 * along[:, 2], 0.0 * along[:, 2], along[:, 2]], 1)[..., None])
    found = (
        xp.concat(image, -1) @ rig_arrays.axes,
        (xp.concat(reading, -1) @ rig_arrays.axes) * frames.available[..., None],
        point_force_by_antenna @ rig_arrays.axes[POSES : POSES + ANTENNA],
    )
    line = _by_line(rig_arrays, prediction)
    if line.shape[-1] == 0:
        return RigJacobian(*found)
    none = (0.0 * part[:, 0, :, None] * rig_arrays.line for part in (readings, point_force))
    return RigJacobian(*(xp.concat([part, own], -1) for part, own in zip(found, (line, *none), strict=True)))


def _by_line(rig_arrays: RigArrays, prediction: Prediction) -> Array:
    """(B, M, L) displacement along the normals by the found line's own errors, of unit deviation."""
    xp = namespace(prediction.depth)
    if rig_arrays.line.shape[0] == 0:
        return prediction.depth[..., :0]
    nodes = arange_like(prediction.depth, prediction.nodes.shape[1]) + 0.0 * prediction.nodes[..., 0]
    along = 2.0 * prediction.arclength(nodes) / prediction.length_m - 1.0
    return xp.stack([xp.ones_like(along), along, 1.5 * along * along - 0.5], -1) * rig_arrays.line


def _by_pose(
    rig_arrays: RigArrays, points_m: Array, u: Array, v: Array, normals: Array, along: Array
) -> tuple[Array, Array]:
    """(B, M, 6) displacement along the normals by the pose's tangent, and (B, 1, 6) of the end along the antenna."""
    found, tips = [], []
    for index in range(1, POSES + 1):
        moved_u, moved_v, _ = project(rig_arrays, points_m, index)
        moved = (moved_u - u) * normals[..., 0] + (moved_v - v) * normals[..., 1]
        found.append(moved / float(RIG_STEPS[index - 1]))
        tip = (moved_u - u)[:, -1] * along[:, 0] + (moved_v - v)[:, -1] * along[:, 1]
        tips.append(tip / float(RIG_STEPS[index - 1]))
    xp = namespace(u)
    return xp.stack(found, -1), xp.stack(tips, -1)[:, None]


def _by_sensor(rig_arrays: RigArrays, predicted: Array) -> Array:
    """(B, 3, 2) derivatives of what is read, in deviations, by gain and offset of the sensor about y.

    predicted : (B, 2) moments, in deviations.
    """
    xp = namespace(predicted)
    moment = (predicted[:, 0] * rig_arrays.std[0] - rig_arrays.offset[0]) / rig_arrays.gain[0]
    about_y = xp.stack([moment, xp.ones_like(moment)], -1) / rig_arrays.std[0]
    return xp.stack([about_y, xp.zeros_like(about_y), xp.zeros_like(about_y)], 1)


def _force_by_friction(rig_arrays: RigArrays, shapes: Curves, point_force: Array) -> Array:
    """(B, 1, 6) derivative by friction on the rungs whose shapes do not depend on it: only the force turns."""
    xp = namespace(point_force)
    tangent = shapes.tangents[:: len(shapes.tangents) // len(point_force), CONTACT][:, None]
    size = xp.sqrt((point_force[..., 3:] ** 2).sum(-1))[..., None] * rig_arrays.friction_rad
    return xp.concat([xp.zeros_like(tangent), -size * tangent], -1)
