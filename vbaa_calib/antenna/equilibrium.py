"""The equilibrium of moments along the antenna, by sweeps over a small rotation field on top of the elastica.

Seen from the contact, where the force on the antenna is known, the sections stand turned by P(s) = H(s)·Q(s): H is the
elastica's rotation by θ(s) − θ_c about z, Q that of the Cayley vector g(s) = tan(φ/2)·axis, which all other loads and
the bow need. With the internal force N(s) and its moment M(s), what lies beyond s on what lies before it,

    M(s) = ∫ₛᴸ t × N dσ,    m = Hᵀ M/EI,    δ = m − θ′ e_z,    b = κ₀ + (EI/GJ − 1)(τ·m) e_x,    τ = Q e_x
    g′ = ½ [(δ + b) − g × (δ − b) + (g·(δ + b)) g],    g(contact) = (roll, 0, 0)

b is what curves the antenna about axes of its own. δ is small: the contact force's moment is nearly all in θ′. What is
fixed at the clamp, weight and a dead force, is seen from the contact by P(0) R₀ᵀ, where R₀ is the clamp's give. The
roll is what makes the force's direction follow the antenna by the least rotation. A sweep from the clamp on would let
every error there swing the contact and its force about; from 90° of slope on such sweeps diverge.

Clamp's axes: x along the clamped tangent, y along the contact force's lateral part before it is turned. Contact's axes:
x along the antenna, the force in the plane of x and y. Fields are (3, NODES, LANES) on the nodes of `antenna.nodes`,
the elastica's rotations (3, NODES, LANES) their sine, cosine and slope; forces and moments are divided by EI.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from vbaa_calib.core.compiled import compiled
from vbaa_calib.core.lanes import LANES, Lanes, load, spread, store

from .nodes import INNER_NODES, OUTER_NODES, chebyshev, integration
from .pendulum import SERIES_LOAD, closed_form, hinge_by_series, landen, series_terms, sine_and_cosine

_TORSION_RATIO = 1.3
"""EI/GJ of a round wire, 1 + ν. Torsion turns the section, and with it the bow: hundredths of a millimetre."""

Vector: TypeAlias = tuple[Lanes, Lanes, Lanes]
Frame: TypeAlias = tuple[Vector, Vector, Vector]
"""Columns of rotation matrices: the axes of one frame along those of another."""

NODES = INNER_NODES + OUTER_NODES
_INNER, _OUTER = chebyshev(INNER_NODES), chebyshev(OUTER_NODES)
_INNER_FROM_CONTACT = integration(_INNER, _INNER) - integration(_INNER, np.ones(1))
_OUTER_FROM_CONTACT = integration(_OUTER, _OUTER)
_INNER_FROM_TIP, _OUTER_FROM_TIP = -_INNER_FROM_CONTACT, integration(_OUTER, np.ones(1)) - _OUTER_FROM_CONTACT
"""From values times their side's length to integrals: from the contact to s, and from s to the side's farther end."""


class Loads(NamedTuple):
    """What bends LANES antennas, along the clamp's axes and over EI.

    Attributes
    ----------
    contact_m, length_m : arc length of the contact, and of the tip, one for all.
    push_per_m2 : the contact force's component along the normal.
    lean_rad : angle of the whole force from the normal, positive towards the clamp.
    dead : the force keeps its direction; otherwise it follows the antenna's normal.
    dead_along_per_m2 : a dead force's component along x.
    weight_per_m3 : per length.
    bow_y_per_m, bow_z_per_m : natural curvature.
    give_m : of the clamp.
    """

    contact_m: Lanes
    length_m: float
    push_per_m2: Lanes
    lean_rad: Lanes
    dead: bool
    dead_along_per_m2: Lanes
    weight_per_m3: Vector
    bow_y_per_m: Lanes
    bow_z_per_m: Lanes
    give_m: Lanes


class _Equilibrium(NamedTuple):
    """The contact's axes along the clamp's; along the contact's the contact force, the loads' moment at the clamp."""

    axes: Frame
    force_per_m2: Vector
    moment_per_m: Vector


class _State(NamedTuple):
    """What the turns make of the loads: Q(0)·R₀ᵀ as a Cayley vector, the contact force along the contact's axes."""

    seen: Vector
    force: Vector


