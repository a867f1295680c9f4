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
    "clamp_give_m",
)
"""Order of an antenna's parameter vector. Logarithms keep stiffness and mass positive, their errors relative.

No clamp is rigid: it turns with the moment that it holds, as if a short piece of the antenna, `clamp_give_m` long, bent
inside it."""

NODES_TO_CONTACT, NODES_BEYOND = 40, 17
CONTACT = NODES_TO_CONTACT - 1
"""The contact's node."""
TORSION_RATIO = 1.3
"""EI/GJ of a round wire, 1 + ν. Torsion turns the section, and with it the bow: hundredths of a millimetre."""


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

    arclength_m: np.ndarray
    points_m: np.ndarray
    tangents: np.ndarray
    force_N: np.ndarray
    moment_Nm: np.ndarray

    @property
    def contact_m(self) -> np.ndarray:
        """(B, 3) point of the centreline at the contact, antenna frame."""
        return self.points_m[:, CONTACT]

    def picked(self, which: np.ndarray) -> Curves:
        """The curves with these indices (K,), which may repeat."""
        return Curves(
            self.arclength_m[which],
            self.points_m[which],
            self.tangents[which],
            self.force_N[which],
            self.moment_Nm[which],
        )


def aligned_arclength(contact_m: np.ndarray, length_m: float) -> np.ndarray:
    """(B, N) nodes from the clamp to the tip, one of them at the contact: the shape is smooth on either side of it."""
    inner = contact_m[:, None] * np.linspace(0.0, 1.0, NODES_TO_CONTACT)
    outer = contact_m[:, None] + (length_m - contact_m[:, None]) * np.linspace(0.0, 1.0, NODES_BEYOND + 1)[1:]
    return np.concatenate([inner, outer], axis=1)


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
    parameters : (B, 9), see `PARAMETERS`.
    gravity_m_s2 : (B, 3) antenna frame.
    contact_m : (B,) arc length of the force from the clamp.
    force_N : (B, 2). By default the components (y, z), in the clamp's frame, of a force along the antenna's normal at
        the contact before it is turned with the antenna: a contact without friction. With `dead`, the components (y, z)
        of a hanging load, antenna frame, which keeps its direction.
    sweeps : passes over the equilibrium of moments. Each leaves a fifth to a thirtieth of the error.

    Notes
    -----
    Without weight, bow and `dead` the elastica is in equilibrium, and the sweeps leave it as it is.
    """
    # A force at the very tip leaves nothing beyond it; a micrometre in a metre keeps the nodes apart.
    contact_m = np.minimum(contact_m, (1 - 1e-6) * length_m)
    by_weight = np.exp(parameters[:, 7:8]) * gravity_m_s2
    # by the levers of the straight antenna: near enough for the direction in which weight and load act
    lever = contact_m[:, None] * force_N + 0.5 * length_m**2 * by_weight[:, 1:]
    straight = np.stack([-lever[:, 1], lever[:, 0]], axis=1)
    turn = Rotation.from_rotvec(_with_x(parameters[:, 2:4] + _given(parameters, straight))).as_matrix()
    weight = np.einsum("bji,bj->bi", turn, by_weight)
    applied = np.einsum("bji,bj->bi", turn[:, 1:], force_N) if dead else _with_x(force_N)
    in_clamp = _equilibrium(
        _Loads(
            arclength_m=aligned_arclength(contact_m, length_m),
            contact_m=contact_m,
            force_N=applied.T,
            follows=not dead,
            weight_N_m=weight.T,
            bow_per_m=_with_x(parameters[:, 4:6]).T,
            stiffness_Nm2=np.exp(parameters[:, 6]),
        ),
        sweeps,
    )
    turn = Rotation.from_rotvec(
        _with_x(parameters[:, 2:4] + _given(parameters, _held(in_clamp, weight, turn)))
    ).as_matrix()
    points = np.einsum("bij,jbn->bni", turn, in_clamp.points) + _with_x(parameters[:, :2])[:, None]
    force = np.einsum("bij,jb->bi", turn, in_clamp.force)
    centre = _integrate(np.moveaxis(points, -1, 0), in_clamp.step)[..., -1].T
    moment = np.cross(points[:, CONTACT], force)[:, 1] + np.cross(centre, by_weight)[:, 1]
    tangents = np.einsum("bij,jbn->bni", turn, in_clamp.tangents)
    return Curves(in_clamp.arclength, points, tangents, force, -moment)


def _given(parameters: np.ndarray, held_Nm: np.ndarray) -> np.ndarray:
    """(B, 2) turn of the clamp about y and z under the moments (B, 2) about them that it holds."""
    return parameters[:, 8:] / np.exp(parameters[:, 6:7]) * held_Nm


def _held(shape: _ClampShape, weight_N_m: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(B, 2) moments about y and z of force and weight (B, 3, clamp's frame) about the clamp, antenna frame."""
    centre = _integrate(shape.points, shape.step)[..., -1]
    moment = _cross(shape.points[..., CONTACT], shape.force) + _cross(centre, weight_N_m.T)
    return np.einsum("bij,jb->bi", turn, moment)[:, 1:]


