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
x along the antenna, the force in the plane of x and y. Fields are triples of components, each (B, M) on the nodes of
`antenna.nodes`; forces and moments are divided by EI.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np
import torch

from vbaa_calib.core.arrays import Array, like, namespace

from .elastica import SERIES_LOAD, SERIES_TERMS, angle_coefficients, universal_curve
from .nodes import INNER_NODES, grid_like

_TORSION_RATIO = 1.3
"""EI/GJ of a round wire, 1 + ν. Torsion turns the section, and with it the bow: hundredths of a millimetre."""

Vector: TypeAlias = tuple[Array, Array, Array]
"""Components of vectors, each (B, 1) or (B, M)."""

Frame: TypeAlias = tuple[Vector, Vector, Vector]
"""Columns of rotation matrices: the axes of one frame along those of another."""


@dataclass(frozen=True, eq=False)
class _Hinge:
    """Rotations about z by angles (B, M), as their sine and cosine, and their slopes along the antenna."""

    sin: Array
    cos: Array
    curvature_per_m: Array

    def turned(self, vectors: Vector) -> Vector:
        """Components of H·v."""
        x, y, z = vectors
        return self.cos * x - self.sin * y, self.sin * x + self.cos * y, z

    def turned_back(self, vectors: Vector) -> Vector:
        """Components of Hᵀ·v."""
        x, y, z = vectors
        return self.cos * x + self.sin * y, self.cos * y - self.sin * x, z

    def at(self, node: int) -> _Hinge:
        """At one node, M = 1."""
        one = slice(node, node + 1)
        return _Hinge(self.sin[:, one], self.cos[:, one], self.curvature_per_m[:, one])


@dataclass(frozen=True, eq=False)
class Loads:
    """What bends B antennas, along the clamp's axes and over EI. All (B, 1) but where said.

    Attributes
    ----------
    contact_m, length_m : arc length of the contact, and () of the tip.
    push_per_m2 : the contact force's component along the normal.
    lean_rad : (B,) angle of the whole force from the normal, positive towards the clamp; None without friction.
    dead_per_m2 : a force that keeps its direction, in place of the other; None where it follows the antenna's normal.
    weight_per_m3 : per length.
    bow_per_m : natural curvature about y and z.
    give_m : of the clamp.
    """

    contact_m: Array
    length_m: float
    push_per_m2: Array
    lean_rad: Array | None
    dead_per_m2: Vector | None
    weight_per_m3: Vector
    bow_per_m: tuple[Array, Array]
    give_m: Array


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Along the contact's axes: tangents (B, M), the contact force (B, 1), the loads' moment (B, 1) about the clamp.

    `axes` are those of the contact, along the clamp's, each with components (B, 1).
    """

    axes: Frame
    tangents: Vector
    force_per_m2: Vector
    moment_per_m: Vector


@dataclass(frozen=True, eq=False)
class _Turns:
    """g (B, M), and the Cayley vector y, z (B, 1) of the clamp's give."""

    field: Vector
    given: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class _State:
    """What the turns make of the antenna: Q(0)·R₀ᵀ as a Cayley vector, τ, t, the contact force, M."""

    seen: Vector
    local: Vector
    tangents: Vector
    force: Vector
    moments: Vector


def side_lengths(contact_m: Array, length_m: float) -> Array:
    """(B, M) length of the side of the contact (B, 1) that each node lies on."""
    before = grid_like(contact_m).before
    return contact_m * before + (length_m - contact_m) * (1.0 - before)


def equilibrium(loads: Loads, sweeps: int) -> Equilibrium:
    """Sweep so many times, from the rotations that weight and bow cause by themselves."""
    grid = grid_like(loads.contact_m)
    side = side_lengths(loads.contact_m, loads.length_m)
    rest = loads.length_m - loads.contact_m * grid.inner - (loads.length_m - loads.contact_m) * grid.outer
    hinge = _elastica_hinge(loads)
    base = hinge.at(0)
    turns = _first_turns(loads, hinge, rest)
    state = _state(loads, hinge, turns, rest, side)
    for _ in range(sweeps):
        turns = _swept(loads, hinge, turns, state, side)
        state = _state(loads, hinge, turns, rest, side)
    back = _negative(state.seen)
    x_axis = _turned(back, (base.cos, -base.sin, 0.0 * base.sin))
    y_axis = _turned(back, (base.sin, base.cos, 0.0 * base.sin))
    return Equilibrium((x_axis, y_axis, _cross(x_axis, y_axis)), state.tangents, state.force, _at(state.moments, 0))