@compiled
def equilibrium(loads: Loads, sweeps: int, tangents: np.ndarray) -> _Equilibrium:
    """Sweep so many times, from the rotations that weight and bow cause by themselves. `tangents` is written."""
    work = np.empty((5, 3, NODES, LANES))
    hinge, field, local, moments, integrand = work[0], work[1], work[2], work[3], work[4]
    _elastica_hinge(loads, hinge)
    given = _first_turns(loads, hinge, field)
    state = _state(loads, hinge, field, given, local, tangents, moments, integrand)
    for _ in range(sweeps):
        given = _swept(loads, hinge, field, state, local, moments, integrand)
        state = _state(loads, hinge, field, given, local, tangents, moments, integrand)
    back = negative(state.seen)
    zero = spread(0.0)
    sine, cosine = load(hinge, 0, 0), load(hinge, 1, 0)
    x_axis = _turned(back, (cosine, -sine, zero))
    y_axis = _turned(back, (sine, cosine, zero))
    return _Equilibrium((x_axis, y_axis, cross(x_axis, y_axis)), state.force, vector(moments, 0))


@compiled
def _elastica_hinge(loads: Loads, hinge: np.ndarray) -> None:
    """The elastica's rotations from the contact's section to those at the nodes: −ψ."""
    sin_lean, cos_lean = sine_and_cosine(loads.lean_rad)
    leans = np.empty((2, LANES))
    force = loads.push_per_m2 / cos_lean
    store(leans, force * loads.contact_m * loads.contact_m, 0)
    store(leans, loads.lean_rad, 1)
    largest = 0.0
    for lane in range(LANES):
        amount = leans[0, lane]
        if amount > SERIES_LOAD:
            leans[0, lane] = 0.0
        elif amount > largest:
            largest = amount
    steepness = force * loads.contact_m
    hinge_by_series(load(leans, 0), sin_lean, cos_lean, series_terms(largest), _INNER, hinge)
    for node in range(INNER_NODES - 1, NODES):
        store(hinge, spread(0.0), 0, node)
        store(hinge, spread(1.0), 1, node)
        store(hinge, spread(0.0), 2, node)
    store(leans, force * loads.contact_m * loads.contact_m, 0)
    for lane in range(LANES):
        amount, lean = leans[0, lane], leans[1, lane]
        if amount > SERIES_LOAD and lane > 0 and amount == leans[0, 0] and lean == leans[1, 0]:
            # the same shape again: most lanes, where what does not bend it is moved
            for node in range(INNER_NODES - 1):
                for row in range(3):
                    hinge[row, node, lane] = hinge[row, node, 0]
        elif amount > SERIES_LOAD:
            chain = landen(0.5 * (1.0 - math.sin(lean)))
            root = math.sqrt(amount)
            for node in range(INNER_NODES - 1):
                psi, along, across = closed_form(root * (1.0 - _INNER[node]), lean, chain)
                hinge[0, node, lane], hinge[1, node, lane] = -math.sin(psi), math.cos(psi)
                hinge[2, node, lane] = (along * math.cos(lean) - across * math.sin(lean)) / root
    for node in range(INNER_NODES - 1):
        store(hinge, load(hinge, 2, node) * steepness, 2, node)


@compiled
def _first_turns(loads: Loads, hinge: np.ndarray, field: np.ndarray) -> tuple[Lanes, Lanes]:
    """Those of a straight antenna that weight, bow and its clamp's give bend a little."""
    there_y, there_z = _bent_a_little(loads, INNER_NODES - 1)
    for node in range(NODES):
        y, z = _bent_a_little(loads, node)
        turn = -load(hinge, 0, node) * there_y, y - load(hinge, 1, node) * there_y, z - there_z
        put(field, turn, node)
    half_give, half_square = 0.5 * loads.give_m, 0.5 * loads.length_m**2
    _, weight_y, weight_z = loads.weight_per_m3
    given_y = -half_give * (half_square * weight_z)
    given_z = half_give * (half_square * weight_y + loads.contact_m * loads.push_per_m2)
    return _rolled(hinge, field, (given_y, given_z))


