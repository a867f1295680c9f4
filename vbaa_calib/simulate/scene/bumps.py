"""A smooth closed body in free form: a ball with bumps and dents.

Its surface is F(p) = 0 with p counted from the centre and

    F(p) = |p| − R − Σ height · exp(−|p − R·direction|² / (2·width²))

Gradient and curvature are exact, so that the nearest point of the surface is found by Newton's method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vbaa_calib.core.errors import InputError

_ITERATIONS = 30
_TOLERANCE = 1e-14
_RADIUS_ITERATIONS = 6
_STEEPEST = 0.5
"""Height over width up to which F still grows from the centre outwards near the surface: |F's slope| > 1 − 0.61·0.5."""


@dataclass(frozen=True, eq=False)
class Bump:
    """A bump, or a dent where its height is negative.

    Attributes
    ----------
    direction_world : (3,) unit vector from the body's centre to its middle.
    height_m : above the ball. width_m : standard deviation of its Gaussian.
    """

    direction_world: np.ndarray
    height_m: float
    width_m: float

    def __post_init__(self) -> None:
        if not abs(float(np.linalg.norm(self.direction_world)) - 1.0) < 1e-6:
            raise InputError("direction_world has not length 1", where="bump", remedy="give a unit vector")
        if not (self.width_m > 0.0 and abs(self.height_m) <= _STEEPEST * self.width_m):
            raise InputError(
                f"a bump {self.height_m} m high and {self.width_m} m wide is too steep",
                where="bump",
                remedy=f"keep its height below {_STEEPEST} of its width",
            )


def implicit(points_m: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F (K,), its gradient (K, 3) and its second derivatives (K, 3, 3) at points (K, 3) from the centre, not on it."""
    away = np.linalg.norm(points_m, axis=1)
    outward = points_m / away[:, None]
    value, slope = away - radius_m, outward.copy()
    bend = (np.eye(3) - outward[:, :, None] * outward[:, None, :]) / away[:, None, None]
    for bump in bumps:
        offset = points_m - radius_m * bump.direction_world
        square = bump.width_m**2
        lift = bump.height_m * np.exp(-0.5 * (offset**2).sum(axis=1) / square)
        value = value - lift
        slope = slope + (lift / square)[:, None] * offset
        outer = offset[:, :, None] * offset[:, None, :] / square
        bend = bend + (lift / square)[:, None, None] * (np.eye(3) - outer)
    return value, slope, bend


def elevation(points_m: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> np.ndarray:
    """F (...) at points (..., 3) from the centre."""
    value = np.linalg.norm(points_m, axis=-1) - radius_m
    for bump in bumps:
        square = ((points_m - radius_m * bump.direction_world) ** 2).sum(axis=-1)
        value = value - bump.height_m * np.exp(-0.5 * square / bump.width_m**2)
    return np.asarray(value)


def nearest_distance(points_m: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance (K,) from the surface, negative inside, and its outward normal (K, 3) at the nearest point.

    Where no nearest point is found, deep inside, they are F over its slope, and the slope's direction; NaN in the
    centre.
    """
    points = np.asarray(points_m, float)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        foot, share = _start(points, radius_m, bumps)
        found, rows = np.zeros(len(points), bool), np.arange(len(points))
        for _ in range(_ITERATIONS):
            value, slope, bend = implicit(foot[rows], radius_m, bumps)
            left = np.concatenate([foot[rows] + share[rows, None] * slope - points[rows], value[:, None]], axis=1)
            found[rows] = np.abs(left).max(axis=1) <= _TOLERANCE
            open_rows = ~found[rows]
            rows, left = rows[open_rows], left[open_rows]
            if rows.size == 0:
                break
            step = _solved(share[rows], slope[open_rows], bend[open_rows], left)
            foot[rows] -= step[:, :3]
            share[rows] -= step[:, 3]
        at = np.where(found[:, None], foot, points)
        value, slope, _ = implicit(at, radius_m, bumps)
        steep = np.linalg.norm(slope, axis=1)
        return np.where(found, share * steep, value / steep), slope / steep[:, None]


def _start(points: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> tuple[np.ndarray, np.ndarray]:
    """The surface along each point's direction from the centre, and the multiplier that belongs to it."""
    away = np.linalg.norm(points, axis=1)
    outward = points / away[:, None]
    radius = surface_radius(outward, radius_m, bumps)
    return radius[:, None] * outward, away - radius


def surface_radius(directions: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> np.ndarray:
    """(K,) distance of the surface from the centre along unit vectors (K, 3)."""
    radius = np.full(len(directions), radius_m)
    for _ in range(_RADIUS_ITERATIONS):
        value, slope, _ = implicit(radius[:, None] * directions, radius_m, bumps)
        radius = radius - value / (slope * directions).sum(axis=1)
    return radius


def _solved(share: np.ndarray, slope: np.ndarray, bend: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(K, 4) Newton's steps of foot and multiplier; zero where the system is singular."""
    matrix = np.zeros((len(share), 4, 4))
    matrix[:, :3, :3] = np.eye(3) + share[:, None, None] * bend
    matrix[:, :3, 3] = matrix[:, 3, :3] = slope
    usable = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(left).all(axis=1)
    step = np.zeros((len(share), 4))
    try:
        step[usable] = np.linalg.solve(matrix[usable], left[usable, :, None])[..., 0]
    except np.linalg.LinAlgError:
        step[usable] = np.einsum("bij,bj->bi", np.linalg.pinv(matrix[usable]), left[usable])
    return step