def _first_turns(loads: Loads, hinge: _Hinge, rest: Array) -> _Turns:
    """Those of a straight antenna that weight, bow and its clamp's give bend a little."""
    length = loads.length_m
    along = length - rest
    by_weight = (length**3 - rest**3) / 6.0
    _, weight_y, weight_z = loads.weight_per_m3
    bow_y, bow_z = loads.bow_per_m
    g_y, g_z = 0.5 * (along * bow_y - by_weight * weight_z), 0.5 * (along * bow_z + by_weight * weight_y)
    contact = slice(INNER_NODES - 1, INNER_NODES)
    there_y, there_z = g_y[:, contact], g_z[:, contact]
    half_give = 0.5 * loads.give_m
    given_y = -half_give * (0.5 * length**2) * weight_z
    given_z = half_give * (0.5 * length**2 * weight_y + loads.contact_m * loads.push_per_m2)
    field = -hinge.sin * there_y, g_y - hinge.cos * there_y, g_z - there_z
    return _rolled(hinge.at(0), field, (given_y, given_z))


def _state(loads: Loads, hinge: _Hinge, turns: _Turns, rest: Array, side: Array) -> _State:
    grid, base = grid_like(side), hinge.at(0)
    seen = _seen_from_contact(turns)
    weight = base.turned(_turned(seen, loads.weight_per_m3))
    if loads.dead_per_m2 is not None:
        force = base.turned(_turned(seen, loads.dead_per_m2))
    else:
        push, lean = loads.push_per_m2, loads.lean_rad
        force = (0.0 * push if lean is None else -push * namespace(push).tan(lean)[:, None], push, 0.0 * push)
    local = _turned_x(turns.field)
    tangents = hinge.turned(local)
    x, y, z = (rest * w + grid.before * f for w, f in zip(weight, force, strict=True))
    return _State(seen, local, tangents, force, _mapped(_cross(tangents, (x, y, z)), side, grid.from_tip))


def _swept(loads: Loads, hinge: _Hinge, turns: _Turns, state: _State, side: Array) -> _Turns:
    """The turns (see the module) under the moments of the present ones."""
    m_x, m_y, m_z = hinge.turned_back(state.moments)
    _, held_y, held_z = _turned(_negative(state.seen), (m_x[:, :1], m_y[:, :1], m_z[:, :1]))
    half_give = 0.5 * loads.give_m
    given = half_give * held_y, half_give * held_z
    rates = _rates(loads, turns.field, state.local, (m_x, m_y, m_z), m_z - hinge.curvature_per_m)
    x, y, z = _mapped(rates, 0.5 * side, grid_like(side).from_contact)
    x = x + _at(turns.field, INNER_NODES - 1)[0]
    return _rolled(hinge.at(0), (x, y, z), given)


def _rolled(base: _Hinge, field: Vector, given: tuple[Array, Array]) -> _Turns:
    """With the sections turned about their own axes until the clamp's turn to the contact's axes has no roll in it."""
    d_x, d_y, _ = _seen_from_contact(_Turns(field, given))
    roll = base.sin / (1.0 + base.cos) * d_y - d_x
    return _Turns((field[0] + roll, field[1], field[2]), given)


def _rates(loads: Loads, g: Vector, local: Vector, m: Vector, delta_z: Array) -> Vector:
    """2 g′."""
    m_x, m_y, _ = m
    b_x = (_TORSION_RATIO - 1.0) * _dot(local, m)
    b_y, b_z = loads.bow_per_m
    p_x, p_y, p_z = m_x + b_x, m_y + b_y, delta_z + b_z
    across = _cross(g, (m_x - b_x, m_y - b_y, delta_z - b_z))
    along = _dot(g, (p_x, p_y, p_z))
    return p_x - across[0] + along * g[0], p_y - across[1] + along * g[1], p_z - across[2] + along * g[2]