@compiled
def _bent_a_little(loads: Loads, node: int) -> tuple[Lanes, Lanes]:
    rest = _rest(loads, node)
    along, by_weight = loads.length_m - rest, (loads.length_m**3 - rest * rest * rest) / 6.0
    _, weight_y, weight_z = loads.weight_per_m3
    return (
        0.5 * (along * loads.bow_y_per_m - by_weight * weight_z),
        0.5 * (along * loads.bow_z_per_m + by_weight * weight_y),
    )


@compiled
def _rest(loads: Loads, node: int) -> Lanes:
    """Length beyond the node."""
    if node < INNER_NODES:
        return loads.length_m - loads.contact_m * _INNER[node]
    return (loads.length_m - loads.contact_m) * (1.0 - _OUTER[node - INNER_NODES])


@compiled
def _side(loads: Loads, node: int) -> Lanes:
    """Length of the side of the contact that the node lies on."""
    return loads.contact_m if node < INNER_NODES else loads.length_m - loads.contact_m


@compiled
def _state(
    loads: Loads,
    hinge: np.ndarray,
    field: np.ndarray,
    given: tuple[Lanes, Lanes],
    local: np.ndarray,
    tangents: np.ndarray,
    moments: np.ndarray,
    integrand: np.ndarray,
) -> _State:
    """Writes τ, t and M."""
    seen = _seen_from_contact(field, given)
    weight = _hinged(hinge, 0, _turned(seen, loads.weight_per_m3))
    zero, push = spread(0.0), loads.push_per_m2
    sin_lean, cos_lean = sine_and_cosine(loads.lean_rad)
    force = -push * (sin_lean / cos_lean), push, zero
    if loads.dead:
        force = _hinged(hinge, 0, _turned(seen, (loads.dead_along_per_m2, push, zero)))
    for node in range(NODES):
        along = _turned_x(vector(field, node))
        tangent = _hinged(hinge, node, along)
        internal = times(_rest(loads, node), weight)
        if node < INNER_NODES:
            internal = added(internal, force)
        put(local, along, node)
        put(tangents, tangent, node)
        put(integrand, times(_side(loads, node), cross(tangent, internal)), node)
    zero_moment = zero, zero, zero
    integrated(_OUTER_FROM_TIP, integrand, INNER_NODES, zero_moment, moments, INNER_NODES)
    # the first node beyond the contact is the contact itself
    integrated(_INNER_FROM_TIP, integrand, 0, vector(moments, INNER_NODES), moments, 0)
    return _State(seen, force)


@compiled
def _swept(
    loads: Loads,
    hinge: np.ndarray,
    field: np.ndarray,
    state: _State,
    local: np.ndarray,
    moments: np.ndarray,
    integrand: np.ndarray,
) -> tuple[Lanes, Lanes]:
    """The turns (see the module) under the moments of the present ones: writes g, gives the clamp's."""
    _, held_y, held_z = _turned(negative(state.seen), _hinged_back(hinge, 0, vector(moments, 0)))
    half_give, roll = 0.5 * loads.give_m, load(field, 0, INNER_NODES - 1)
    for node in range(NODES):
        m = _hinged_back(hinge, node, vector(moments, node))
        rate = _rate(loads, vector(field, node), vector(local, node), m, load(hinge, 2, node))
        put(integrand, times(0.5 * _side(loads, node), rate), node)
    at_contact = roll, spread(0.0), spread(0.0)
    integrated(_INNER_FROM_CONTACT, integrand, 0, at_contact, field, 0)
    integrated(_OUTER_FROM_CONTACT, integrand, INNER_NODES, at_contact, field, INNER_NODES)
    return _rolled(hinge, field, (half_give * held_y, half_give * held_z))