@dataclass(frozen=True, eq=False)
class _Loads:
    """What bends B antennas, in the clamp's frame. Vectors have their three components first."""

    arclength_m: np.ndarray
    contact_m: np.ndarray
    force_N: np.ndarray
    follows: bool
    weight_N_m: np.ndarray
    bow_per_m: np.ndarray
    stiffness_Nm2: np.ndarray


@dataclass(frozen=True, eq=False)
class _ClampShape:
    """Arc lengths (B, N) and their steps, points and tangents (3, B, N), force (3, B); clamp's frame."""

    arclength: np.ndarray
    step: np.ndarray
    points: np.ndarray
    tangents: np.ndarray
    force: np.ndarray


@dataclass(frozen=True, eq=False)
class _Hinge:
    """Rotations by θ (B, N) in the plane of x and the unit vector `toward` (2, B, 1) across it."""

    sin: np.ndarray
    cos: np.ndarray
    toward: np.ndarray

    def turned(self, vectors: np.ndarray) -> np.ndarray:
        """R·v for v (3, B, N)."""
        return self._turned(vectors, self.sin)

    def turned_back(self, vectors: np.ndarray) -> np.ndarray:
        """Rᵀ·v for v (3, B, N)."""
        return self._turned(vectors, -self.sin)

    def at_contact(self) -> _Hinge:
        """The rotation at the contact alone, N = 1."""
        node = slice(CONTACT, CONTACT + 1)
        return _Hinge(self.sin[:, node], self.cos[:, node], self.toward)

    def _turned(self, vectors: np.ndarray, sin: np.ndarray) -> np.ndarray:
        across = vectors[1] * self.toward[0] + vectors[2] * self.toward[1]
        more = sin * vectors[0] + (self.cos - 1.0) * across
        return np.stack(
            [
                self.cos * vectors[0] - sin * across,
                vectors[1] + more * self.toward[0],
                vectors[2] + more * self.toward[1],
            ]
        )


def _equilibrium(loads: _Loads, sweeps: int) -> _ClampShape:
    """R(s) = hinge(s) · exp ω(s): the elastica's rotation, and the small one that all other moments need."""
    s = loads.arclength_m
    step = np.diff(s, axis=1)
    lateral = loads.force_N[1:]
    size = np.hypot(*lateral)
    toward = np.where(size > 0, lateral / np.where(size > 0, size, 1.0), [[1.0], [0.0]])[..., None]
    theta = planar_elastica(s, loads.contact_m, size, loads.stiffness_Nm2).theta_rad
    hinge = _Hinge(np.sin(theta), np.cos(theta), toward)
    across = np.concatenate([np.zeros_like(toward[:1]), toward])
    at_contact = hinge.at_contact()
    planar_force = size[:, None] * at_contact.turned(across)

    omega = np.zeros((3, *s.shape))
    force = planar_force if loads.follows else loads.force_N[..., None]
    tangents = hinge.turned(_turned_x(omega))
    points = _integrate(tangents, step)
    planar = _cross(points[..., CONTACT, None] - points[..., : CONTACT + 1], planar_force)
    planar = hinge.turned_back(_padded(planar, s.shape[1])) / loads.stiffness_Nm2[:, None]
    for _ in range(sweeps):
        moment = _cross(_lever_of_rest(points, step), loads.weight_N_m[..., None])
        moment[..., : CONTACT + 1] += _cross(points[..., CONTACT, None] - points[..., : CONTACT + 1], force)
        total = hinge.turned_back(moment) / loads.stiffness_Nm2[:, None]
        omega = _integrate(_omega_slope(omega, total, planar, loads.bow_per_m[..., None]), step)
        tangents = hinge.turned(_turned_x(omega))
        points = _integrate(tangents, step)
        if loads.follows:
            force = size[:, None] * at_contact.turned(_leaned(across, _turned_x(omega[..., CONTACT, None])))
    return _ClampShape(s, step, points, tangents, force[..., 0])


