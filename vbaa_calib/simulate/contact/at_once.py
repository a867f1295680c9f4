"""All frames of a stroke at once: contacts that hang on nothing but the side from which the antenna came.

Friction, where it is asked for, is in full slip: against the slip of the frictionless solution, fading out as that
vanishes. Sticking stands in `strokes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape, solve_rod
from vbaa_calib.core.errors import SolveError
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.scene.objects import LINES, TouchObject

from .approach import Core, find_approach
from .equilibrium import Problem, first_guess, solve_equilibrium, unpack
from .holding import Touch, stacked


def touch_at_once(
    rod: Rod,
    antenna_radius_m: float,
    obj: TouchObject,
    T_world_antenna: Sequence[Pose],
    gravity_world_m_s2: np.ndarray,
    slip_scale_m: float | None,
) -> Touch:
    """As `touch.touch`, of a cylinder, a sphere or a knife edge; without `slip_scale_m` friction is left out."""
    rotations, origins = stacked(T_world_antenna)
    gravity = np.asarray(gravity_world_m_s2, float) @ rotations
    reach = obj.radius_m + antenna_radius_m
    core = _core_seen(obj, rotations, origins)
    mid = np.full(len(rotations), rod.length_m / 2)
    unloaded = solve_rod(rod, gravity, mid, np.zeros_like(gravity))
    approach = find_approach(obj, core, unloaded, rotations, reach)
    problem = Problem(rod, core, gravity, approach, reach, 1.0 / obj.stiffness_N_m, np.zeros_like(gravity))
    rows = np.flatnonzero(approach.touches)
    state = solve_equilibrium(problem, rows, first_guess(problem, rows, unloaded))
    result = _assemble(problem, rows, state, rotations, origins, antenna_radius_m)
    if slip_scale_m is not None and obj.friction > 0.0 and rows.size:
        against = _against_slip(result, problem, rows, state, rotations, origins, slip_scale_m)
        problem = replace(problem, friction=obj.friction * against)
        state = solve_equilibrium(problem, rows, state)
        result = _assemble(problem, rows, state, rotations, origins, antenna_radius_m)
    _check(obj, problem, rows, state, result)
    return result


def _core_seen(obj: TouchObject, rotations: np.ndarray, origins: np.ndarray) -> Core:
    return Core(
        center_m=np.einsum("bji,bj->bi", rotations, obj.center_world_m - origins),
        axis=np.asarray(obj.axis_world, float) @ rotations,
        wedge=np.asarray(obj.wedge_world, float) @ rotations,
        across=np.swapaxes(rotations, 1, 2) @ obj.across @ rotations,
    )


def _assemble(
    problem: Problem, rows: np.ndarray, state: np.ndarray, rotations: np.ndarray, origins: np.ndarray, radius_m: float
) -> Touch:
    rod, count = problem.rod, len(problem.gravity)
    _, arclength, press, normal, pushing = unpack(problem, state, rows)
    # within the solver's accuracy of first touch the force may come out as nothing
    firm = press > 0.0
    rows, arclength, press, normal, pushing = (values[firm] for values in (rows, arclength, press, normal, pushing))
    in_contact, contact = np.zeros(count, bool), np.full(count, np.nan)
    force, point = np.zeros((count, 3)), np.full((count, 3), np.nan)
    in_contact[rows], contact[rows], force[rows] = True, arclength, pushing
    where = np.where(in_contact, contact, rod.length_m / 2)
    shape = solve_rod(rod, problem.gravity, where, force)
    at, along = (values[:, 0] for values in sample_shape(shape, where[:, None]))
    point[rows] = at[rows]
    outward, touched = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    outward[rows] = np.einsum("bij,bj->bi", rotations[rows], normal)
    in_world = np.einsum("bij,bj->bi", rotations, point) + origins
    depth = radius_m - press * problem.compliance_m_N
    touched[rows] = in_world[rows] - depth[:, None] * outward[rows]
    slip = _slip(in_world, contact, np.einsum("bij,bj->bi", rotations, along), outward)
    return Touch(in_contact, contact, force, point, touched, outward, np.zeros(count, bool), slip, shape)


def _slip(points: np.ndarray, arclength: np.ndarray, tangents: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(B, 3) ΔX − t Δs across the normal, world frame; zero where the frame before has no contact."""
    middle = tangents[1:] + tangents[:-1]
    middle = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    way = np.diff(points, axis=0) - np.diff(arclength)[:, None] * middle
    way = way - (way * normal[1:]).sum(axis=1, keepdims=True) * normal[1:]
    return np.nan_to_num(np.vstack([np.zeros((1, 3)), way]))


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
    if obj.shape in LINES:
        reasons["the contact lies beyond the object's end"] = np.abs(along) > obj.half_length_m
    if obj.shape == "knife_edge":
        reasons["the antenna lies on the blade's flank"] = (core.wedge[rows] * normal).sum(axis=1) >= 0.0
    for reason, found in reasons.items():
        if found.any():
            raise SolveError(f"frame {rows[np.flatnonzero(found)[0]]}: {reason}")
