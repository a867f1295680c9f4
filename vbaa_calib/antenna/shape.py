"""The antenna as the inverse problems see it: clamp, bow, weight and one point force to a curve in space.

The force's bending is the planar elastica, exact in the deformation plane 𝒟; weight, natural bow and what couples them
to the force are a small rotation field on top of it, refined by sweeps of the equilibrium of moments
(`antenna.equilibrium`, docs/theory_estimator.md). NumPy or torch: what comes out has the kind, dtype and device of what
goes in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.core.arrays import Array, namespace

from .equilibrium import Equilibrium, Frame, Loads, Vector, equilibrium, side_lengths
from .nodes import CONTACT, aligned_arclength, grid_like, on_shaft

__all__ = ["CONTACT", "PARAMETERS", "Curves", "aligned_arclength", "bend"]

PARAMETERS = (
    "clamp_y_m",
    "clamp_z_m",
    "clamp_about_y_rad",
    "clamp_about_z_rad",
    "bow_about_y_per_m",
    "bow_about_z_per_m",
    "log_stiffness_Nm2",
    "log_mass_per_length_kg_m",
    "clamp_give_m",
)
"""Order of an antenna's parameter vector. Logarithms keep stiffness and mass positive, their errors relative.

No clamp is rigid: it turns with the moment that it holds, as if a short piece of the antenna, `clamp_give_m` long, bent
inside it."""


@dataclass(frozen=True, eq=False)
class Curves:
    """A batch of B antenna shapes, each on its own N nodes.

    Attributes
    ----------
    arclength_m : (B, N) from the clamp; node `CONTACT` is the contact.
    points_m, tangents : (B, N, 3) antenna frame.
    force_N : (B, 3) the object's force on the antenna, antenna frame.
    moment_Nm : (B,) x·f_z − z·f_x of force and weight about the antenna frame's origin, the sign of the paper's τ_y.
    """

    arclength_m: Array
    points_m: Array
    tangents: Array
    force_N: Array
    moment_Nm: Array

    @property
    def contact_m(self) -> Array:
        """(B, 3) point of the centreline at the contact, antenna frame."""
        return self.points_m[:, CONTACT]

    def picked(self, which: Array) -> Curves:
        """The curves with these indices (K,), which may repeat."""
        return Curves(*(values[which] for values in vars(self).values()))


def bend(
    parameters: Array,
    length_m: float,
    gravity_m_s2: Array,
    contact_m: Array,
    force_N: Array,
    *,
    dead: bool = False,
    sweeps: int = 2,
    friction_rad: Array | None = None,
) -> Curves:
    """Shapes of antennas under weight and one point force each.

    Parameters
    ----------
    parameters : (B, 9), see `PARAMETERS`.
    gravity_m_s2 : (B, 3) antenna frame.
    contact_m : (B,) arc length of the force from the clamp.
    force_N : (B, 2). By default the components (y, z), in the clamp's frame, of a force along the antenna's normal at
        the contact before it is turned with the antenna, by the least rotation that takes the clamped tangent to the
        one at the contact. With `dead`, the components (y, z) of a hanging load, antenna frame, which keeps its
        direction.
    sweeps : passes over the equilibrium of moments. Each leaves a tenth to a fortieth of the error at contact slopes of
        up to 35°; under a `dead` load a tenth at 20°, 0.3 at 35°.
    friction_rad : (B,) within ±π/2, angle of the contact force from the antenna's normal at the contact; positive leans
        towards the clamp. `force_N` stays the component along the normal: the whole force is |force_N|/cos of the
        angle. None is a contact without friction. Nothing to a dead force.

    Notes
    -----
    Without weight, bow and `dead` the elastica is in equilibrium, and the sweeps leave it as it is.
    """
    xp = namespace(parameters)
    contact_m = on_shaft(contact_m, length_m)
    stiffness = xp.exp(parameters[:, 6:7])
    clamp = _rotation(parameters[:, 2:3], parameters[:, 3:4])
    applied: Vector = (xp.zeros_like(stiffness), force_N[:, :1] / stiffness, force_N[:, 1:] / stiffness)
    if dead:
        applied = _turned_back(clamp, applied)
    size = xp.hypot(applied[1], applied[2])
    toward = _direction(applied[1], applied[2], size)
    frame = _rolled(clamp, toward)
    linear_weight = xp.exp(parameters[:, 7:8]) * gravity_m_s2
    by_stiffness = linear_weight / stiffness
    weight: Vector = (by_stiffness[:, :1], by_stiffness[:, 1:2], by_stiffness[:, 2:])
    loads = Loads(
        contact_m=contact_m[:, None],
        length_m=length_m,
        push_per_m2=size,
        lean_rad=None if dead else friction_rad,
        dead_per_m2=(applied[0], size, xp.zeros_like(size)) if dead else None,
        weight_per_m3=_turned_back(frame, weight),
        bow_per_m=_across(parameters[:, 4:5], parameters[:, 5:6], toward),
        give_m=parameters[:, 8:],
    )
    return _curves(loads, equilibrium(loads, sweeps), frame, parameters, weight, stiffness)


def _curves(
    loads: Loads, found: Equilibrium, frame: Frame, parameters: Array, weight_per_m3: Vector, stiffness_Nm2: Array
) -> Curves:
    """The equilibrium on the denser nodes; `frame` is the clamp's, its y along the force, in the antenna frame."""
    xp = namespace(parameters)
    grid = grid_like(parameters)
    frame = (_turned(frame, found.axes[0]), _turned(frame, found.axes[1]), _turned(frame, found.axes[2]))
    tangents = xp.stack(_turned(frame, found.tangents))
    points = (tangents * side_lengths(loads.contact_m, loads.length_m)) @ grid.to_curve
    force = _turned(frame, found.force_per_m2)
    # about the antenna frame's origin: the clamp stands aside by (0, y, z)
    _, moment, _ = _turned(frame, found.moment_per_m)
    moment = moment + parameters[:, 1:2] * (force[0] + loads.length_m * weight_per_m3[0])
    points = points + xp.stack([xp.zeros_like(moment), parameters[:, :1], parameters[:, 1:2]])
    return Curves(
        aligned_arclength(loads.contact_m[:, 0], loads.length_m),
        xp.moveaxis(points, 0, -1),
        xp.moveaxis(tangents @ grid.at_curve, 0, -1),
        xp.concat(force, -1) * stiffness_Nm2,
        (-moment * stiffness_Nm2)[:, 0],
    )


