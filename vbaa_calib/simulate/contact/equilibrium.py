"""The equilibrium of an antenna pressed against an object, for many frames at a time.

Per frame the clamp moment M(0), the contact's arc length s, the normal force N and the outward normal n satisfy

    M(L) = 0                                  the rod is in equilibrium under N (n + friction) at s
    r(s) − nearest core point = (R + antenna radius − N/k) n          the surfaces touch, indented by N/k
    n·t(s) = 0, or s = L and n·t ≤ 0          s is the nearest point: inside the antenna, or its tip

all solved together. The normal starts on the side from which the antenna came, and stays within 90° of it. An
indentation deeper than the object's radius counts as the object giving way along n.

A frame's state is (7,): M(0) in EI/L, s in L, N in EI/L², and two coordinates of n in the plane that touches the unit
sphere at the approach's normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.antenna.newton import newton
from vbaa_calib.antenna.rod import STEPS_PER_SEGMENT, Rod, RodShape, shoot
from vbaa_calib.core.errors import SolveError

from .approach import Approach, Core

TOLERANCE = 1e-11
"""On lengths in L, moments in EI/L and n·t."""
_DEPTH_LADDER = np.linspace(0.0, 1.0, 13)[1:] ** 1.5


@dataclass(frozen=True, eq=False)
class Problem:
    """All B frames of a recording, each in its own antenna frame.

    Attributes
    ----------
    gravity : (B, 3) m/s².
    reach_m : the object's radius plus the antenna's.
    compliance_m_N : 1/k, zero for a rigid object.
    friction : (B, 3) friction force over normal force; what is not across the normal is dropped.
    """

    rod: Rod
    core: Core
    gravity: np.ndarray
    approach: Approach
    reach_m: float
    compliance_m_N: float
    friction: np.ndarray


def unpack(problem: Problem, x: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """Clamp moment (B, 3), arc length (B,), normal force (B,), normal (B, 3) and contact force (B, 3)."""
    rod, start = problem.rod, problem.approach.normal[rows]
    least = np.eye(3)[np.argmin(np.abs(start), axis=1)]
    first = np.cross(start, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    normal = start + x[:, 5:6] * first + x[:, 6:7] * np.cross(start, first)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    unit = rod.bending_stiffness_Nm2 / rod.length_m
    press = x[:, 4] * unit / rod.length_m
    friction = problem.friction[rows]
    sideways = friction - (friction * normal).sum(axis=1, keepdims=True) * normal
    return x[:, :3] * unit, x[:, 3] * rod.length_m, press, normal, press[:, None] * (normal + sideways)


def first_guess(problem: Problem, rows: np.ndarray, unloaded: RodShape) -> np.ndarray:
    """(R, 7) of frames `rows` (R,): a straight cantilever and the object's spring in series, displaced by the depth."""
    rod, approach = problem.rod, problem.approach
    arclength = np.clip(approach.arclength_m[rows], 0.05 * rod.length_m, 0.999 * rod.length_m)
    compliance = arclength**3 / (3.0 * rod.bending_stiffness_Nm2) + problem.compliance_m_N
    force = approach.depth_m[rows] / compliance
    tangent = rod.T_antenna_clamp.rotation[:, 0]
    weight = rod.mass_per_length_kg_m * rod.length_m * problem.gravity[rows]
    moment = unloaded.clamp_moment_Nm[rows] - np.cross(rod.T_antenna_clamp.translation_m, weight)
    moment = moment + np.cross(arclength[:, None] * tangent, force[:, None] * approach.normal[rows])
    unit = rod.bending_stiffness_Nm2 / rod.length_m
    scaled = (moment / unit, arclength[:, None] / rod.length_m, force[:, None] * rod.length_m / unit)
    return np.hstack([*scaled, np.zeros((rows.size, 2))])


def solve_equilibrium(problem: Problem, rows: np.ndarray, start: np.ndarray) -> np.ndarray:
    """States (rows, 7); frames that do not converge at once are pushed in by and by."""
    length = problem.rod.length_m
    steep = length / np.maximum(problem.approach.arclength_m[rows], 0.05 * length)
    ones = np.ones_like(steep)
    upper = np.stack([*[50.0 * steep] * 3, ones, 50.0 * steep**2, 3.0 * ones, 3.0 * ones], axis=1)
    lower = np.where(np.arange(7) == 3, 0.01, -upper)

    def attempt(at: np.ndarray, begin: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
        def residual(x: np.ndarray, which: np.ndarray) -> np.ndarray:
            return _residual(problem, x, rows[at[which]], share)

        return newton(residual, begin, tolerance=TOLERANCE, lower=lower[at], upper=upper[at])

    state, size = attempt(np.arange(rows.size), start, 1.0)
    failed = np.flatnonzero(~(size <= TOLERANCE))
    if failed.size:
        pushed = start[failed] * np.where(np.arange(7) == 4, _DEPTH_LADDER[0], 1.0)
        for share in _DEPTH_LADDER:
            pushed, size = attempt(failed, pushed, float(share))
        state[failed] = pushed
        if not (size <= TOLERANCE).all():
            frame = int(rows[failed[np.flatnonzero(~(size <= TOLERANCE))[0]]])
            raise SolveError(
                f"frame {frame}: no equilibrium against the object, {1e3 * problem.approach.depth_m[frame]:.1f} mm past"
                " first touch; the antenna may have slipped off"
            )
    return state


def _residual(problem: Problem, x: np.ndarray, rows: np.ndarray, share: float) -> np.ndarray:
    """(B, 7) scaled; with a share below 1 the object is drawn back until only that share of the depth is left."""
    rod, core, approach = problem.rod, problem.core, problem.approach
    moment, arclength, press, normal, force = unpack(problem, x, rows)
    nodes = shoot(rod, problem.gravity[rows], arclength, force, moment)
    contact = np.where(arclength < rod.length_m, nodes[STEPS_PER_SEGMENT], nodes[-1])
    back = (1.0 - share) * approach.depth_m[rows, None] * approach.normal[rows]
    offset = core.offset(contact[0].T + back, rows)
    reach = problem.reach_m - press * problem.compliance_m_N
    in_plane = np.einsum("bij,bj->bi", core.across[rows], normal)
    # along a line core the offset says nothing; there the normal's own component has to vanish
    gap = (offset - reach[:, None] * in_plane) / rod.length_m + (normal - in_plane)
    nearest = np.minimum(1.0 - x[:, 3], -(normal * contact[1].T).sum(axis=1))
    tip = nodes[-1, 3].T * rod.length_m / rod.bending_stiffness_Nm2
    return np.hstack([tip, gap, nearest[:, None]])
