"""The ladder's shapes, eight at a time: clamp, bow, weight and one point force to a curve in space.

The force's bending is the planar elastica, exact in the deformation plane 𝒟; weight, natural bow and what couples them
to the force are a small rotation field on top of it, refined by sweeps of the equilibrium of moments
(`antenna.equilibrium`, docs/theory_estimator.md). Rows of eight numbers, (..., LANES), belong to eight shapes, which
know nothing of each other: what is not a number in one leaves the others alone.
"""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.compiled import kernel

from .equilibrium_kernel import NODES, Frame, Loads, Vector, added, equilibrium, put, summed, times, vector
from .lanes import LANES, Lanes, cos, exp, lane_of, load, sin, spread, sqrt, store, where_positive
from .nodes import CONTACT, INNER_NODES, NODES_BEYOND, NODES_TO_CONTACT, grid_like

RUNGS = ("paper", "linear", "elastica", "rod")
_PAPER, _LINEAR, _ELASTICA = 0, 1, 2
_ELASTICA_SWEEPS, _ROD_SWEEPS = 1, 4
CURVE_NODES = NODES_TO_CONTACT + NODES_BEYOND

_GRID = grid_like(np.empty(0))
_CURVE_INNER, _CURVE_OUTER = _GRID.curve_inner, _GRID.curve_outer
_TO_INNER = np.ascontiguousarray(_GRID.to_curve[:INNER_NODES, :NODES_TO_CONTACT].T)
_TO_OUTER = np.ascontiguousarray(_GRID.to_curve[INNER_NODES:, NODES_TO_CONTACT:].T)
_AT_INNER = np.ascontiguousarray(_GRID.at_curve[:INNER_NODES, :NODES_TO_CONTACT].T)
_AT_OUTER = np.ascontiguousarray(_GRID.at_curve[INNER_NODES:, NODES_TO_CONTACT:].T)


@kernel
def bend_lanes(
    rung: int,
    parameters: np.ndarray,
    length_m: float,
    gravity: np.ndarray,
    contact_m: np.ndarray,
    force_N: np.ndarray,
    friction_rad: np.ndarray,
    points_m: np.ndarray,
    tangents: np.ndarray,
    shape_force_N: np.ndarray,
    moment_Nm: np.ndarray,
) -> None:
    """LANES shapes as a rung of the ladder sees them, see `rungs.curves`.

    Parameters
    ----------
    rung : index in `RUNGS`.
    parameters : (9, LANES). gravity : (3,) antenna frame, the same for all. contact_m, friction_rad : (LANES,).
    force_N : (2, LANES).
    points_m : (3, M, LANES), written. tangents : (3, M, T), written for the first T shapes.
    shape_force_N : (3, LANES), written. moment_Nm : (LANES,), written.
    """
    weights = np.empty((3, LANES))
    for axis in range(3):
        store(weights, spread(gravity[axis]), axis)
    bend_each(
        rung,
        parameters,
        length_m,
        weights,
        contact_m,
        force_N,
        friction_rad,
        points_m,
        tangents,
        shape_force_N,
        moment_Nm,
    )


@kernel
def bend_each(
    rung: int,
    parameters: np.ndarray,
    length_m: float,
    gravity: np.ndarray,
    contact_m: np.ndarray,
    force_N: np.ndarray,
    friction_rad: np.ndarray,
    points_m: np.ndarray,
    tangents: np.ndarray,
    shape_force_N: np.ndarray,
    moment_Nm: np.ndarray,
) -> None:
    """As `bend_lanes`, with a gravity (3, LANES) for each."""
    if rung <= _LINEAR:
        _bend_little(
            rung == _PAPER,
            parameters,
            length_m,
            gravity,
            contact_m,
            force_N,
            friction_rad,
            points_m,
            tangents,
            shape_force_N,
            moment_Nm,
        )
    else:
        bend_far(
            False,
            _ELASTICA_SWEEPS if rung == _ELASTICA else _ROD_SWEEPS,
            parameters,
            length_m,
            gravity,
            contact_m,
            force_N,
            friction_rad,
            points_m,
            tangents,
            shape_force_N,
            moment_Nm,
        )


