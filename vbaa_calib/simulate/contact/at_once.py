"""Frictionless contacts with a cylinder, a sphere or a knife edge: all frames of a stroke at once.

They depend only on the side from which the antenna came, which is a matter of history. Around a line (the
cylinder's axis, the knife's edge) the antenna with tangent t passes at the signed offset D along t × axis. The side of
a contact is the sign of D when the antenna was last free, or in the first frame if that one touches already; it is
kept, however far beyond the axis the antenna, bent by its weight alone, would be by then, until D is outside the object
on that same side again, or the antenna passes the object's end or no longer reaches it. A knife edge is only touched
from the side its wedge points away from. A sphere leaves no choice: the antenna is in stable equilibrium only on the
side on which it would pass unloaded.

Per frame the clamp moment M(0), the contact's arc length s, the normal force N and the outward normal n satisfy

    M(L) = 0                                  the rod is in equilibrium under N n at s
    r(s) − nearest core point = (R + antenna radius − N/k) n          the surfaces touch, indented by N/k
    n·t(s) = 0, or s = L and n·t ≤ 0          s is the nearest point: inside the antenna, or its tip

all solved together. The normal starts on the side from which the antenna came, and stays within 90° of it. An
indentation deeper than the object's radius counts as the object giving way along n.

A frame's state is (7,): M(0) in EI/L, s in L, N in EI/L², and two coordinates of n in the plane that touches the unit
sphere at the normal at which it started.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape, solve_rod
from vbaa_calib.core.errors import SolveError
from vbaa_calib.native import core
from vbaa_calib.simulate.scene.objects import TouchObject

from .stick_slip import STROKE, Bases, Held, Setting, tangent_axes


@dataclass(frozen=True, eq=False)
class _Core:
    """The object's axis or centre in B antenna frames; `across` (B, 3, 3) projects onto the directions across the
    axis."""

    center_m: np.ndarray
    axis: np.ndarray
    wedge: np.ndarray
    across: np.ndarray

    def offset(self, points_m: np.ndarray) -> np.ndarray:
        """(B, ..., 3) vectors from the nearest point of the core to points (B, ..., 3)."""
        center = self.center_m.reshape(len(points_m), *(1,) * (points_m.ndim - 2), 3)
        return np.einsum("bij,b...j->b...i", self.across, points_m - center)


@dataclass(frozen=True, eq=False)
class _FrictionlessProblem:
    """Equilibrium problem of all B frames of a stroke, each in its own antenna frame.

    gravity : (B, 3). unloaded : the antenna under its weight alone. reach_m : the object's radius plus the antenna's
        at its clamp, antenna_radius_m.
    touches, depth_m : (B,) whether, and how far, the unloaded antenna's centreline would be too deep. arclength_m :
    (B,) of its point nearest to the core. normal : (B, 3) outward from the object, on the side that touches.
    """

    rod: Rod
    core: _Core
    gravity: np.ndarray
    unloaded: RodShape
    reach_m: float
    antenna_radius_m: float
    compliance_m_N: float
    touches: np.ndarray
    depth_m: np.ndarray
    arclength_m: np.ndarray
    normal: np.ndarray


def touch_at_once(setting: Setting, bases: Bases) -> tuple[np.ndarray, Held]:
    """The mask (B,) of the frames of one stroke that touch, and their frictionless contacts.

    Raises SolveError naming the first frame in which a real antenna could not be in equilibrium.
    """
    problem = _problem(setting, bases)
    rows = np.flatnonzero(problem.touches)
    arclength, press, normal = _solved(problem, rows)
    pulls = (press <= 0.0) & (problem.depth_m[rows] > 1e-7)
    if pulls.any():
        raise SolveError(f"frame {rows[np.argmax(pulls)]}: the force would have to pull")
    # within the solver's accuracy of first touch the force may come out as nothing
    firm = press > 0.0
    touches, gripped, at = np.zeros(len(problem.touches), bool), Held.nowhere(len(problem.touches)), rows[firm]
    touches[at], gripped.arclength_m[at], gripped.press_N[at], gripped.grip_N[at] = (
        True,
        arclength[firm],
        press[firm],
        0.0,
    )
    gripped.normal[at] = np.einsum("bij,bj->bi", bases.rotation[at], normal[firm])
    return touches, gripped


def _problem(setting: Setting, bases: Bases) -> _FrictionlessProblem:
    rod, obj = setting.rod, setting.object
    core = _Core(
        center_m=np.einsum("bji,bj->bi", bases.rotation, obj.center_world_m - bases.origin_m),
        axis=np.asarray(obj.axis_world, float) @ bases.rotation,
        wedge=np.asarray(obj.wedge_world, float) @ bases.rotation,
        across=np.swapaxes(bases.rotation, 1, 2) @ obj.across @ bases.rotation,
    )
    gravity = setting.gravity_world_m_s2 @ bases.rotation
    unloaded = solve_rod(rod, gravity, np.full(len(gravity), rod.length_m / 2), np.zeros_like(gravity))
    arclength, point, tangent = _nearest(core, unloaded)
    reach = obj.radius_m + setting.radius_at(arclength)
    offset, reaches = core.offset(point), arclength < unloaded.arclength_m[:, -1]
    if obj.shape == "sphere":
        touches, depth, normal = _sphere(offset, reaches, bases.rotation, reach)
    else:
        within = np.abs(np.einsum("bi,bi->b", core.axis, point - core.center_m)) <= obj.half_length_m
        touches, depth, normal = _line(obj, core, offset, tangent, (reaches, within), reach)
    compliance = 1.0 / obj.stiffness_N_m
    at_clamp, radius = obj.radius_m + setting.antenna_radius_m, setting.antenna_radius_m
    return _FrictionlessProblem(
        rod, core, gravity, unloaded, at_clamp, radius, compliance, touches, depth, arclength, normal
    )


def _nearest(core: _Core, shape: RodShape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arc length (B,), point and tangent (B, 3) at which each shape is nearest to the core."""
    length = shape.arclength_m[:, -1:]
    grid = np.linspace(0.0, 1.0, STROKE.samples + 1) * length
    square = (core.offset(sample_shape(shape, grid)[0]) ** 2).sum(axis=-1)
    inner = np.clip(np.argmin(square, axis=1), 1, STROKE.samples - 1)[:, None]
    low, middle, high = (np.take_along_axis(square, inner + i, axis=1) for i in (-1, 0, 1))
    curvature = low - 2.0 * middle + high
    shift = 0.5 * (low - high) / np.where(curvature > 0.0, curvature, np.inf)
    # at an end only the parabola's minimum inside the rod counts
    arclength = np.clip((inner + np.clip(shift, -1.0, 1.0)) / STROKE.samples, 0.0, 1.0) * length
    point, tangent = sample_shape(shape, arclength)
    return arclength[:, 0], point[:, 0], tangent[:, 0]


