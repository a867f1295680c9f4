"""The antenna as the inverse problems see it: clamp, bow, weight and one point force to a curve in space.

The force's bending is the planar elastica, exact in the deformation plane 𝒟; weight, natural bow and what couples them
to the force are a small rotation field on top of it, refined by sweeps of the equilibrium of moments (docs/theory.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from .elastica import planar_elastica

PARAMETERS = (
    "clamp_y_m",
    "clamp_z_m",
    "clamp_about_y_rad",
    "clamp_about_z_rad",
    "bow_about_y_per_m",
    "bow_about_z_per_m",
    "log_stiffness_Nm2",
    "log_mass_per_length_kg_m",
)
"""Order of an antenna's parameter vector. Logarithms keep stiffness and mass positive, their errors relative."""

NODES_TO_CONTACT, NODES_BEYOND = 40, 17


@dataclass(frozen=True, eq=False)
class Curves:
    """A batch of B antenna shapes, each on its own N nodes.

    Attributes
    ----------
    arclength_m : (B, N) from the clamp; node `NODES_TO_CONTACT − 1` is the contact.
    points_m, tangents : (B, N, 3) antenna frame.
    force_N : (B, 3) the object's force on the antenna, antenna frame.
    moment_Nm : (B,) x·f_z − z·f_x of force and weight about the antenna frame's origin, the sign of the paper's τ_y.
    """

    arclength_m: np.ndarray
    points_m: np.ndarray
    tangents: np.ndarray
    force_N: np.ndarray
    moment_Nm: np.ndarray

    @property
    def contact_m(self) -> np.ndarray:
        """(B, 3) point of the centreline at the contact, antenna frame."""
        return self.points_m[:, NODES_TO_CONTACT - 1]


def aligned_arclength(contact_m: np.ndarray, length_m: float) -> np.ndarray:
    """(B, N) nodes from the clamp to the tip, one of them at the contact: the shape is smooth on either side of it."""
    inner = contact_m[:, None] * np.linspace(0.0, 1.0, NODES_TO_CONTACT)
    outer = contact_m[:, None] + (length_m - contact_m[:, None]) * np.linspace(0.0, 1.0, NODES_BEYOND + 1)[1:]
    return np.concatenate([inner, outer], axis=1)