@kernel
def bend_far(
    dead: bool,
    sweeps: int,
    parameters: np.ndarray,
    length_m: float,
    gravity: np.ndarray,
    contact_m: np.ndarray,
    force_N: np.ndarray,
    friction_rad: np.ndarray,
    points_m: np.ndarray,
    tangents: np.ndarray,
    shape_force_N: np.ndarray,
    moment_Nm: np.ndarray,
) -> None:
    """Large deflections, see `shape.bend`; arrays as for `bend_each`."""
    contact = _on_shaft(load(contact_m), length_m)
    stiffness = exp(load(parameters, 6))
    clamp = _rotation(load(parameters, 2), load(parameters, 3))
    applied = (spread(0.0), load(force_N, 0) / stiffness, load(force_N, 1) / stiffness)
    lean = load(friction_rad)
    if dead:
        applied = _turned_back(clamp, applied)
        lean = spread(0.0)
    along, y, z = applied
    size = sqrt(y * y + z * z)
    # the force's direction; along y where there is none
    y, z = where_positive(size, y / size, 1.0), where_positive(size, z / size, z)
    frame = _rolled(clamp, y, z)
    weight = times(exp(load(parameters, 7)) / stiffness, (load(gravity, 0), load(gravity, 1), load(gravity, 2)))
    bow_y, bow_z = load(parameters, 4), load(parameters, 5)
    loads = Loads(
        contact,
        length_m,
        size,
        lean,
        dead,
        along,
        _turned_back(frame, weight),
        bow_y * y + bow_z * z,
        bow_z * y - bow_y * z,
        load(parameters, 8),
    )
    nodes = np.empty((3, NODES, LANES))
    found = equilibrium(loads, sweeps, nodes)
    x_axis, y_axis, z_axis = found.axes
    frame = _turned(frame, x_axis), _turned(frame, y_axis), _turned(frame, z_axis)
    for node in range(NODES):
        put(nodes, _turned(frame, vector(nodes, node)), node)
    beside_y, beside_z = load(parameters, 0), load(parameters, 1)
    _points(nodes, contact, length_m, (spread(0.0), beside_y, beside_z), points_m)
    if tangents.shape[2]:
        _tangents(nodes, tangents)
    force = _turned(frame, found.force_per_m2)
    _put_force(shape_force_N, times(stiffness, force))
    # about the antenna frame's origin: the clamp stands aside by (0, y, z)
    _, moment, _ = _turned(frame, found.moment_per_m)
    store(moment_Nm, -stiffness * (moment + beside_z * (force[0] + length_m * weight[0])))


@kernel
def _points(nodes: np.ndarray, contact: Lanes, length_m: float, start: Vector, points_m: np.ndarray) -> None:
    """Integrate the tangents (3, NODES, LANES)."""
    for node in range(NODES_TO_CONTACT):
        put(points_m, added(start, times(contact, summed(_TO_INNER, node, nodes, 0))), node)
    start, beyond = vector(points_m, CONTACT), length_m - contact
    for node in range(NODES_BEYOND):
        point = added(start, times(beyond, summed(_TO_OUTER, node, nodes, INNER_NODES)))
        put(points_m, point, NODES_TO_CONTACT + node)


@kernel
def _tangents(nodes: np.ndarray, tangents: np.ndarray) -> None:
    """Interpolate the tangents (3, NODES, LANES) of the first T shapes."""
    count = tangents.shape[2]
    for node in range(NODES_TO_CONTACT):
        _put_some(tangents, count, summed(_AT_INNER, node, nodes, 0), node)
    for node in range(NODES_BEYOND):
        _put_some(tangents, count, summed(_AT_OUTER, node, nodes, INNER_NODES), NODES_TO_CONTACT + node)


@kernel
def _put_some(field: np.ndarray, count: int, v: Vector, node: int) -> None:
    """Write the first vectors of a field at a node."""
    if count == LANES:
        put(field, v, node)
    else:
        for axis in range(3):
            for lane in range(count):
                field[axis, node, lane] = lane_of(v[axis], lane)


@kernel
def _put_force(forces: np.ndarray, v: Vector) -> None:
    for axis in range(3):
        store(forces, v[axis], axis)


@kernel
def _on_shaft(contact_m: Lanes, length_m: float) -> Lanes:
    """Contacts kept from the very tip, which would leave nothing beyond them: a micrometre in a metre."""
    limit = (1.0 - 1e-6) * length_m
    return where_positive(contact_m - limit, limit, contact_m)


@kernel
def _rotation(about_y: Lanes, about_z: Lanes) -> Frame:
    """Rotation by the vector (0, y, z) in rad: Rodrigues' formula."""
    angle = sqrt(about_y * about_y + about_z * about_z)
    half = 0.5 * angle
    half_sinc = where_positive(angle, sin(half) / half, 1.0)
    sine, versine = where_positive(angle, sin(angle) / angle, 1.0), 0.5 * half_sinc * half_sinc
    y, z = sine * about_y, sine * about_z
    y_square, z_square, both = versine * about_y * about_y, versine * about_z * about_z, versine * about_y * about_z
    return (1.0 - y_square - z_square, z, -y), (-z, 1.0 - z_square, both), (y, both, 1.0 - y_square)