def _omega_slope(omega: np.ndarray, total: np.ndarray, planar: np.ndarray, bow: np.ndarray) -> np.ndarray:
    """ω′ from the moments over EI, in the elastica's frame: all of them, and the ones that the elastica carries."""
    carried = planar - _cross(omega, planar)
    needed = total - _cross(omega, total)
    rest = needed - carried + bow
    rest[0] = TORSION_RATIO * needed[0] - carried[0]
    return rest + 0.5 * _cross(omega, rest)


def _with_x(components: np.ndarray) -> np.ndarray:
    """(B, 3) vectors from their components y and z (B, 2)."""
    return np.concatenate([np.zeros((len(components), 1)), components], axis=1)


def _padded(values: np.ndarray, nodes: int) -> np.ndarray:
    """(..., nodes): zeros beyond the contact."""
    whole = np.zeros((*values.shape[:-1], nodes))
    whole[..., : values.shape[-1]] = values
    return whole


def _integrate(values: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Cumulative integral along the nodes, from 0: values (..., B, N), steps (B, N − 1).

    Fourth order on either side of the contact, where the curvature's slope jumps and steps change.
    """
    summed = np.zeros_like(values)
    summed[..., 1 : CONTACT + 1] = _intervals(values[..., : CONTACT + 1])
    summed[..., CONTACT + 1 :] = _intervals(values[..., CONTACT:])
    summed[..., 1:] *= step / 24.0
    return np.cumsum(summed, axis=-1)


def _intervals(f: np.ndarray) -> np.ndarray:
    """24 times the integral over each interval of unit width, from the cubic through the four nearest nodes."""
    areas = np.empty((*f.shape[:-1], f.shape[-1] - 1))
    areas[..., 1:-1] = 13.0 * (f[..., 1:-2] + f[..., 2:-1]) - f[..., :-3] - f[..., 3:]
    areas[..., 0] = 9.0 * f[..., 0] + 19.0 * f[..., 1] - 5.0 * f[..., 2] + f[..., 3]
    areas[..., -1] = 9.0 * f[..., -1] + 19.0 * f[..., -2] - 5.0 * f[..., -3] + f[..., -4]
    return areas


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b with the components first."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _turned_x(rotvec: np.ndarray) -> np.ndarray:
    """exp(ω)·(1, 0, 0) for ω (3, ...)."""
    x, y, z = rotvec
    square = x * x + y * y + z * z
    half = 0.5 * np.sqrt(square)
    sinc, rest = np.sinc(2 * half / np.pi), 0.5 * np.sinc(half / np.pi) ** 2
    return np.stack([1 - rest * (square - x * x), sinc * z + rest * x * y, -sinc * y + rest * x * z])


def _leaned(across: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """A vector across x, turned by the least rotation that takes x to the tangent, both (3, ...)."""
    share = (across * tangent).sum(axis=0) / (1.0 + tangent[0])
    leaned = across - share * tangent
    leaned[0] -= share
    return leaned


def _lever_of_rest(points: np.ndarray, step: np.ndarray) -> np.ndarray:
    """∫ₛᴸ (p(σ) − p(s)) dσ at every node, (3, B, N): the lever of the weight that hangs beyond it."""
    summed = _integrate(points, step)
    rest = np.zeros(points.shape[1:])
    rest[:, :-1] = np.cumsum(step[:, ::-1], axis=1)[:, ::-1]
    return summed[..., -1:] - summed - rest * points