def _integrate(values: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Cumulative integral along the nodes, from 0: values (B, N, 3), steps (B, N − 1).

    Fourth order on either side of the contact, where the curvature's slope jumps and steps change.
    """
    contact = NODES_TO_CONTACT - 1
    sides = values[:, : contact + 1], values[:, contact:]
    parts = np.concatenate([_intervals(side) for side in sides], axis=1) * (step / 24.0)[..., None]
    return np.concatenate([np.zeros_like(values[:, :1]), np.cumsum(parts, axis=1)], axis=1)


def _intervals(f: np.ndarray) -> np.ndarray:
    """24 times the integral over each interval of unit width, from the cubic through the four nearest nodes."""
    inner = 13.0 * (f[:, 1:-2] + f[:, 2:-1]) - f[:, :-3] - f[:, 3:]
    first = 9.0 * f[:, 0] + 19.0 * f[:, 1] - 5.0 * f[:, 2] + f[:, 3]
    last = 9.0 * f[:, -1] + 19.0 * f[:, -2] - 5.0 * f[:, -3] + f[:, -4]
    return np.concatenate([first[:, None], inner, last[:, None]], axis=1)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """np.cross without its generality, which costs more than the arithmetic."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def bend(
    parameters: np.ndarray,
    length_m: float,
    gravity_m_s2: np.ndarray,
    contact_m: np.ndarray,
    force_N: np.ndarray,
    *,
    dead: bool = False,
    sweeps: int = 2,
) -> Curves:
    """Shapes of antennas under weight and one point force each.

    Parameters
    ----------
    parameters : (B, 8), see `PARAMETERS`.
    gravity_m_s2 : (B, 3) antenna frame.
    contact_m : (B,) arc length of the force from the clamp.
    force_N : (B, 2). By default the components (y, z), in the clamp's frame, of a force along the antenna's normal at
        the contact before it is turned with the antenna: a contact without friction. With `dead`, the components (y, z)
        of a hanging load, antenna frame, which keeps its direction.
    sweeps : passes over the equilibrium of moments. The error left falls by the ratio of weight and sag to the force's
        bending, 1–5 %, with each.

    Notes
    -----
    Without weight, bow and `dead`, one pass is the elastica itself.
    """
    batch = len(parameters)
    stiffness, mass = np.exp(parameters[:, 6]), np.exp(parameters[:, 7])
    clamp_turn = Rotation.from_rotvec(
        np.stack([np.zeros(batch), parameters[:, 2], parameters[:, 3]], axis=1)
    ).as_matrix()
    weight = mass[:, None] * np.einsum("bji,bj->bi", clamp_turn, gravity_m_s2)
    # A force at the very tip leaves nothing beyond it; a micrometre in a metre keeps the nodes apart.
    contact_m = np.minimum(contact_m, (1 - 1e-6) * length_m)
    s = aligned_arclength(contact_m, length_m)
    step = np.diff(s, axis=1)

    applied = np.einsum("bji,bj->bi", clamp_turn, np.pad(force_N, ((0, 0), (1, 0)))) if dead else None
    lateral = force_N if applied is None else applied[:, 1:]
    size = np.hypot(lateral[:, 0], lateral[:, 1])
    toward = np.where(size[:, None] > 0, lateral / np.where(size > 0, size, 1.0)[:, None], [1.0, 0.0])
    theta = planar_elastica(s, contact_m, size, stiffness).theta_rad
    sin, cos = np.sin(theta), np.cos(theta)
    contact = NODES_TO_CONTACT - 1
    contact_turn = _hinge_turn(sin, cos, toward)

    small = np.zeros((batch, s.shape[1], 3))
    bow = np.pad(parameters[:, 4:6], ((0, 0), (1, 0)))[:, None, :]
    across = np.pad(toward, ((0, 0), (1, 0)))
    planar_force = size[:, None] * np.einsum("bij,bj->bi", contact_turn[:, contact], across)
    universal_points: np.ndarray | None = None
    for sweep in range(sweeps + 1):
        tangents = np.einsum("bnij,bnj->bni", contact_turn, _turned_x(small))
        points = _integrate(tangents, step)
        body_force = size[:, None] * _turned(small[:, contact], across)
        force = applied if applied is not None else np.einsum("bij,bj->bi", contact_turn[:, contact], body_force)
        if universal_points is None:
            universal_points = points
        if sweep == sweeps:
            break
        moment = _cross(_centre_lever(points, step), weight[:, None, :])
        inner = slice(0, contact + 1)
        lever = points[:, contact, None] - points[:, inner]
        planar_lever = universal_points[:, contact, None] - universal_points[:, inner]
        moment[:, inner] += _cross(lever, force[:, None]) - _cross(planar_lever, planar_force[:, None])
        curvature = np.einsum("bnji,bnj->bni", contact_turn, moment) / stiffness[:, None, None]
        curvature -= _cross(small, curvature)
        curvature[..., 0] = 0.0  # torsion turns the section of a round wire, not its axis
        curvature += bow
        small = _integrate(curvature + 0.5 * _cross(small, curvature), step)

    offset = np.pad(parameters[:, :2], ((0, 0), (1, 0)))
    points = np.einsum("bij,bnj->bni", clamp_turn, points) + offset[:, None]
    tangents = np.einsum("bij,bnj->bni", clamp_turn, tangents)
    force = np.einsum("bij,bj->bi", clamp_turn, force)
    gravity_force = mass[:, None] * gravity_m_s2
    first_moment = _integrate(points, step)[:, -1]
    total = _cross(points[:, contact], force) + _cross(first_moment, gravity_force)
    return Curves(s, points, tangents, force, -total[:, 1])


def _hinge_turn(sin: np.ndarray, cos: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """(B, N, 3, 3) rotations by θ in the plane of x and `toward` (B, 2)."""
    y, z = toward[:, None, 0], toward[:, None, 1]
    rest = cos - 1.0
    return np.stack(
        [
            np.stack([cos, -sin * y, -sin * z], axis=-1),
            np.stack([sin * y, 1.0 + rest * y * y, rest * y * z], axis=-1),
            np.stack([sin * z, rest * y * z, 1.0 + rest * z * z], axis=-1),
        ],
        axis=-2,
    )


def _turned_x(rotvec: np.ndarray) -> np.ndarray:
    """exp(ω)·(1, 0, 0) for ω (..., 3)."""
    square = (rotvec**2).sum(axis=-1)
    half = 0.5 * np.sqrt(square)
    sinc, rest = np.sinc(2 * half / np.pi), 0.5 * np.sinc(half / np.pi) ** 2
    x, y, z = rotvec[..., 0], rotvec[..., 1], rotvec[..., 2]
    return np.stack([1 - rest * (square - x * x), sinc * z + rest * x * y, -sinc * y + rest * x * z], axis=-1)


def _turned(rotvec: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """exp(ω)·v, both (B, 3)."""
    return Rotation.from_rotvec(rotvec).apply(vector)


def _centre_lever(points: np.ndarray, step: np.ndarray) -> np.ndarray:
    """∫ₛᴸ (p(σ) − p(s)) dσ at every node, (B, N, 3): the lever of the weight that hangs beyond it."""
    summed = _integrate(points, step)
    rest = np.concatenate([np.cumsum(step[:, ::-1], axis=1)[:, ::-1], np.zeros_like(step[:, :1])], axis=1)
    return summed[:, -1:] - summed - rest[..., None] * points
