"""Before any force: where the antenna, bent by its weight alone, runs into the object, and from which side.

The side is a matter of history. Around a line (the cylinder's axis, the knife's edge) the antenna with tangent t passes
at the signed offset D along t × axis. The side of a recording's contact is the sign of D when the antenna was last
free, or in the first frame if that one touches already; it is kept, however far beyond the axis the unloaded antenna
would be by then, until D is outside the object on that same side again, or the antenna passes the object's end or no
longer reaches it. A knife edge is only touched from the side its wedge points away from.

A sphere leaves no choice: the antenna is in stable equilibrium only on the side on which it would pass unloaded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.antenna.rod import RodShape, sample_shape
from vbaa_calib.core.errors import SolveError
from vbaa_calib.simulate.scene.objects import TouchObject

_SAMPLES = 400
_PARALLEL = 0.05


@dataclass(frozen=True, eq=False)
class Core:
    """The object's core line or point in B antenna frames.

    Attributes
    ----------
    center_m : (B, 3). axis : (B, 3). wedge : (B, 3). across : (B, 3, 3) projects on the directions across the core.
    """

    center_m: np.ndarray
    axis: np.ndarray
    wedge: np.ndarray
    across: np.ndarray

    def offset(self, points_m: np.ndarray, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(B, ..., 3) from the nearest point of the core to points (B, ..., 3), of the frames `rows`."""
        center = self.center_m[rows]
        center = center.reshape(len(center), *(1,) * (points_m.ndim - 2), 3)
        return np.einsum("bij,b...j->b...i", self.across[rows], points_m - center)


@dataclass(frozen=True, eq=False)
class Approach:
    """Of B frames, before contact forces.

    Attributes
    ----------
    touches : (B,) whether the object is in the way.
    depth_m : (B,) how far the unloaded antenna's centreline would be too deep.
    arclength_m : (B,) of its point nearest to the core.
    normal : (B, 3) outward from the object, on the side that touches, antenna frame.
    """

    touches: np.ndarray
    depth_m: np.ndarray
    arclength_m: np.ndarray
    normal: np.ndarray


def find_approach(obj: TouchObject, core: Core, unloaded: RodShape, rotations: np.ndarray, reach_m: float) -> Approach:
    """The approach of each frame; `rotations` (B, 3, 3) are R_world_antenna, `reach_m` is the object's radius plus the
    antenna's.

    Raises
    ------
    SolveError : the antenna lies along the object's axis, or went through a sphere between two frames.
    """
    arclength, point, tangent = _nearest(core, unloaded)
    offset = core.offset(point)
    reaches = arclength < unloaded.arclength_m[:, -1]
    if obj.shape == "sphere":
        return _sphere(offset, arclength, reaches, rotations, reach_m)
    along = np.einsum("bi,bi->b", core.axis, point - core.center_m)
    return _line(obj, core, offset, arclength, tangent, reaches, np.abs(along) <= obj.half_length_m, reach_m)


def _nearest(core: Core, shape: RodShape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arc length (B,), point and tangent (B, 3) where each shape is nearest to the core."""
    length = shape.arclength_m[:, -1:]
    grid = np.linspace(0.0, 1.0, _SAMPLES + 1) * length
    square = (core.offset(sample_shape(shape, grid)[0]) ** 2).sum(axis=-1)
    best = np.argmin(square, axis=1)
    inner = np.clip(best, 1, _SAMPLES - 1)[:, None]
    low, middle, high = (np.take_along_axis(square, inner + i, axis=1) for i in (-1, 0, 1))
    curvature = low - 2.0 * middle + high
    shift = 0.5 * (low - high) / np.where(curvature > 0.0, curvature, np.inf)
    # at an end only the parabola's minimum inside the rod counts
    arclength = np.clip((inner + np.clip(shift, -1.0, 1.0)) / _SAMPLES, 0.0, 1.0) * length
    point, tangent = sample_shape(shape, arclength)
    return arclength[:, 0], point[:, 0], tangent[:, 0]


def _sphere(
    offset: np.ndarray, arclength: np.ndarray, reaches: np.ndarray, rotations: np.ndarray, reach_m: float
) -> Approach:
    away = np.linalg.norm(offset, axis=1)
    in_world = np.einsum("bij,bj->bi", rotations, offset)
    for i in range(1, len(away)):
        before, after = in_world[i - 1], in_world[i]
        step = after - before
        share = np.clip(-(before @ step) / max(float(step @ step), 1e-30), 0.0, 1.0)
        passes = before @ after < 0.0 and np.linalg.norm(before + share * step) < reach_m
        if passes and reaches[i - 1] and reaches[i]:
            raise SolveError(
                f"frame {i}: pushed past the sphere's centre since the last frame, the antenna would slip off round the"
                " sphere; push less far, or use a cylinder"
            )
    normal = offset / np.maximum(away, 1e-12)[:, None]
    return Approach(away < reach_m, reach_m - away, arclength, normal)


def _line(
    obj: TouchObject,
    core: Core,
    offset: np.ndarray,
    arclength: np.ndarray,
    tangent: np.ndarray,
    reaches: np.ndarray,
    within: np.ndarray,
    reach_m: float,
) -> Approach:
    away = np.linalg.norm(offset, axis=1)
    normal = np.cross(tangent, core.axis)
    sine = np.linalg.norm(normal, axis=1)
    normal = normal / np.maximum(sine, 1e-12)[:, None]
    signed = np.einsum("bi,bi->b", offset, normal)
    facing = np.einsum("bi,bi->b", core.wedge, normal)
    present = within & (reaches | (away < reach_m))
    side = np.zeros(len(away))
    last = 0.0
    for i in range(len(away)):
        if obj.shape == "knife_edge":
            last = -1.0 if facing[i] > 0.0 else 1.0
        elif not present[i] or last == 0.0:
            last = -1.0 if signed[i] < 0.0 else 1.0
        side[i] = last
    depth = reach_m - side * signed
    touches = present & (depth > 0.0)
    along = np.flatnonzero(touches & (sine < _PARALLEL))
    if along.size:
        raise SolveError(f"frame {along[0]}: the antenna lies along the object's axis; a point contact needs an angle")
    return Approach(touches, depth, arclength, side[:, None] * normal)