@compiled
def _rolled(hinge: np.ndarray, field: np.ndarray, given: tuple[Lanes, Lanes]) -> tuple[Lanes, Lanes]:
    """With the sections turned about their own axes until the clamp's turn to the contact's axes has no roll in it."""
    d_x, d_y, _ = _seen_from_contact(field, given)
    roll = load(hinge, 0, 0) / (1.0 + load(hinge, 1, 0)) * d_y - d_x
    for node in range(NODES):
        store(field, load(field, 0, node) + roll, 0, node)
    return given


@compiled
def _rate(loads: Loads, g: Vector, local: Vector, m: Vector, curvature_per_m: Lanes) -> Vector:
    """2 g′."""
    m_x, m_y, m_z = m
    delta_z = m_z - curvature_per_m
    b_x, b_y, b_z = (_TORSION_RATIO - 1.0) * dot(local, m), loads.bow_y_per_m, loads.bow_z_per_m
    both = m_x + b_x, m_y + b_y, delta_z + b_z
    across = cross(g, (m_x - b_x, m_y - b_y, delta_z - b_z))
    return added(both, added(negative(across), times(dot(g, both), g)))


@compiled
def _seen_from_contact(field: np.ndarray, given: tuple[Lanes, Lanes]) -> Vector:
    """Cayley vector of Q(0)·R₀ᵀ."""
    x, y, z = vector(field, 0)
    e_y, e_z = given
    scale = 1.0 / (1.0 + y * e_y + z * e_z)
    return (x + z * e_y - y * e_z) * scale, (y - e_y + x * e_z) * scale, (z - e_z - x * e_y) * scale


@compiled
def _hinged(hinge: np.ndarray, node: int, v: Vector) -> Vector:
    """H·v."""
    sine, cosine = load(hinge, 0, node), load(hinge, 1, node)
    return cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], v[2]


@compiled
def _hinged_back(hinge: np.ndarray, node: int, v: Vector) -> Vector:
    """Hᵀ·v."""
    sine, cosine = load(hinge, 0, node), load(hinge, 1, node)
    return cosine * v[0] + sine * v[1], cosine * v[1] - sine * v[0], v[2]


@compiled
def _turned(g: Vector, v: Vector) -> Vector:
    """Q·v of the Cayley vector g."""
    once = cross(g, v)
    return added(v, times(2.0 / (1.0 + dot(g, g)), added(once, cross(g, once))))


@compiled
def _turned_x(g: Vector) -> Vector:
    """Q e_x of the Cayley vector g."""
    x, y, z = g
    across = y * y + z * z
    scale = 2.0 / (1.0 + x * x + across)
    return 1.0 - scale * across, scale * (x * y + z), scale * (x * z - y)


@compiled
def integrated(weights: np.ndarray, field: np.ndarray, start: int, base: Vector, out: np.ndarray, first: int) -> None:
    """Write base + Σ over nodes from `start` on of the field, for each row of weights, from `first` on.

    Two rows at a time: each vector of the field is fetched once for both, and sixteen registers hold all sums.
    """
    rows, count = weights.shape
    for row in range(0, rows - 1, 2):
        a, b = base, base
        for node in range(count):
            v = vector(field, start + node)
            a = added(a, times(weights[row, node], v))
            b = added(b, times(weights[row + 1, node], v))
        put(out, a, first + row)
        put(out, b, first + row + 1)
    for row in range(rows - rows % 2, rows):
        a = base
        for node in range(count):
            a = added(a, times(weights[row, node], vector(field, start + node)))
        put(out, a, first + row)


@compiled
def vector(field: np.ndarray, node: int) -> Vector:
    """A field's vectors at a node."""
    return load(field, 0, node), load(field, 1, node), load(field, 2, node)


@compiled
def put(field: np.ndarray, v: Vector, node: int) -> None:
    """Write a field's vectors at a node."""
    store(field, v[0], 0, node)
    store(field, v[1], 1, node)
    store(field, v[2], 2, node)


@compiled
def times(factor: Lanes, v: Vector) -> Vector:
    """A number times a vector."""
    return factor * v[0], factor * v[1], factor * v[2]


@compiled
def added(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def negative(v: Vector) -> Vector:
    """−v."""
    return -v[0], -v[1], -v[2]


@compiled
def dot(a: Vector, b: Vector) -> Lanes:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
