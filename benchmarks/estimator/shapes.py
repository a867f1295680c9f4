"""True shapes for the estimator's benchmark, by two ways that share no code with the model that is fitted in space.

`elastica_shapes` is the closed form in the deformation plane 𝒟: straight, weightless antennas. `rod_shapes` is the
static Kirchhoff rod (`antenna.rod`) with weight, bow and clamp error; its loads are dead, so the force's lean is solved
for together with the clamp moment, until the force lies at the wanted angle to the antenna where they touch.

A touch is a distance, a push and a friction angle. The push (2,) has the size of the whole force and the direction of
its components along y and z; the force leans out of the yz plane by as much as the antenna's slope and friction ask.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.harness import concatenated, picked
from vbaa_calib.antenna.elastica import planar_elastica
from vbaa_calib.antenna.newton import newton
from vbaa_calib.antenna.rod import STEPS_PER_SEGMENT, RodShape, node_arclength, sample_shape, shoot
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.rig import Rig

from .setup import rod_of

_TOLERANCE = 1e-10
"""On the moment left at the tip in EI/L, and on the sine of the force's angle."""
_PIECE = 500


@dataclass(frozen=True, eq=False)
class Touches:
    """B contacts, of an antenna each.

    Attributes
    ----------
    distance_m : (B,) arc length of the contact from the clamp.
    push_N : (B, 2) size of the force, in the direction of its components y and z.
    friction_rad : (B,) angle of the force from the antenna's normal at the contact, positive towards the clamp.
    gravity_m_s2 : (B, 3) antenna frame.
    """

    distance_m: np.ndarray
    push_N: np.ndarray
    friction_rad: np.ndarray
    gravity_m_s2: np.ndarray

    def __len__(self) -> int:
        return len(self.distance_m)


@dataclass(frozen=True, eq=False)
class Shapes:
    """B antennas under their touches, antenna frame.

    Attributes
    ----------
    points_m : (B, N, 3) at the arc lengths that were asked for. contact_m : (B, 3). force_N : (B, 3) on the antenna.
    moment_Nm : (B,) x·f_z − z·f_x of force and weight, the paper's τ_y. tangent : (B, 3) unit, at the contact.
    """

    points_m: np.ndarray
    contact_m: np.ndarray
    force_N: np.ndarray
    moment_Nm: np.ndarray
    tangent: np.ndarray


ShapesOf = Callable[[Rig, Touches, np.ndarray], Shapes]
"""(rig, touches, arc lengths (N,)) → shapes: what a scene is made by."""


def elastica_shapes(rig: Rig, touches: Touches, arclength_m: np.ndarray) -> Shapes:
    """In closed form. Raises InputError for an antenna with weight, bow or a clamp that gives."""
    parameters = rig.antenna.parameters
    if touches.gravity_m_s2.any() or parameters[4:6].any() or parameters[8]:
        raise InputError("the elastica knows neither weight, bow nor give", where="scene", remedy="make it by the rod")
    size, toward = _size_and_direction(touches.push_N)
    s = np.concatenate([np.broadcast_to(arclength_m, (len(size), len(arclength_m))), touches.distance_m[:, None]], 1)
    shape = planar_elastica(s, touches.distance_m, size, rig.antenna.stiffness_Nm2, touches.friction_rad)
    in_clamp = np.concatenate([shape.x_m[..., None], shape.w_m[..., None] * toward[:, None]], axis=2)
    theta = shape.theta_rad[:, -1]
    T_antenna_clamp = rod_of(rig).T_antenna_clamp
    points = T_antenna_clamp @ in_clamp
    force = size[:, None] * _leaning(theta + touches.friction_rad, toward) @ T_antenna_clamp.rotation.T
    contact = points[:, -1]
    tangent = _leaning(theta - np.pi / 2, toward) @ T_antenna_clamp.rotation.T
    moment = contact[:, 0] * force[:, 2] - contact[:, 2] * force[:, 0]
    return Shapes(points[:, :-1], contact, force, moment, tangent)


def rod_shapes(rig: Rig, touches: Touches, arclength_m: np.ndarray) -> Shapes:
    """By the static rod, rigidly clamped. Raises SolveError naming the touch for which no equilibrium was found."""
    pieces = np.split(np.arange(len(touches)), range(_PIECE, len(touches), _PIECE))
    return concatenated([_rod_piece(rig, picked(touches, piece), arclength_m) for piece in pieces])


def _rod_piece(rig: Rig, touches: Touches, arclength_m: np.ndarray) -> Shapes:
    rod = rod_of(rig)
    size, toward = _size_and_direction(touches.push_N)
    sin_friction = np.sin(touches.friction_rad)
    unit = rod.bending_stiffness_Nm2 / rod.length_m

    def nodes(x: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        direction = _leaning(x[:, 3], toward[rows])
        force = size[rows, None] * direction
        solved = shoot(rod, touches.gravity_m_s2[rows], touches.distance_m[rows], force, x[:, :3] * unit)
        at_tip = touches.distance_m[rows] >= rod.length_m
        return solved, np.where(at_tip, solved[-1], solved[STEPS_PER_SEGMENT]), direction

    def residual(x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        solved, contact, direction = nodes(x, rows)
        lean = (direction * contact[1].T).sum(axis=1) + sin_friction[rows]
        return np.hstack([solved[-1, 3].T / unit, lean[:, None]])

    # a straight antenna's moment, and a lean by the slope that the load alone would give
    load = size * touches.distance_m**2 / rod.bending_stiffness_Nm2
    weight = rod.mass_per_length_kg_m * rod.length_m * touches.gravity_m_s2
    lean = touches.friction_rad + load / (2.0 + 0.5 * load)
    force = size[:, None] * _leaning(lean, toward)
    straight = np.cross(
        rod.T_antenna_clamp.rotation[:, 0], touches.distance_m[:, None] * force + rod.length_m / 2 * weight
    )
    start = np.concatenate([straight / unit, lean[:, None]], axis=1)
    state, left = newton(residual, start, tolerance=_TOLERANCE)
    if not (left <= _TOLERANCE).all():
        worst = int(np.argmax(left))
        raise SolveError(f"no equilibrium for a push of {size[worst]:.3g} N at {touches.distance_m[worst]:.4f} m")
    solved, contact, direction = nodes(state, np.arange(len(size)))
    force = size[:, None] * direction
    moment = state[:, :3] * unit + np.cross(rod.T_antenna_clamp.translation_m, force + weight)
    along = np.moveaxis(solved, -1, 0)
    tangents = along[:, :, 1] / np.linalg.norm(along[:, :, 1], axis=-1, keepdims=True)
    shape = RodShape(node_arclength(rod, touches.distance_m).T, along[:, :, 0], tangents, moment)
    points = sample_shape(shape, np.broadcast_to(arclength_m, (len(size), len(arclength_m))))[0]
    return Shapes(points, contact[0].T, force, -moment[:, 1], contact[1].T)


def _leaning(lean_rad: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """(B, 3) unit vectors that lean from the directions (B, 2) across x by so much against x."""
    return np.concatenate([-np.sin(lean_rad)[:, None], np.cos(lean_rad)[:, None] * toward], axis=1)


def _size_and_direction(push_N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sizes (B,) and unit directions (B, 2); along y where there is no push."""
    size = np.hypot(push_N[:, 0], push_N[:, 1])
    there = size[:, None] > 0.0
    return size, np.where(there, push_N / np.where(there, size[:, None], 1.0), [1.0, 0.0])