def _sphere(
    offset: np.ndarray, reaches: np.ndarray, rotations: np.ndarray, reach_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contact mask (B,), depth (B,) and normal (B, 3) for a sphere."""
    away = np.linalg.norm(offset, axis=1)
    in_world = np.einsum("bij,bj->bi", rotations, offset)
    for i in range(1, len(away)):
        before, after = in_world[i - 1], in_world[i]
        step = after - before
        share = np.clip(-(before @ step) / max(float(step @ step), 1e-30), 0.0, 1.0)
        passes = before @ after < 0.0 and np.linalg.norm(before + share * step) < reach_m[i]
        if passes and reaches[i - 1] and reaches[i]:
            raise SolveError(
                f"frame {i}: pushed past the sphere's centre since the last frame, the antenna would slip off round the"
                " sphere; push less far, or use a cylinder"
            )
    return away < reach_m, reach_m - away, offset / np.maximum(away, 1e-12)[:, None]


def _line(
    obj: TouchObject,
    core: _Core,
    offset: np.ndarray,
    tangent: np.ndarray,
    reaches_within: tuple[np.ndarray, np.ndarray],
    reach_m: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contact mask (B,), depth (B,) and normal (B, 3) for a cylinder or a knife edge."""
    reaches, within = reaches_within
    normal = np.cross(tangent, core.axis)
    sine = np.linalg.norm(normal, axis=1)
    normal = normal / np.maximum(sine, 1e-12)[:, None]
    signed = np.einsum("bi,bi->b", offset, normal)
    present = within & (reaches | (np.linalg.norm(offset, axis=1) < reach_m))
    if obj.shape == "knife_edge":
        side = np.where(np.einsum("bi,bi->b", core.wedge, normal) > 0.0, -1.0, 1.0)
    else:
        side = np.where(signed < 0.0, -1.0, 1.0)
        for i in range(1, len(side)):
            if present[i]:
                side[i] = side[i - 1]
    depth = reach_m - side * signed
    touches = present & (depth > 0.0)
    # sine of the angle between antenna and axis below which they are parallel
    along = np.flatnonzero(touches & (sine < 0.05))
    if along.size:
        raise SolveError(f"frame {along[0]}: the antenna lies along the object's axis; a point contact needs an angle")
    return touches, depth, side[:, None] * normal


def _first_guess(problem: _FrictionlessProblem, rows: np.ndarray) -> np.ndarray:
    """(R, 7) initial states of frames `rows` (R,): a straight cantilever in series with the object's spring,
    displaced by the depth."""
    rod = problem.rod
    arclength = np.clip(problem.arclength_m[rows], 0.05 * rod.length_m, 0.999 * rod.length_m)
    compliance = rod.yielding_m(arclength) + problem.compliance_m_N
    force = problem.depth_m[rows] / compliance
    tangent = rod.T_antenna_clamp.rotation[:, 0]
    weight = rod.mass_kg * problem.gravity[rows]
    moment = problem.unloaded.clamp_moment_Nm[rows] - np.cross(rod.T_antenna_clamp.translation_m, weight)
    moment = moment + np.cross(arclength[:, None] * tangent, force[:, None] * problem.normal[rows])
    unit = rod.bending_stiffness_Nm2 / rod.length_m
    if rod.taper:  # the tip's turn stands for it
        moment = np.zeros_like(moment)
    scaled = (moment / unit, arclength[:, None] / rod.length_m, force[:, None] * rod.length_m / unit)
    return np.hstack([*scaled, np.zeros((rows.size, 2))])


def _solved(problem: _FrictionlessProblem, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arc lengths, normal forces (R,) and normals (R, 3); frames that do not converge are solved again with the
    indentation increased step by step."""
    rod, normal = problem.rod, problem.normal[rows]
    state = _first_guess(problem, rows)
    steep = rod.length_m / np.maximum(problem.arclength_m[rows], 0.05 * rod.length_m)
    ones = np.ones_like(steep)
    upper = np.stack([*[50.0 * steep] * 3, ones, 50.0 * steep**2, 3.0 * ones, 3.0 * ones], axis=1)
    limits = np.stack([np.where(np.arange(7) == 3, 0.01, -upper), upper], axis=1)
    force_unit = rod.bending_stiffness_Nm2 / rod.length_m**2
    pressing = (
        problem.reach_m,
        problem.compliance_m_N * force_unit,
        force_unit,
        STROKE.tolerance,
        problem.antenna_radius_m,
    )
    depth = problem.depth_m[rows, None, None] * normal[:, None]
    middle, across = problem.core.center_m[rows, None], problem.core.across[rows]
    vectors = [problem.gravity[rows, None], middle, depth, across, normal[:, None], tangent_axes(normal)]
    frames = np.concatenate(vectors, axis=1)
    state, failed = core.simulate.touch_at_once(rod.numbers, pressing, frames, limits, state)
    if failed >= 0:
        frame = int(rows[failed])
        raise SolveError(
            f"frame {frame}: no equilibrium against the object, {1e3 * problem.depth_m[frame]:.1f} mm past"
            " first touch; the antenna may have slipped off"
        )
    found = normal + np.einsum("bi,bij->bj", state[:, 5:], frames[:, 7:])
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return state[:, 3] * rod.length_m, state[:, 4] * force_unit, found
