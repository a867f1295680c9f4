"""What the model predicts of frames at given unknowns, and how that moves with them and with the rig.

Everything lives on the nodes of the predicted curves. Between nodes the picture's normal displacement is taken as
linear, which costs a ten-thousandth of it; the curve itself is not (`match`).
"""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.rungs import curves
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.core.arrays import Array, namespace
from vbaa_calib.rig import RIG_PARAMETERS, RIG_STEPS

from .curves import cubics, dot, image_slopes, project
from .frames import Frames
from .rig_arrays import ANTENNA, POSES, UNKNOWNS, Known

STEP = 1e-4
"""Finite-difference step of each unknown."""
TIP = 1.0
"""The tip's distance in antenna lengths."""
LINEAR = "linear"
LEANING = ("elastica", "rod")
"""The rungs on which friction has an effect."""


@dataclass(frozen=True, eq=False)
class View:
    """B predicted curves on their M nodes, in the picture.

    Attributes
    ----------
    points_m, tangents : (B, M, 3) antenna frame.
    contact_m : (B,) arc length of the contact, the node `antenna.shape.CONTACT`.
    nodes : (B, M, 2) ideal image points. cubics : (B, M, 8) the curves between them, see `cubics`.
    depth : (B, M, 1) before the camera, m.
    normals : (B, M, 2) unit normals of the image curve.
    columns : (B, M, 4) displacement of the image along the normals by the unknowns.
    misfit : (B, 2) readings less prediction, in deviations of the sensors; 0 where there is no reading.
    by_moment : (B, 2, 4) how the predicted readings move with the unknowns, in deviations.
    touch, by_touch : (B, 6) contact point, m, and force, N, in the antenna frame, and their slopes (B, 6, 4).
    """

    length_m: float
    points_m: Array
    tangents: Array
    contact_m: Array
    nodes: Array
    cubics: Array
    depth: Array
    normals: Array
    columns: Array
    misfit: Array
    by_moment: Array
    touch: Array
    by_touch: Array


@dataclass(frozen=True, eq=False)
class RigTable:
    """How a prediction moves with the rig along its R independent axes.

    Attributes
    ----------
    nodes, readings, touch : (B, M, R), (B, 2, R), (B, 6, R) as in `View`.
    """

    nodes: Array
    readings: Array
    touch: Array


def antennas(frames: Frames, rung: str, unknowns: Array, steps: Array | None = None) -> Curves:
    """B·K shapes for unknowns (B, K, 4); `steps` (B, K, 9) moves the antenna's parameters."""
    xp, known = namespace(unknowns), frames.known
    grid = unknowns.shape[:2]
    parameters = known.parameters if steps is None else known.parameters + steps
    flat = unknowns.reshape(-1, UNKNOWNS)
    return curves(
        rung,
        xp.broadcast_to(parameters, (*grid, ANTENNA)).reshape(-1, ANTENNA),
        known.length_m,
        xp.broadcast_to(frames.gravity_m_s2[:, None], (*grid, 3)).reshape(-1, 3),
        flat[:, 0] * known.length_m,
        flat[:, 1:3] * known.force_unit_N,
        flat[:, 3] * known.friction_rad if known.friction_rad > 0.0 else None,
    )