def _seen_from_contact(turns: _Turns) -> Vector:
    """Cayley vector (B, 1) of Q(0)·R₀ᵀ."""
    x, y, z = _at(turns.field, 0)
    e_y, e_z = turns.given
    scale = 1.0 / (1.0 + y * e_y + z * e_z)
    return (x + z * e_y - y * e_z) * scale, (y - e_y + x * e_z) * scale, (z - e_z - x * e_y) * scale


def _at(values: Vector, node: int) -> Vector:
    one = slice(node, node + 1)
    return values[0][:, one], values[1][:, one], values[2][:, one]


def _negative(vector: Vector) -> Vector:
    return -vector[0], -vector[1], -vector[2]


def _turned(g: Vector, vector: Vector) -> Vector:
    """Q·v of the Cayley vector g."""
    scale = 2.0 / (1.0 + _dot(g, g))
    x, y, z = _cross(g, vector)
    again = _cross(g, (x, y, z))
    return vector[0] + scale * (x + again[0]), vector[1] + scale * (y + again[1]), vector[2] + scale * (z + again[2])


def _turned_x(g: Vector) -> Vector:
    """Q e_x of the Cayley vectors g."""
    x, y, z = g
    y_square, z_square = y * y, z * z
    scale = 2.0 / (1.0 + x * x + y_square + z_square)
    return 1.0 - scale * (y_square + z_square), scale * (x * y + z), scale * (x * z - y)


def _dot(a: Vector, b: Vector) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _mapped(values: Vector, side: Array, through: Array) -> Vector:
    return (values[0] * side) @ through, (values[1] * side) @ through, (values[2] * side) @ through


def _elastica_hinge(loads: Loads) -> _Hinge:
    """The elastica's rotations from the contact's section to those at the M nodes of `antenna.nodes`: −ψ."""
    xp, lean = namespace(loads.contact_m), loads.lean_rad
    force = loads.push_per_m2 if lean is None else loads.push_per_m2 / xp.cos(lean)[:, None]
    load = force * loads.contact_m**2
    large = load > SERIES_LOAD
    psi, slope = _by_series(xp.where(large, 0.0, load), lean)
    if large.any():
        exact = _by_curve(xp.where(large, load, SERIES_LOAD), lean)
        psi, slope = xp.where(large, exact[0], psi), xp.where(large, exact[1], slope)
    return _Hinge(-xp.sin(psi), xp.cos(psi), slope * (force * loads.contact_m))


def _by_series(load: Array, lean_rad: Array | None) -> tuple[Array, Array]:
    """ψ and θ′·EI/(F·l), each (B, M), for loads (B, 1) that the series serves."""
    powers = load ** like(load, np.arange(SERIES_TERMS))
    if lean_rad is not None:
        both = (powers * angle_coefficients(lean_rad)) @ _by_term_like(load, False)
    else:
        both = powers @ _by_term_like(load, True)
    nodes = both.shape[-1] // 2
    return load * both[:, :nodes], both[:, nodes:]


def _by_curve(load: Array, lean_rad: Array | None) -> tuple[Array, Array]:
    """The same for any load, by the universal curve; ψ′ = C cos α − S sin α."""
    xp = namespace(load)
    lean = xp.zeros_like(load[:, 0]) if lean_rad is None else lean_rad
    root = xp.sqrt(load)
    upsilon = root * (1.0 - grid_like(load).inner)
    psi, along, across = universal_curve(upsilon, lean)
    slope = along * xp.cos(lean)[:, None] - across * xp.sin(lean)[:, None]
    return psi, slope / root


def _by_term_like(values: Array, normal: bool) -> Array:
    return _by_term_of(values.dtype, values.device if namespace(values) is torch else None, normal)


@cache
def _by_term_of(dtype: Any, device: torch.device | None, normal: bool) -> Array:
    """(terms, 2·M): what each term of ψ's series adds to ψ and to θ′; for a force along the normal in full."""
    back = 1.0 - grid_like(np.empty(0)).inner
    power = 2.0 * np.arange(SERIES_TERMS)[:, None]
    table = np.concatenate([back ** (power + 2.0), (power + 2.0) * back ** (power + 1.0)], axis=-1)
    if normal:
        table = angle_coefficients(np.zeros(1)).T * table
    return table.astype(dtype) if device is None else torch.as_tensor(table, dtype=dtype, device=device)
