"""Pressing the antenna against an object: where it touches and how hard, for each frame of a recording.

The equilibrium of one frame stands in `equilibrium`, the side from which the antenna comes in `approach`.

Friction is Coulomb's, in full slip: μN against the slip of the antenna's material point at the contact since the frame
before, fading out as that slip vanishes; the first frame, with none before it, is frictionless. The slip is taken from
the frictionless solution, so sticking is not modelled: where a path turns back, friction turns with it at once.
Friction's lever of one antenna radius about the centreline is left out: it twists and bends a thin antenna by less
than a part in a hundred.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ..antenna.rod import Rod, RodShape, sample_shape, solve_rod
from ..errors import InputError, SolveError
from ..geometry import Pose
from .approach import Core, find_approach
from .equilibrium import Problem, first_guess, solve_equilibrium, unpack
from .objects import TouchObject


@dataclass(frozen=True, eq=False)
class Touch:
    """The contact in each of B frames.

    Attributes
    ----------
    in_contact : (B,) bool.
    contact_m : (B,) arc length of the contact from the clamp; NaN without contact.
    force_antenna_N : (B, 3) the object's force on the antenna, antenna frame; zero without contact.
    contact_antenna_m : (B, 3) point of the centreline at the contact, antenna frame; NaN without contact.
    shape : the antenna under its weight and this force.
    """

    in_contact: np.ndarray
    contact_m: np.ndarray
    force_antenna_N: np.ndarray
    contact_antenna_m: np.ndarray
    shape: RodShape


def touch(
    rod: Rod,
    antenna_radius_m: float,
    obj: TouchObject,
    T_world_antenna: Sequence[Pose],
    gravity_world: np.ndarray,
    *,
    slip_scale_m: float = 1e-4,
) -> Touch:
    """The antenna pressed against the object, in every frame of one recording.

    Parameters
    ----------
    antenna_radius_m : half the antenna's diameter.
    T_world_antenna : B poses in order of time: the side of the contact and the friction depend on the frames before.
    gravity_world : (3,) m/s².
    slip_scale_m : friction is μN·tanh(slip since the frame before / this). Frames close together slip little: pressing
        a cylinder by 0.5° a frame slips about 0.02 mm each.

    Raises
    ------
    InputError : no frames, or a radius that is not positive.
    SolveError : names the first frame without a trustworthy equilibrium, and why.
    """
    if not T_world_antenna or not antenna_radius_m > 0.0:
        raise InputError(f"{len(T_world_antenna)} frames, antenna radius {antenna_radius_m} m", where="touch")
    rotations = np.stack([pose.rotation for pose in T_world_antenna])
    origins = np.stack([pose.translation_m for pose in T_world_antenna])
    gravity = np.asarray(gravity_world, float) @ rotations
    reach = obj.radius_m + antenna_radius_m
    core = _core_seen(obj, rotations, origins)
    mid = np.full(len(rotations), rod.length_m / 2)
    unloaded = solve_rod(rod, gravity, mid, np.zeros_like(gravity))
    approach = find_approach(obj, core, unloaded, rotations, reach)
    problem = Problem(rod, core, gravity, approach, reach, 1.0 / obj.stiffness_N_m, np.zeros_like(gravity))
    rows = np.flatnonzero(approach.touches)
    state = solve_equilibrium(problem, rows, first_guess(problem, rows, unloaded))
    result = _assemble(problem, rows, state)
    if obj.friction > 0.0 and rows.size:
        against = _against_slip(result, problem, rows, state, rotations, origins, slip_scale_m)
        problem = replace(problem, friction=obj.friction * against)
        state = solve_equilibrium(problem, rows, state)
        result = _assemble(problem, rows, state)
    _check(obj, problem, rows, state, result)
    return result


def _core_seen(obj: TouchObject, rotations: np.ndarray, origins: np.ndarray) -> Core:
    return Core(
        center_m=np.einsum("bji,bj->bi", rotations, obj.center_world_m - origins),
        axis=np.asarray(obj.axis_world, float) @ rotations,
        wedge=np.asarray(obj.wedge_world, float) @ rotations,
        across=np.swapaxes(rotations, 1, 2) @ obj.across @ rotations,
    )


def _assemble(problem: Problem, rows: np.ndarray, state: np.ndarray) -> Touch:
    rod, count = problem.rod, len(problem.gravity)
    _, arclength, press, _, pushing = unpack(problem, state, rows)
    # within the solver's accuracy of first touch the force may come out as nothing
    firm = press > 0.0
    rows, arclength, pushing = rows[firm], arclength[firm], pushing[firm]
    in_contact, contact = np.zeros(count, bool), np.full(count, np.nan)
    force, point = np.zeros((count, 3)), np.full((count, 3), np.nan)
    in_contact[rows], contact[rows], force[rows] = True, arclength, pushing
    where = np.where(in_contact, contact, rod.length_m / 2)
    shape = solve_rod(rod, problem.gravity, where, force)
    point[rows] = sample_shape(shape, where[:, None])[0][rows, 0]
    return Touch(in_contact, contact, force, point, shape)


def _against_slip(
    result: Touch,
    problem: Problem,
    rows: np.ndarray,
    state: np.ndarray,
    rotations: np.ndarray,
    origins: np.ndarray,
    slip_scale_m: float,
) -> np.ndarray:
    """(B, 3) direction of friction in the antenna frame, shorter than 1 where the slip is small; zero in frame 0."""
    _, arclength, _, normal, _ = unpack(problem, state, rows)

    def in_world(frames: np.ndarray) -> np.ndarray:
        shapes = RodShape(*(getattr(result.shape, each.name)[frames] for each in fields(RodShape)))
        points = sample_shape(shapes, arclength[:, None])[0][:, 0]
        return np.einsum("bij,bj->bi", rotations[frames], points) + origins[frames]

    moved = in_world(rows) - in_world(np.maximum(rows - 1, 0))
    slip = np.einsum("bji,bj->bi", rotations[rows], moved)
    slip = slip - (slip * normal).sum(axis=1, keepdims=True) * normal
    size = np.linalg.norm(slip, axis=1, keepdims=True)
    against = np.zeros((len(rotations), 3))
    against[rows] = -np.tanh(size / slip_scale_m) * slip / np.maximum(size, 1e-15)
    return against


def _check(obj: TouchObject, problem: Problem, rows: np.ndarray, state: np.ndarray, result: Touch) -> None:
    """Refuse equilibria that a real antenna could not hold."""
    core, approach = problem.core, problem.approach
    _, _, press, normal, _ = unpack(problem, state, rows)
    reach = problem.reach_m - press * problem.compliance_m_N
    away = np.linalg.norm(core.offset(result.shape.points_m), axis=-1).min(axis=1)[rows]
    along = np.einsum("bi,bi->b", core.axis, result.contact_antenna_m - core.center_m)[rows]
    reasons = {
        "the force would have to pull": (press <= 0.0) & (approach.depth_m[rows] > 1e-7),
        "the antenna would pass through the object elsewhere": (reach > 0.0) & (away < reach - 1e-6),
    }
    if obj.shape != "sphere":
        reasons["the contact lies beyond the object's end"] = np.abs(along) > obj.half_length_m
    if obj.shape == "knife_edge":
        reasons["the antenna lies on the blade's flank"] = (core.wedge[rows] * normal).sum(axis=1) >= 0.0
    for reason, found in reasons.items():
        if found.any():
            raise SolveError(f"frame {rows[np.flatnonzero(found)[0]]}: {reason}")
