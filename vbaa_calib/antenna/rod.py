"""The antenna as a static elastic rod in space: large deflection, weight, natural curvature, one point force.

Kirchhoff's rod: inextensible, unshearable, bending stiffness the same in all directions, torsion. With the position r,
the directors d1 (tangent), d2, d3 = d1 × d2, the internal force n(s) and moment M(s) (what the part beyond s exerts on
the part before it), all in the antenna frame and over the arc length s:

    r' = d1      d1' = Ω × d1      d2' = Ω × d2      M' = n × d1
    Ω = M/EI + (1/GJ − 1/EI) (d1·M) d1 + κ_y d2 + κ_z d3

All loads are dead, so n(s) = [s < contact] force + (L − s) m' g is known beforehand and the position decouples. The
clamp gives r, d1, d2 at s = 0; the clamp moment M(0) is shot for, so that M(L) = 0. A compliant clamp turns with M(0),
which is iterated.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np

from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core

from .taper import UNIFORM, Taper

STEPS_PER_SEGMENT: int = core.antenna.STEPS_PER_SEGMENT
TORSION_RATIO = 1.3  # EI/GJ = 1 + ν of a round wire of metal, ν = 0.3


@dataclass(frozen=True, eq=False)
class Rod:
    """A rod's material, mass, natural curvature and clamping.

    Attributes
    ----------
    length_m : from the clamp to the tip.
    bending_stiffness_Nm2 : EI, the same about every transverse axis (the paper's equal compliance).
    torsional_stiffness_Nm2 : GJ.
    mass_per_length_kg_m : 0 for a weightless antenna.
    T_antenna_clamp : the clamp frame's origin lies at the clamp, its x along the clamped tangent.
    natural_curvature_per_m : (2,) curvature of the unloaded, weightless rod about its own y and z axes, constant along
        it: a positive one about z bends it towards +y, a positive one about y towards −z.
    clamp_give_m : how long a piece of the rod would bend as much as the clamp turns; 0 for a rigid clamp.
    taper : how stiffnesses and mass per length, which are the clamp's, change along it.
    """

    length_m: float
    bending_stiffness_Nm2: float
    torsional_stiffness_Nm2: float
    mass_per_length_kg_m: float
    T_antenna_clamp: Pose = field(default_factory=Pose.identity)
    natural_curvature_per_m: np.ndarray = field(default_factory=lambda: np.zeros(2))
    clamp_give_m: float = 0.0
    taper: Taper = UNIFORM

    def __post_init__(self) -> None:
        for name in ("length_m", "bending_stiffness_Nm2", "torsional_stiffness_Nm2"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"{name} is {getattr(self, name)}", where="antenna", remedy="give a positive number")
        if not 0.0 <= self.mass_per_length_kg_m < np.inf:
            raise InputError(
                f"mass_per_length_kg_m is {self.mass_per_length_kg_m}", where="antenna", remedy="give 0 or more"
            )
        if not abs(self.clamp_give_m) < self.length_m:
            raise InputError(
                f"clamp_give_m is {self.clamp_give_m}", where="antenna", remedy="give less than its length"
            )

    @property
    def mass_kg(self) -> float:
        """Mass of the whole rod."""
        return self.mass_per_length_kg_m * self.taper.weight * self.length_m

    def yielding_m(self, distance_m: np.ndarray) -> np.ndarray:
        """(B,) deflection at arc lengths (B,) per N of force there, for small deflections."""
        uniform = distance_m**3 / (3.0 * self.bending_stiffness_Nm2)
        return uniform * self.taper.yielding(distance_m / self.length_m)

    @property
    def numbers(self) -> SimpleNamespace:
        """The rod as the core reads it: lengths, compliances 1/EI and 1/GJ, the taper's pieces, natural curvature, and
        (3, 3) the clamp's place, d1 and d2."""
        curvature_y, curvature_z = self.natural_curvature_per_m
        pose = self.T_antenna_clamp
        return SimpleNamespace(
            length_m=float(self.length_m),
            bend=1.0 / self.bending_stiffness_Nm2,
            twist=1.0 / self.torsional_stiffness_Nm2,
            pieces=self.taper.pieces,
            mass_per_length_kg_m=float(self.mass_per_length_kg_m),
            curvature_y=float(curvature_y),
            curvature_z=float(curvature_z),
            clamp=np.stack([pose.translation_m, pose.rotation[:, 0], pose.rotation[:, 1]]),
        )


@dataclass(frozen=True, eq=False)
class RodShape:
    """B solved rods, at N nodes each.

    Attributes
    ----------
    arclength_m : (B, N) strictly increasing from 0 to the length; the contact is one of the nodes.
    points_m : (B, N, 3) antenna frame.
    tangents : (B, N, 3) unit vectors, antenna frame.
    clamp_moment_Nm : (B, 3) right-handed moment about the antenna frame's origin of all external loads, weight and
        contact force. The paper's moment τ_y = x·f_z − z·f_x is minus its y component.
    """

    arclength_m: np.ndarray
    points_m: np.ndarray
    tangents: np.ndarray
    clamp_moment_Nm: np.ndarray


def solve_rod(
    rod: Rod,
    gravity_m_s2: np.ndarray,
    contact_m: np.ndarray,
    force_N: np.ndarray,
    guess_moment_Nm: np.ndarray | None = None,
) -> RodShape:
    """The rod's shape under its weight and one dead force.

    Parameters
    ----------
    gravity_m_s2 : (B, 3) antenna frame.
    contact_m : (B,) arc length at which the force acts, 0 < contact ≤ length; any such value where the force is 0.
    force_N : (B, 3) antenna frame.
    guess_moment_Nm : (B, 3) the `clamp_moment_Nm` of a neighbouring solution, to start from.

    Raises
    ------
    InputError : an array of the wrong shape, a number that is not finite, a contact off the rod.
    SolveError : the tip's moment could not be brought to zero for some batch element.
    """
    gravity, contact, force = _checked(rod, gravity_m_s2, contact_m, force_N)
    if not rod.clamp_give_m:
        nodes, moment = _rigidly_clamped(rod, gravity, contact, force, guess_moment_Nm)
        return _shape_of(rod, contact, nodes, moment)
    from scipy.spatial.transform import Rotation

    lever, along = rod.T_antenna_clamp.translation_m, rod.T_antenna_clamp.rotation[:, 0]
    rigid, turn, guess = replace(rod, clamp_give_m=0.0), np.zeros_like(force), guess_moment_Nm
    per_moment = rod.clamp_give_m / rod.bending_stiffness_Nm2 * (np.eye(3) - np.outer(along, along))
    for _ in range(100):  # each leaves about give/L of the turn's error
        # a clamp that has turned sees the loads turned back
        turned = Rotation.from_rotvec(turn).as_matrix()
        seen_gravity, seen_force = (np.einsum("bij,bi->bj", turned, load) for load in (gravity, force))
        nodes, moment = _rigidly_clamped(rigid, seen_gravity, contact, seen_force, guess)
        total_N = rod.mass_kg * seen_gravity + seen_force
        at_clamp = np.einsum("bij,bj->bi", turned, moment - np.cross(lever, total_N))
        before, turn, guess = turn, at_clamp @ per_moment, moment
        if np.abs(turn - before).max() < 1e-12:
            break
    else:
        raise SolveError(f"a rod whose clamp gives by {rod.clamp_give_m:.4g} m found no equilibrium")
    nodes = (turned[:, None, None] @ (nodes - [lever, *np.zeros((3, 3))])[..., None])[..., 0]
    nodes[:, :, 0] += lever
    return _shape_of(rod, contact, nodes, at_clamp + np.cross(lever, np.einsum("bij,bj->bi", turned, total_N)))


def _rigidly_clamped(
    rod: Rod, gravity: np.ndarray, contact: np.ndarray, force: np.ndarray, guess_moment_Nm: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (B, N, 4, 3) of the rod in a rigid clamp, and the moment (B, 3) about the antenna frame's origin. Raises
    SolveError."""
    lever = rod.T_antenna_clamp.translation_m
    unit = rod.bending_stiffness_Nm2 / rod.length_m
    weight = rod.mass_kg * gravity
    load = np.linalg.norm(force, axis=1) * contact + np.linalg.norm(weight, axis=1) * rod.length_m / 2
    tangent = rod.T_antenna_clamp.rotation[:, 0]
    # the lever shortens as the rod bends: this follows the elastica's up to ten times the force of EI/contact²
    bent = 1.0 + np.linalg.norm(force, axis=1) * contact**2 / (8.0 * rod.bending_stiffness_Nm2)
    start = np.cross(tangent, (contact / bent)[:, None] * force + rod.length_m / 2 * weight)
    if guess_moment_Nm is not None:
        start = guess_moment_Nm - np.cross(lever, force + weight)
    # no lever is longer than the arc, so no component of the clamp moment exceeds the load's
    limits = np.stack([load, np.maximum(load, 1e-6 * unit)], axis=1)
    if rod.taper:  # the tip's turn, of 3 rad at most, stands for it
        start, limits = np.zeros_like(start), np.tile([3.0 * unit, unit], (len(load), 1))
    loads = np.column_stack([gravity, force, contact])
    nodes, moment, left = core.antenna.solve_rods(rod.numbers, loads, unit, limits, start, STEPS_PER_SEGMENT)
    if not (left <= core.antenna.ROD_TOLERANCE).all():
        worst = int(np.argmax(left))
        raise SolveError(
            f"rod {worst} of {len(left)} found no equilibrium: force {force[worst]} N at {contact[worst]:.4f} m"
            f" leaves {left[worst]:.1e} of its moment at the tip"
        )
    if rod.taper:
        moment = nodes[:, 0, 3]
    return nodes, moment + np.cross(lever, force + weight)


def _shape_of(rod: Rod, contact_m: np.ndarray, nodes: np.ndarray, clamp_moment_Nm: np.ndarray) -> RodShape:
    """B solved rods from their nodes (B, N, 4, 3): position, directors d1 and d2, moment. The nodes are evenly spaced
    on either side of the contact (B,), or of the middle for a contact at the tip."""
    split = np.where(contact_m < rod.length_m, contact_m, rod.length_m / 2)
    share = np.linspace(0.0, 1.0, STEPS_PER_SEGMENT + 1)[:, None]
    arclength = np.concatenate([share * split, (split + share * (rod.length_m - split))[1:]]).T
    tangents = nodes[:, :, 1] / np.linalg.norm(nodes[:, :, 1], axis=-1, keepdims=True)
    return RodShape(arclength, nodes[:, :, 0], tangents, clamp_moment_Nm)


def sample_shape(shape: RodShape, arclength_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (B, K, 3) and unit tangents (B, K, 3) at arc lengths (B, K), clipped to the rod's ends.

    Cubic Hermite interpolation between the nodes, accurate to 1e-8 of the length where the nodes resolve the shape.
    """
    at = np.clip(arclength_m, shape.arclength_m[:, :1], shape.arclength_m[:, -1:])
    last = shape.arclength_m.shape[1] - 2
    left = np.array([np.searchsorted(s, x, side="right") for s, x in zip(shape.arclength_m, at, strict=True)]) - 1
    left = np.clip(left, 0, last)
    s0, s1 = (np.take_along_axis(shape.arclength_m, left + i, axis=1) for i in (0, 1))
    p0, p1 = (np.take_along_axis(shape.points_m, (left + i)[..., None], axis=1) for i in (0, 1))
    t0, t1 = (np.take_along_axis(shape.tangents, (left + i)[..., None], axis=1) for i in (0, 1))
    width = (s1 - s0)[..., None]
    x = (at - s0)[..., None] / width
    bend0, bend1 = width * t0 - (p1 - p0), (p1 - p0) - width * t1
    points = p0 + x * (p1 - p0) + x * (1 - x) * ((1 - x) * bend0 + x * bend1)
    slopes = (p1 - p0) + (1 - 2 * x) * ((1 - x) * bend0 + x * bend1) + x * (1 - x) * (bend1 - bend0)
    return points, slopes / np.linalg.norm(slopes, axis=-1, keepdims=True)


def _checked(rod: Rod, gravity: np.ndarray, contact: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, ...]:
    """The loads as arrays. Raises InputError for other shapes, and for numbers that are not finite."""
    gravity, contact, force = (np.asarray(a, float) for a in (gravity, contact, force))
    count = contact.size
    if contact.shape != (count,) or gravity.shape != (count, 3) or force.shape != (count, 3):
        raise InputError(
            f"gravity {gravity.shape}, contact {contact.shape}, force {force.shape}",
            where="rod loads",
            remedy="give (B, 3), (B,) and (B, 3)",
        )
    if not all(np.isfinite(a).all() for a in (gravity, contact, force)):
        raise InputError("a load is not finite", where="rod loads", remedy="give finite numbers")
    if ((contact <= 0.0) | (contact > rod.length_m)).any():
        raise InputError(
            f"contact at {contact.min():.4g} to {contact.max():.4g} m", where="rod loads", remedy="keep it on the rod"
        )
    return gravity, contact, force
