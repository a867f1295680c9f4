"""The ladder's shapes, eight at a time: clamp, bow, weight and one point force to a curve in space.

The force's bending is the planar elastica, exact in the deformation plane 𝒟; weight, natural bow and what couples them
to the force are a small rotation field on top of it, refined by sweeps of the equilibrium of moments
(`antenna.equilibrium`, docs/theory_estimator.md). Rows of eight numbers, (..., LANES), belong to eight shapes, which
know nothing of each other: what is not a number in one leaves the others alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import compiled, kernel
from vbaa_calib.core.lanes import (
    LANES,
    Lanes,
    cos,
    exp,
    lane_of,
    load,
    load_from,
    sin,
    spread,
    sqrt,
    store,
    where_positive,
)

from .equilibrium import NODES, Frame, Loads, Vector, added, equilibrium, integrated, put, times, vector
from .nodes import (
    CONTACT,
    INNER_CURVE,
    INNER_NODES,
    NEAREST_TO_TIP,
    NODES_BEYOND,
    NODES_TO_CONTACT,
    OUTER_CURVE,
    OUTER_NODES,
    chebyshev,
    integration,
    interpolation,
)
from .pendulum import sine_and_cosine

RUNGS = ("paper", "linear", "elastica", "rod")
"""Lowest first, see `antenna.rungs`."""
_PAPER, _LINEAR, _ELASTICA = 0, 1, 2
ELASTICA_SWEEPS, ROD_SWEEPS = 1, 4
"""Passes over the equilibrium of moments.

