"""The static rod of `rod`, compiled: one rod from its clamp to its tip, and what brings the tip's moment to zero."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.newton import newton_for
from vbaa_calib.geometry.vectors import Vector, cross, dot, moved, scaled, vector

TOLERANCE = 1e-11
"""On the moment left at the tip, relative to the moment of the loads."""
_LOAD_LADDER = (0.1, 0.25, 0.45, 0.7, 1.0)


class RodNumbers(NamedTuple):
    """A rod as the kernels know it.

    length_m : from the clamp to the tip. bend, twist : 1/EI and 1/GJ. mass_per_length_kg_m : as the rod's.
    curvature_y, curvature_z : natural curvature, 1/m. clamp : (3, 3) the clamp's place, d1 and d2 there.
    """

    length_m: float
    bend: float
    twist: float
    mass_per_length_kg_m: float
    curvature_y: float
    curvature_z: float
    clamp: np.ndarray


class Load(NamedTuple):
    """One rod under its weight and a force. Its clamp's moment counts in `clamp_Nm`, its tip's in `tip_Nm`.

    nodes : (N, 4, 3) scratch.
    """

    rod: RodNumbers
    gravity_m_s2: Vector
    contact_m: float
    force_N: Vector
    clamp_Nm: float
    tip_Nm: float
    nodes: np.ndarray


@kernel
def _rates(rod: RodNumbers, d1: Vector, d2: Vector, moment: Vector, internal: Vector) -> tuple[Vector, Vector, Vector]:
    """d1', d2' and M'."""
    turn = moved(scaled(rod.bend, moment), (rod.twist - rod.bend) * dot(d1, moment), d1)
    turn = moved(turn, rod.curvature_y, d2)
    turn = moved(turn, rod.curvature_z, cross(d1, d2))
    return cross(turn, d1), cross(turn, d2), cross(internal, d1)


@kernel
def _mean(start: Vector, step: float, k1: Vector, k2: Vector, k3: Vector, k4: Vector) -> Vector:
    """Where Runge and Kutta's four rates lead."""
    return moved(moved(moved(moved(start, step / 6, k1), step / 3, k2), step / 3, k3), step / 6, k4)


@kernel
def shoot(
    rod: RodNumbers, gravity_m_s2: Vector, contact_m: float, force_N: Vector, moment_Nm: Vector, nodes: np.ndarray
) -> int:
    """Integrate from the clamp with a supposed moment M(0) there; in equilibrium the tip's moment comes out as zero.

    Parameters
    ----------
    nodes : (N, 4, 3), N odd, to be written: per node the position, the tangent d1, the director d2 and the moment M,
        antenna frame, by Runge and Kutta over two equally divided segments that meet at the contact. A contact at the
        tip leaves no second segment; the rod is then split in its middle.

    Returns
    -------
    int : which node the contact is.
    """
    count = (len(nodes) - 1) // 2
    at_tip = contact_m >= rod.length_m
    split = rod.length_m / 2 if at_tip else contact_m
    weight = scaled(rod.mass_per_length_kg_m, gravity_m_s2)
    r, d1, d2, moment = vector(rod.clamp[0]), vector(rod.clamp[1]), vector(rod.clamp[2]), moment_Nm
    for i in range(2 * count + 1):
        for j in range(3):
            nodes[i, 0, j], nodes[i, 1, j], nodes[i, 2, j], nodes[i, 3, j] = r[j], d1[j], d2[j], moment[j]
        first = i < count
        step = (split if first else rod.length_m - split) / count
        beyond = rod.length_m - (i * step if first else split + (i - count) * step)
        internal = moved(scaled(1.0 if first or at_tip else 0.0, force_N), beyond, weight)
        middle, end = moved(internal, -step / 2, weight), moved(internal, -step, weight)
        a1, b1, c1 = _rates(rod, d1, d2, moment, internal)
        t2, half = moved(d1, step / 2, a1), step / 2
        a2, b2, c2 = _rates(rod, t2, moved(d2, half, b1), moved(moment, half, c1), middle)
        t3 = moved(d1, half, a2)
        a3, b3, c3 = _rates(rod, t3, moved(d2, half, b2), moved(moment, half, c2), middle)
        t4 = moved(d1, step, a3)
        a4, b4, c4 = _rates(rod, t4, moved(d2, step, b3), moved(moment, step, c3), end)
        r = _mean(r, step, d1, t2, t3, t4)
        d1, d2 = _mean(d1, step, a1, a2, a3, a4), _mean(d2, step, b1, b2, b3, b4)
        moment = _mean(moment, step, c1, c2, c3, c4)
    return 2 * count if at_tip else count


@kernel
def _tip_moment(load: Load, x: np.ndarray, values: np.ndarray) -> None:
    """What the clamp's moment x (3,), in `clamp_Nm`, leaves at the tip."""
    shoot(load.rod, load.gravity_m_s2, load.contact_m, load.force_N, scaled(load.clamp_Nm, vector(x)), load.nodes)
    for j in range(3):
        values[j] = load.nodes[-1, 3, j] / load.tip_Nm


_newton = newton_for(_tip_moment)


@kernel
def solve_rods(
    rod: RodNumbers, loads: np.ndarray, unit_Nm: float, limit_Nm: np.ndarray, moment_Nm: np.ndarray, nodes: np.ndarray
) -> np.ndarray:
    """B rods in equilibrium, each by itself; where Newton fails at once the load is brought on in shares.

    Parameters
    ----------
    loads : (B, 7) gravity, force, and the arc length at which it acts.
    unit_Nm : EI/L. limit_Nm : (B, 2) no component of the clamp's moment is larger; what the tip's moment counts in.
    moment_Nm : (B, 3) the clamp's moment to start from; overwritten by the solution.
    nodes : (B, N, 4, 3) to be written, as `shoot` does.

    Returns
    -------
    (B,) the moment left at the tip, relative.
    """
    sizes = np.empty(len(loads))
    for b, load in enumerate(loads):
        gravity, force, contact = vector(load), vector(load[3:]), load[6]
        limit, scale = limit_Nm[b]
        x, bound = moment_Nm[b] / unit_Nm, np.full(3, limit / unit_Nm)
        size = _newton(Load(rod, gravity, contact, force, unit_Nm, scale, nodes[b]), x, -bound, bound, TOLERANCE)
        if not size <= TOLERANCE:
            x[:] = 0.0
            for share in _LOAD_LADDER:
                part = Load(rod, scaled(share, gravity), contact, scaled(share, force), unit_Nm, scale, nodes[b])
                size = _newton(part, x, -bound, bound, TOLERANCE)
        for j in range(3):
            moment_Nm[b, j] = unit_Nm * x[j]
        shoot(rod, gravity, contact, force, vector(moment_Nm[b]), nodes[b])
        sizes[b] = size
    return sizes
