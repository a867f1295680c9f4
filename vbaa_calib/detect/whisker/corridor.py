"""Where in the picture the antenna can be, and in which shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.polyline import arc_lengths, beside, resample
from vbaa_calib.core.smooth import solve

CLAMP_REACH_PX, CLAMP_TURN_RAD = 8.0, 0.12
"""How far off the clamp itself may be, and three deviations of its direction on a rig that is not calibrated."""
BENT_AT = (
    0.6,
    0.75,
    0.5,
    0.67,
    0.55,
    0.85,
    0.45,
    0.95,
    0.4,
    0.36,
    0.32,
    1.1,
    0.28,
    0.24,
    1.5,
    0.2,
    0.17,
    3.0,
    0.14,
    0.1,
)
"""Where a force bends the antenna, in its lengths, the likeliest first; far beyond the tip it bends to an arc."""
STEEP = 0.012
"""By this part of its length, times the cube of the angle that it is bent by, perspective may change a shape: bent
towards the camera or away, it is seen larger or smaller beyond."""
SHAPE_POINTS, SHAPE_STEPS = 40, 4
"""Means of so many runs of points are compared with a shape, which is fitted in so many Gauss–Newton steps."""


@dataclass(frozen=True, eq=False)
class Corridor:
    """Where the antenna can be in the picture.

    Attributes
    ----------
    axis_px : (M, 2) the free antenna from clamp to tip, pixels.
    reach_px : (M,) how far to either side it can be at each of these points.
    width_px : the antenna's width.
    clamp_px, clamp_rad : how far beside the axis, and how much turned from it, the antenna may leave its clamp.
    shape_px : root mean square distance by which it may differ from its free shape, bent by a force; None on a rig that
        is not calibrated, whose free shape is not known.
    """

    axis_px: np.ndarray
    reach_px: np.ndarray
    width_px: float
    clamp_px: float = CLAMP_REACH_PX
    clamp_rad: float = CLAMP_TURN_RAD
    shape_px: float | None = None

    def aside(self, points_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where points (N, 2) lie: along the axis and aside of it, along its normals, (N,) px."""
        fine, along = resample(self.axis_px, 1.0)
        nearest, distance = beside(fine, points_px)
        return along[nearest], distance

    def misfit(self, points_px: np.ndarray, sigma_px: np.ndarray) -> float:
        """How far points (N, 2) of deviations (N,), from the clamp on, are from a shape that the antenna can take.

        The sum of the squares of offset and turn at the clamp and of the distance from the shape, over what is allowed
        each: more than 1 is no antenna. The curvature is that of a cantilever, largest at the clamp and none beyond
        the force, added to the free antenna's.
        """
        assert self.shape_px is not None
        allowed = (self.shape_px, self.clamp_px, self.clamp_rad)
        return float(_misfit(np.ascontiguousarray(self.axis_px, float), points_px, sigma_px, allowed))


@kernel
def _misfit(
    axis_px: np.ndarray, points_px: np.ndarray, sigma_px: np.ndarray, allowed: tuple[float, float, float]
) -> float:
    """The least `Corridor.misfit` of all shapes; 1 or less once one explains the points."""
    axis, _ = resample(axis_px, arc_lengths(axis_px)[-1] / 64.0)
    several, count = len(axis) - 1, min(SHAPE_POINTS, len(points_px))
    width, heading = np.empty(several), np.empty(several)
    for k in range(several):
        u, v = axis[k + 1, 0] - axis[k, 0], axis[k + 1, 1] - axis[k, 1]
        width[k], heading[k] = np.hypot(u, v), np.arctan2(v, u)
    length = width.sum()
    seen, variance = np.zeros((count, 2)), np.empty(count)
    for i in range(count):
        first, last = i * len(points_px) // count, (i + 1) * len(points_px) // count
        run = last - first
        for n in range(first, last):
            seen[i] += points_px[n] / run
        variance[i] = allowed[0] ** 2 + (sigma_px[first:last] ** 2).mean() / run
    bent, curve, least = np.empty(several), np.empty((several + 1, 2)), np.inf
    lever, matrix, side, row = np.empty(several + 1), np.empty((3, 3)), np.empty((3, 1)), np.ones(3)
    for at in BENT_AT:
        along, lever[0] = 0.0, 0.0
        for k in range(several):
            reach = min((along + 0.5 * width[k]) / (at * length), 1.0)
            bent[k], along = reach * (2.0 - reach), along + width[k]
            lever[k + 1] = lever[k] + bent[k] * width[k]
        aside, turned, bend = 0.0, 0.0, 0.0
        for step in range(SHAPE_STEPS + 1):
            curve[0, 0] = axis[0, 0] - aside * np.sin(heading[0])
            curve[0, 1] = axis[0, 1] + aside * np.cos(heading[0])
            for k in range(several):
                angle = heading[k] + turned + bend * bent[k]
                curve[k + 1, 0] = curve[k, 0] + width[k] * np.cos(angle)
                curve[k + 1, 1] = curve[k, 1] + width[k] * np.sin(angle)
            matrix[:], side[:] = 0.0, 0.0
            matrix[0, 0], matrix[1, 1], matrix[2, 2] = allowed[1] ** -2.0, allowed[2] ** -2.0, 1e-9
            side[0, 0], side[1, 0] = -aside * matrix[0, 0], -turned * matrix[1, 1]
            total = (aside / allowed[1]) ** 2 + (turned / allowed[2]) ** 2
            k, along, steep = 0, 0.0, (STEEP * length * abs(bend) ** 3) ** 2
            for i in range(count):
                while True:
                    u, v = (curve[k + 1, 0] - curve[k, 0]) / width[k], (curve[k + 1, 1] - curve[k, 1]) / width[k]
                    x, y = seen[i, 0] - curve[k, 0], seen[i, 1] - curve[k, 1]
                    part = (x * u + y * v) / width[k]
                    if part <= 1.0 or k == several - 1:
                        break
                    along, k = along + width[k], k + 1
                off, weight = y * u - x * v, 1.0 / ((variance[i] + steep) * count)
                row[1], row[2] = along + part * width[k], lever[k] + part * (lever[k + 1] - lever[k])
                total += weight * off**2
                for a in range(3):
                    side[a, 0] += weight * row[a] * off
                    for b in range(3):
                        matrix[a, b] += weight * row[a] * row[b]
            least = min(least, total)
            if least <= 1.0 or step == SHAPE_STEPS:
                break
            solve(matrix, side)
            aside, turned, bend = aside + side[0, 0], turned + side[1, 0], bend + side[2, 0]
        if least <= 1.0:
            break
    return least