@kernel
def _rolled(frame: Frame, y: Lanes, z: Lanes) -> Frame:
    """The frame turned about its x, so that its y points to where (y, z) did."""
    x_axis, y_axis, z_axis = frame
    return x_axis, added(times(y, y_axis), times(z, z_axis)), added(times(y, z_axis), times(-z, y_axis))


@kernel
def _turned(frame: Frame, v: Vector) -> Vector:
    """From the frame's components to those that its axes are given in."""
    return added(added(times(v[0], frame[0]), times(v[1], frame[1])), times(v[2], frame[2]))


@kernel
def _turned_back(frame: Frame, v: Vector) -> Vector:
    """Into the frame's components."""
    x_axis, y_axis, z_axis = frame
    return (
        x_axis[0] * v[0] + x_axis[1] * v[1] + x_axis[2] * v[2],
        y_axis[0] * v[0] + y_axis[1] * v[1] + y_axis[2] * v[2],
        z_axis[0] * v[0] + z_axis[1] * v[1] + z_axis[2] * v[2],
    )


@kernel
def _bend_little(
    paper: bool,
    parameters: np.ndarray,
    length_m: float,
    gravity: np.ndarray,
    contact_m: np.ndarray,
    force_N: np.ndarray,
    friction_rad: np.ndarray,
    points_m: np.ndarray,
    tangents: np.ndarray,
    shape_force_N: np.ndarray,
    moment_Nm: np.ndarray,
) -> None:
    """Small deflections of contact, lateral weight, bow, clamp and its give, superposed (`linear`).

    The paper's beam has the contact alone. A contact before the clamp gives what is not a number.
    """
    contact = _on_shaft(load(contact_m), length_m)
    contact = where_positive(-contact, np.nan, contact)
    stiffness, force_y, force_z = exp(load(parameters, 6)), load(force_N, 0), load(force_N, 1)
    zero = spread(0.0)
    start_y, start_z, turn_y, turn_z, bow_y, bow_z = zero, zero, zero, zero, zero, zero
    weight_x, weight_y, weight_z, friction = zero, zero, zero, zero
    held_y, held_z = contact * force_y, contact * force_z
    if not paper:
        start_y, start_z = load(parameters, 0), load(parameters, 1)
        linear_mass = exp(load(parameters, 7))
        weight_x, weight_y, weight_z = times(linear_mass, (load(gravity, 0), load(gravity, 1), load(gravity, 2)))
        held_y, held_z = held_y + 0.5 * length_m**2 * weight_y, held_z + 0.5 * length_m**2 * weight_z
        # turned or bowed about z the antenna goes to +y, about y to −z
        give = load(parameters, 8) / stiffness
        turn_y, turn_z = load(parameters, 3) + give * held_y, give * held_z - load(parameters, 2)
        bow_y, bow_z = load(parameters, 5), -load(parameters, 4)
        lean = load(friction_rad)
        friction = -sqrt(force_y * force_y + force_z * force_z) * (sin(lean) / cos(lean))
    slopes_at_contact = zero, zero
    for node in range(CURVE_NODES):
        s = contact * _CURVE_INNER[node] + (length_m - contact) * _CURVE_OUTER[node]
        s = where_positive(s - length_m, length_m, s)
        near, far = where_positive(contact - s, s, contact), where_positive(contact - s, contact, s)
        push = (3.0 * far - near) * near * near / (6.0 * stiffness)
        push_slope = (2.0 * contact - near) * near / (2.0 * stiffness)
        sag = s * s * (6.0 * length_m**2 - 4.0 * length_m * s + s * s) / (24.0 * stiffness)
        sag_slope = s * (3.0 * length_m**2 - 3.0 * length_m * s + s * s) / (6.0 * stiffness)
        y = start_y + (turn_y + 0.5 * bow_y * s) * s + force_y * push + weight_y * sag
        z = start_z + (turn_z + 0.5 * bow_z * s) * s + force_z * push + weight_z * sag
        y_slope = turn_y + bow_y * s + force_y * push_slope + weight_y * sag_slope
        z_slope = turn_z + bow_z * s + force_z * push_slope + weight_z * sag_slope
        put(points_m, (s, y, z), node)
        if tangents.shape[2]:
            x = 1.0 / sqrt(1.0 + y_slope * y_slope + z_slope * z_slope)
            _put_some(tangents, tangents.shape[2], (x, y_slope * x, z_slope * x), node)
        if node == CONTACT:
            slopes_at_contact = y_slope, z_slope
    # what the force along x adds to shape and moment is of second order; its direction in the world it is not
    along = friction - force_y * slopes_at_contact[0] - force_z * slopes_at_contact[1]
    _put_force(shape_force_N, (along, force_y, force_z))
    store(moment_Nm, held_z - start_z * (friction + length_m * weight_x))