Largest distance from `antenna.rod` in 60 antennas bowed by 0.2 /m, clamped 1° askew, gravity in all directions,
friction of ±0.3 rad, with the contact's slope at 20°, 35° and 45°, in µm: one sweep 87, 298, 570; two 3.4, 17, 41;
three 0.14, 1.0, 2.8; four 0.006, 0.06, 0.21.
"""
CURVE_NODES = NODES_TO_CONTACT + NODES_BEYOND

_TO_INNER_CURVE = integration(chebyshev(INNER_NODES), INNER_CURVE)
_TO_OUTER_CURVE = integration(chebyshev(OUTER_NODES), OUTER_CURVE)
_AT_INNER_CURVE = interpolation(chebyshev(INNER_NODES), INNER_CURVE)
_AT_OUTER_CURVE = interpolation(chebyshev(OUTER_NODES), OUTER_CURVE)
NODE_ROWS = -(-CURVE_NODES // LANES)
"""Rows of eight for all nodes of one shape."""
_BY_INNER_NODE = np.ascontiguousarray(_AT_INNER_CURVE.T)
_BY_OUTER_NODE = np.ascontiguousarray(np.pad(_AT_OUTER_CURVE.T, ((0, 0), (0, -NODES_BEYOND % LANES))))
_INNER_ROWS = NODES_TO_CONTACT // LANES


class Presses(NamedTuple):
    """Antennas and what bends them, see `shape.bend`: rows of a batch B in `bend_batch`, (..., LANES) elsewhere.

    Attributes
    ----------
    parameters : (B, 9) or (9, LANES). gravity_m_s2 : (B, 3) or (3, LANES). force_N : (B, 2) or (2, LANES).
    contact_m, friction_rad : (B,) or (LANES,).
    """

    parameters: np.ndarray
    length_m: float
    gravity_m_s2: np.ndarray
    contact_m: np.ndarray
    force_N: np.ndarray
    friction_rad: np.ndarray


class Bent(NamedTuple):
    """Shapes on their M nodes, see `shape.Curves`.

    Attributes
    ----------
    points_m : (B, M, 3) or (3, M, LANES).
    tangents : (B, M, 3) or (3, M, LANES); (3, NODE_ROWS, LANES) for the first shape's alone, node after node, or
        (3, 0, LANES) for none.
    force_N : (B, 3) or (3, LANES). moment_Nm : (B,) or (LANES,).
    """

    points_m: np.ndarray
    tangents: np.ndarray
    force_N: np.ndarray
    moment_Nm: np.ndarray


@kernel
def bend_batch(rung: int, dead: bool, sweeps: int, presses: Presses, bent: Bent) -> None:
    """B shapes, LANES at a time. The upper rungs take the sweeps and whether the forces are dead."""
    some = Presses(
        np.empty((9, LANES)),
        presses.length_m,
        np.empty((3, LANES)),
        np.empty(LANES),
        np.empty((2, LANES)),
        np.empty(LANES),
    )
    nodes = (3, CURVE_NODES, LANES)
    made = Bent(np.empty(nodes), np.empty(nodes), np.empty((3, LANES)), np.empty(LANES))
    count = len(presses.contact_m)
    for start in range(0, count, LANES):
        for lane in range(LANES):
            # what is left of the last eight repeats the last shape
            row = min(start + lane, count - 1)
            some.parameters[:, lane] = presses.parameters[row]
            some.gravity_m_s2[:, lane] = presses.gravity_m_s2[row]
            some.force_N[:, lane] = presses.force_N[row]
            some.contact_m[lane], some.friction_rad[lane] = presses.contact_m[row], presses.friction_rad[row]
        _bend(rung, dead, sweeps, some, made)
        for lane in range(min(LANES, count - start)):
            row = start + lane
            for node in range(CURVE_NODES):
                for axis in range(3):
                    bent.points_m[row, node, axis] = made.points_m[axis, node, lane]
                    bent.tangents[row, node, axis] = made.tangents[axis, node, lane]
            bent.force_N[row] = made.force_N[:, lane]
            bent.moment_Nm[row] = made.moment_Nm[lane]


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
    """LANES shapes as a rung of the ladder sees them, under the same gravity (3,).

    The other arrays are those of `Presses` and, written, `Bent`.
    """
    weights = np.empty((3, LANES))
    for axis in range(3):
        store(weights, spread(gravity[axis]), axis)
    presses = Presses(parameters, length_m, weights, contact_m, force_N, friction_rad)
    sweeps = ELASTICA_SWEEPS if rung == _ELASTICA else ROD_SWEEPS
    _bend(rung, False, sweeps, presses, Bent(points_m, tangents, shape_force_N, moment_Nm))


@compiled
def _bend(rung: int, dead: bool, sweeps: int, presses: Presses, bent: Bent) -> None:
    if rung <= _LINEAR:
        _bend_little(rung == _PAPER, presses, bent)
    else:
        _bend_far(dead, sweeps, presses, bent)


@compiled
def _bend_far(dead: bool, sweeps: int, presses: Presses, bent: Bent) -> None:
    """Large deflections."""
    parameters, length_m = presses.parameters, presses.length_m
    contact = _on_shaft(load(presses.contact_m), length_m)
    stiffness = exp(load(parameters, 6))
    clamp = _rotation(load(parameters, 2), load(parameters, 3))
    applied = (spread(0.0), load(presses.force_N, 0) / stiffness, load(presses.force_N, 1) / stiffness)
    lean = load(presses.friction_rad)
    if dead:
        applied = _turned_back(clamp, applied)
        lean = spread(0.0)
    along, y, z = applied
    size = sqrt(y * y + z * z)
    # the force's direction; along y where there is none
    y, z = where_positive(size, y / size, 1.0), where_positive(size, z / size, z)
    frame = _rolled(clamp, y, z)
    weight = times(exp(load(parameters, 7)) / stiffness, _row(presses.gravity_m_s2))
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
    if bent.tangents.shape[1] == CURVE_NODES:
        zero = spread(0.0), spread(0.0), spread(0.0)
        integrated(_AT_INNER_CURVE, nodes, 0, zero, bent.tangents, 0)
        integrated(_AT_OUTER_CURVE, nodes, INNER_NODES, zero, bent.tangents, NODES_TO_CONTACT)
    elif bent.tangents.shape[1]:
        _first_tangents(nodes, bent.tangents)
    for node in range(NODES):
        side = contact if node < INNER_NODES else length_m - contact
        put(nodes, times(side, vector(nodes, node)), node)
    beside_y, beside_z = load(parameters, 0), load(parameters, 1)
    integrated(_TO_INNER_CURVE, nodes, 0, (spread(0.0), beside_y, beside_z), bent.points_m, 0)
    integrated(_TO_OUTER_CURVE, nodes, INNER_NODES, vector(bent.points_m, CONTACT), bent.points_m, NODES_TO_CONTACT)
    force = _turned(frame, found.force_per_m2)
    _put_force(bent.force_N, times(stiffness, force))
    # about the antenna frame's origin: the clamp stands aside by (0, y, z)
    _, moment, _ = _turned(frame, found.moment_per_m)
    store(bent.moment_Nm, -stiffness * (moment + beside_z * (force[0] + length_m * weight[0])))


@compiled
def _first_tangents(nodes: np.ndarray, tangents: np.ndarray) -> None:
    """Interpolate the first shape's tangents, eight nodes at a time."""
    for axis in range(3):
        for row in range(_INNER_ROWS):
            total = spread(0.0)
            for node in range(INNER_NODES):
                total = total + nodes[axis, node, 0] * load_from(_BY_INNER_NODE, node, LANES * row)
            store(tangents, total, axis, row)
        for row in range(NODE_ROWS - _INNER_ROWS):
            total = spread(0.0)
            for node in range(OUTER_NODES):
                total = total + nodes[axis, INNER_NODES + node, 0] * load_from(_BY_OUTER_NODE, node, LANES * row)
            store(tangents, total, axis, _INNER_ROWS + row)