def _rotation(about_y: Array, about_z: Array) -> Frame:
    """Rotation by the vector (0, y, z) (B, 1) in rad: Rodrigues' formula."""
    xp = namespace(about_y)
    half = xp.sqrt(about_y**2 + about_z**2) / (2.0 * np.pi)
    sine, versine = xp.sinc(2.0 * half), 0.5 * xp.sinc(half) ** 2
    y, z = sine * about_y, sine * about_z
    y_square, z_square, both = versine * about_y**2, versine * about_z**2, versine * about_y * about_z
    return (1.0 - y_square - z_square, z, -y), (-z, 1.0 - z_square, both), (y, both, 1.0 - y_square)


def _direction(y: Array, z: Array, size: Array) -> tuple[Array, Array]:
    """Unit vectors along (y, z); along y where there is no size."""
    xp = namespace(size)
    some = size > 0.0
    safe = xp.where(some, size, 1.0)
    return xp.where(some, y / safe, 1.0), z / safe


def _rolled(frame: Frame, toward: tuple[Array, Array]) -> Frame:
    """The frame turned about its x, so that its y points to where `toward` = (y, z) did."""
    x_axis, y_axis, z_axis = frame
    y, z = toward
    turned = [(y * a + z * b, y * b - z * a) for a, b in zip(y_axis, z_axis, strict=True)]
    (y_0, z_0), (y_1, z_1), (y_2, z_2) = turned
    return x_axis, (y_0, y_1, y_2), (z_0, z_1, z_2)


def _across(y: Array, z: Array, toward: tuple[Array, Array]) -> tuple[Array, Array]:
    """Components along and across `toward` of the vectors (y, z)."""
    return y * toward[0] + z * toward[1], z * toward[0] - y * toward[1]


def _turned(frame: Frame, vector: Vector) -> Vector:
    """From the frame's components to those that its axes are given in."""
    x, y, z = ((a * vector[0] + b * vector[1]) + c * vector[2] for a, b, c in zip(*frame, strict=True))
    return x, y, z


def _turned_back(frame: Frame, vector: Vector) -> Vector:
    """Into the frame's components."""
    x, y, z = (axis[0] * vector[0] + axis[1] * vector[1] + axis[2] * vector[2] for axis in frame)
    return x, y, z