def look(frames: Frames, rung: str, unknowns: Array, slopes: bool = True) -> View:
    """The prediction at unknowns (B, 4), with its finite differences unless no slopes by the unknowns are asked for."""
    xp, known = namespace(unknowns), frames.known
    free = (UNKNOWNS if known.friction_rad > 0.0 and rung in LEANING else UNKNOWNS - 1) if slopes else 0
    ones = xp.ones_like(unknowns[:, :1])
    signs = xp.concat([xp.where(unknowns[:, :1] + STEP > TIP, -ones, ones)] + [ones] * (UNKNOWNS - 1), -1)[:, :free]
    trials = xp.concat([ones, signs], -1)[..., None] * known.trials[: free + 1]
    shapes = antennas(frames, rung, unknowns[:, None] + STEP * trials)
    grid = len(frames), free + 1
    u, v, depth = (part.reshape(*grid, -1) for part in project(known, shapes.points_m))
    points, tangents = (vectors.reshape(*grid, -1, 3)[:, 0] for vectors in (shapes.points_m, shapes.tangents))
    slope_u, slope_v = image_slopes(known, tangents, u[:, 0], v[:, 0], depth[:, 0])
    size = xp.clip(xp.hypot(slope_u, slope_v), 1e-30, None)
    normal_u, normal_v = -slope_v / size, slope_u / size
    displaced_by = (u[:, 1:] - u[:, :1]) * normal_u[:, None] + (v[:, 1:] - v[:, :1]) * normal_v[:, None]
    columns = displaced_by / (STEP * signs[..., None])
    felt = readings(frames, shapes).reshape(*grid, 2)
    by_moment = (felt[:, 1:] - felt[:, :1]) / (STEP * signs[..., None])
    touch = xp.concat([shapes.contact_m, shapes.force_N], -1).reshape(*grid, 6)
    by_touch = (touch[:, 1:] - touch[:, :1]) / (STEP * signs[..., None])
    if 0 < free < UNKNOWNS:
        columns = xp.concat([columns, xp.zeros_like(columns[:, :1])], 1)
        by_moment = xp.concat([by_moment, xp.zeros_like(by_moment[:, :1])], 1)
        by_touch = xp.concat([by_touch, _leaning(known, shapes, touch[:, :1])], 1)
    misfit = (frames.reading_Nm / known.std - felt[:, 0]) * frames.felt
    contact = xp.clip(unknowns[:, 0], None, 1.0 - 1e-6) * known.length_m  # as `bend` keeps the nodes apart
    nodes = xp.stack([u[:, 0], v[:, 0]], -1)
    return View(
        known.length_m,
        points,
        tangents,
        contact,
        nodes,
        cubics(nodes, xp.stack([slope_u, slope_v], -1), contact, known.length_m),
        depth[:, 0, :, None],
        xp.stack([normal_u, normal_v], -1),
        columns.mT,
        misfit,
        by_moment.mT * frames.felt[..., None],
        touch[:, 0],
        by_touch.mT,
    )


def by_point(known: Known, view: View) -> Array:
    """(B, M, 3) displacement along the normals per metre that a node moves along each axis of the antenna frame."""
    rotation = known.rotations[0]
    # of n · (X/Z, Y/Z) by the point
    along = view.normals @ rotation[:2]
    return (along - dot(view.normals, view.nodes)[..., None] * rotation[2]) / view.depth


def displaced(view: View, other: View) -> tuple[Array, Array, Array]:
    """What another view of the same frames predicts, less this one: along the normals (B, M), felt (B, 2), and contact
    point and force (B, 6)."""
    return dot(other.nodes - view.nodes, view.normals), view.misfit - other.misfit, other.touch - view.touch


def readings(frames: Frames, shapes: Curves) -> Array:
    """(B·K, 2) what the sensors would read for B·K shapes, in their deviations."""
    xp, known = namespace(shapes.points_m), frames.known
    about_z = xp.zeros_like(shapes.moment_Nm)
    if known.rig.second_moment_sensor is not None:
        about_z = _moment_about_z(frames, shapes)
    return (known.gain * xp.stack([shapes.moment_Nm, about_z], -1) + known.offset) / known.std