@compiled
def _put_tangent(tangents: np.ndarray, v: Vector, node: int) -> None:
    """Write the tangents at a node, of all shapes or of the first."""
    if tangents.shape[1] == CURVE_NODES:
        put(tangents, v, node)
    else:
        for axis in range(3):
            tangents[axis, node // LANES, node % LANES] = lane_of(v[axis], 0)


@compiled
def _curve_arclength(contact: Lanes, length_m: float, node: int) -> Lanes:
    if node < NODES_TO_CONTACT:
        return contact * INNER_CURVE[node]
    return contact + (length_m - contact) * OUTER_CURVE[node - NODES_TO_CONTACT]


@compiled
def _row(rows: np.ndarray) -> Vector:
    return load(rows, 0), load(rows, 1), load(rows, 2)


@compiled
def _put_force(forces: np.ndarray, v: Vector) -> None:
    for axis in range(3):
        store(forces, v[axis], axis)


@compiled
def _on_shaft(contact_m: Lanes, length_m: float) -> Lanes:
    """Contacts kept from the very tip, which would leave nothing beyond them: a micrometre in a metre."""
    limit = (1.0 - NEAREST_TO_TIP) * length_m
    return where_positive(contact_m - limit, limit, contact_m)


@compiled
def _rotation(about_y: Lanes, about_z: Lanes) -> Frame:
    """Rotation by the vector (0, y, z) in rad: Rodrigues' formula."""
    half = 0.5 * sqrt(about_y * about_y + about_z * about_z)
    half_sinc = where_positive(half, sin(half) / half, 1.0)
    sine, versine = half_sinc * cos(half), 0.5 * half_sinc * half_sinc
    y, z = sine * about_y, sine * about_z
    y_square, z_square, both = versine * about_y * about_y, versine * about_z * about_z, versine * about_y * about_z
    return (1.0 - y_square - z_square, z, -y), (-z, 1.0 - z_square, both), (y, both, 1.0 - y_square)


@compiled
def _rolled(frame: Frame, y: Lanes, z: Lanes) -> Frame:
    """The frame turned about its x, so that its y points to where (y, z) did."""
    x_axis, y_axis, z_axis = frame
    return x_axis, added(times(y, y_axis), times(z, z_axis)), added(times(y, z_axis), times(-z, y_axis))


@compiled
def _turned(frame: Frame, v: Vector) -> Vector:
    """From the frame's components to those that its axes are given in."""
    return added(added(times(v[0], frame[0]), times(v[1], frame[1])), times(v[2], frame[2]))


@compiled
def _turned_back(frame: Frame, v: Vector) -> Vector:
    """Into the frame's components."""
    x_axis, y_axis, z_axis = frame
    return (
        x_axis[0] * v[0] + x_axis[1] * v[1] + x_axis[2] * v[2],
        y_axis[0] * v[0] + y_axis[1] * v[1] + y_axis[2] * v[2],
        z_axis[0] * v[0] + z_axis[1] * v[1] + z_axis[2] * v[2],
    )


@compiled
def _bend_little(paper: bool, presses: Presses, bent: Bent) -> None:
    """Small deflections of contact, lateral weight, bow, clamp and its give, superposed (`linear`).

    The paper's beam has the contact alone. A contact before the clamp gives what is not a number.
    """
    contact = _on_shaft(load(presses.contact_m), presses.length_m)
    contact = where_positive(-contact, np.nan, contact)
    parameters, length_m = presses.parameters, presses.length_m
    stiffness, force_y, force_z = exp(load(parameters, 6)), load(presses.force_N, 0), load(presses.force_N, 1)
    zero = spread(0.0)
    start_y, start_z, turn_y, turn_z, bow_y, bow_z = zero, zero, zero, zero, zero, zero
    weight_x, weight_y, weight_z, friction = zero, zero, zero, zero
    held_y, held_z = contact * force_y, contact * force_z
    if not paper:
        start_y, start_z = load(parameters, 0), load(parameters, 1)
        linear_mass = exp(load(parameters, 7))
        weight_x, weight_y, weight_z = times(linear_mass, _row(presses.gravity_m_s2))
        held_y, held_z = held_y + 0.5 * length_m**2 * weight_y, held_z + 0.5 * length_m**2 * weight_z
        # turned or bowed about z the antenna goes to +y, about y to −z
        give = load(parameters, 8) / stiffness
        turn_y, turn_z = load(parameters, 3) + give * held_y, give * held_z - load(parameters, 2)
        bow_y, bow_z = load(parameters, 5), -load(parameters, 4)
        sin_lean, cos_lean = sine_and_cosine(load(presses.friction_rad))
        friction = -sqrt(force_y * force_y + force_z * force_z) * (sin_lean / cos_lean)
    slopes_at_contact = zero, zero
    for node in range(CURVE_NODES):
        s = _curve_arclength(contact, length_m, node)
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
        put(bent.points_m, (s, y, z), node)
        if bent.tangents.shape[1]:
            x = 1.0 / sqrt(1.0 + y_slope * y_slope + z_slope * z_slope)
            _put_tangent(bent.tangents, (x, y_slope * x, z_slope * x), node)
        if node == CONTACT:
            slopes_at_contact = y_slope, z_slope
    # what the force along x adds to shape and moment is of second order; its direction in the world it is not
    along = friction - force_y * slopes_at_contact[0] - force_z * slopes_at_contact[1]
    _put_force(bent.force_N, (along, force_y, force_z))
    store(bent.moment_Nm, held_z - start_z * (friction + length_m * weight_x))