def _moment_about_z(frames: Frames, shapes: Curves) -> Array:
    """(B·K,) x·f_y − y·f_x of force and weight about the antenna frame's origin, N·m."""
    xp = namespace(shapes.points_m)
    contact, force = shapes.points_m[:, CONTACT], shapes.force_N
    widths = shapes.arclength_m[:, 1:] - shapes.arclength_m[:, :-1]
    middles = 0.5 * (shapes.points_m[:, 1:, :2] + shapes.points_m[:, :-1, :2])
    centre = (middles * widths[..., None]).sum(1)
    weight = xp.exp(frames.known.parameters[7]) * frames.gravity_m_s2
    weight = xp.broadcast_to(weight[:, None], (len(frames), len(force) // len(frames), 3)).reshape(-1, 3)
    by_force = contact[:, 0] * force[:, 1] - contact[:, 1] * force[:, 0]
    return by_force + centre[:, 0] * weight[:, 1] - centre[:, 1] * weight[:, 0]


def rig_table(frames: Frames, rung: str, unknowns: Array, view: View) -> RigTable:
    """The rig's influence at unknowns (B, 4) on a view of them, by one rung of the ladder.

    The paper's rung knows neither clamp nor weight nor bow: what they may do is taken from the next one.
    """
    xp, known = namespace(unknowns), frames.known
    if known.axes.shape[1] == 0:
        return RigTable(view.nodes[..., :0], view.by_moment[..., :0], view.by_touch[..., :0])
    grid = len(frames), ANTENNA + 1
    moves = xp.broadcast_to(known.moves, (*grid, ANTENNA))
    rung = LINEAR if rung == "paper" else rung
    shapes = antennas(frames, rung, xp.broadcast_to(unknowns[:, None], (*grid, UNKNOWNS)), moves)
    u, v, _ = (part.reshape(*grid, -1) for part in project(known, shapes.points_m))
    points = shapes.points_m.reshape(*grid, -1, 3)[:, 0]
    sizes = known.moves[1:].sum(0)
    along_u, along_v = view.normals[:, None, :, 0], view.normals[:, None, :, 1]
    by_antenna = ((u[:, 1:] - u[:, :1]) * along_u + (v[:, 1:] - v[:, :1]) * along_v).mT / sizes
    felt = readings(frames, shapes).reshape(*grid, 2)
    felt_by_antenna = (felt[:, 1:] - felt[:, :1]).mT / sizes
    by_sensor = _by_sensor(known, felt[:, 0])
    touch = xp.concat([shapes.contact_m, shapes.force_N], -1).reshape(*grid, 6)
    touched = (touch[:, 1:] - touch[:, :1]).mT / sizes
    pictured = [_by_pose(known, points, u[:, 0], v[:, 0], view.normals), by_antenna, xp.zeros_like(by_antenna[..., :2])]
    felt = [xp.zeros_like(felt_by_antenna[..., :POSES]), felt_by_antenna, by_sensor]
    if len(known.axes) > len(RIG_PARAMETERS):
        by_lens = known.rig.camera.lens_slopes_at(view.nodes)
        by_lens = xp.where(xp.isfinite(by_lens), by_lens, xp.zeros_like(by_lens))
        # a seen point that moves one way is a curve that moves the other
        pictured.append(-dot(view.normals[..., None, :], by_lens.mT))
        felt.append(xp.zeros_like(pictured[-1][:, :2]))
    return RigTable(
        xp.concat(pictured, -1) @ known.axes,
        (xp.concat(felt, -1) @ known.axes) * frames.felt[..., None],
        touched @ known.axes[POSES : POSES + ANTENNA],
    )


def _by_pose(known: Known, points_m: Array, u: Array, v: Array, normals: Array) -> Array:
    """(B, M, 6) displacement along the normals by the pose's tangent."""
    found = []
    for index in range(1, POSES + 1):
        moved_u, moved_v, _ = project(known, points_m, index)
        moved = (moved_u - u) * normals[..., 0] + (moved_v - v) * normals[..., 1]
        found.append(moved / float(RIG_STEPS[index - 1]))
    return namespace(u).stack(found, -1)


def _by_sensor(known: Known, felt: Array) -> Array:
    """(B, 2, 2) how the readings (B, 2), in deviations, move with gain and offset of the sensor about y."""
    xp = namespace(felt)
    moment = (felt[:, 0] * known.std[0] - known.offset[0]) / known.gain[0]
    about_y = xp.stack([moment, xp.ones_like(moment)], -1) / known.std[0]
    return xp.stack([about_y, xp.zeros_like(about_y)], 1)


def _leaning(known: Known, shapes: Curves, touch: Array) -> Array:
    """(B, 1, 6) what friction adds to the force on the rungs that do not bend by it, by its deviation."""
    xp = namespace(touch)
    tangent = shapes.tangents[:: len(shapes.tangents) // len(touch), CONTACT][:, None]
    size = xp.sqrt((touch[..., 3:] ** 2).sum(-1))[..., None] * known.friction_rad
    return xp.concat([xp.zeros_like(tangent), -size * tangent], -1)
