"""Charts: how directions in the camera frame are laid out on a plane before a lens bends them.

A lens is a chart followed by a map of the plane. The perspective chart is the z = 1 plane and holds the directions in
front of the camera; the equidistant chart holds every direction but straight back, at its angle θ from the axis.
Formulas take and give coordinates one by one, each (...), NumPy or torch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

from vbaa_calib.core.arrays import Array, matrix

_SMALL_ANGLE_SQUARED = 1e-6
_LEAST_DEPTH = 1e-12
"""Z of a unit vector from which on X/Z counts as a number."""


@dataclass(frozen=True)
class Chart:
    """One layout of directions.

    to_plane : (xp, X, Y, Z) → (x, y, seen): any length of the vector; x = y = 0 where not seen.
    to_ray : (xp, x, y) → unit vector (X, Y, Z).
    ray_jacobian : (xp, x, y) → d(unit vector)/d(x, y), (..., 3, 2).
    radius_limit : no direction lies farther out in the chart.
    half_angle : radius in the chart → angle from the axis, rad.
    is_normalized : whether the chart's coordinates are X/Z, Y/Z.
    normalized : (xp, x, y) → X/Z, Y/Z, their derivatives by x and y (xx, xy, yx, yy), and whether Z > 0.
    """

    to_plane: Callable[[ModuleType, Array, Array, Array], tuple[Array, Array, Array]]
    to_ray: Callable[[ModuleType, Array, Array], tuple[Array, Array, Array]]
    ray_jacobian: Callable[[ModuleType, Array, Array], Array]
    radius_limit: float
    half_angle: Callable[[float], float]
    is_normalized: bool
    normalized: Callable[[ModuleType, Array, Array], tuple[Array, Array, tuple[Array, Array, Array, Array], Array]]


def _perspective_to_plane(xp: ModuleType, X: Array, Y: Array, Z: Array) -> tuple[Array, Array, Array]:
    seen = Z > 0
    depth = xp.where(seen, Z, 1.0)
    return xp.where(seen, X / depth, 0.0), xp.where(seen, Y / depth, 0.0), seen


def _perspective_to_ray(xp: ModuleType, x: Array, y: Array) -> tuple[Array, Array, Array]:
    z = 1.0 / xp.sqrt(1.0 + x * x + y * y)
    return x * z, y * z, z


def _perspective_ray_jacobian(xp: ModuleType, x: Array, y: Array) -> Array:
    z2 = 1.0 / (1.0 + x * x + y * y)
    z3 = z2 * xp.sqrt(z2)
    return matrix(xp, [[(1.0 + y * y) * z3, -x * y * z3], [-x * y * z3, (1.0 + x * x) * z3], [-x * z3, -y * z3]])


def _perspective_normalized(
    xp: ModuleType, x: Array, y: Array
) -> tuple[Array, Array, tuple[Array, Array, Array, Array], Array]:
    return x, y, (1.0, 0.0, 0.0, 1.0), xp.isfinite(x) & xp.isfinite(y)


def _equidistant_to_plane(xp: ModuleType, X: Array, Y: Array, Z: Array) -> tuple[Array, Array, Array]:
    off_axis2 = X * X + Y * Y
    near = (Z > 0) & (off_axis2 < _SMALL_ANGLE_SQUARED * Z * Z)
    seen = near | (off_axis2 > 0)
    # each branch gets arguments at which it and its gradient are finite, also where the other one is taken
    depth = xp.where(near, Z, 1.0)
    tan2 = xp.where(near, off_axis2, 0.0) / (depth * depth)
    off_axis = xp.sqrt(xp.where(seen & ~near, off_axis2, 1.0))
    far_ratio = xp.arctan2(off_axis, Z) / off_axis
    ratio = xp.where(near, (1.0 - tan2 * (1.0 / 3.0 - tan2 / 5.0)) / depth, far_ratio)
    return xp.where(seen, X * ratio, 0.0), xp.where(seen, Y * ratio, 0.0), seen


def _sine_ratio_and_cosine(xp: ModuleType, theta2: Array) -> tuple[Array, Array, Array]:
    """sin θ/θ, cos θ, and (cos θ − sin θ/θ)/θ², from θ²."""
    near = theta2 < _SMALL_ANGLE_SQUARED
    theta = xp.sqrt(xp.where(near, 1.0, theta2))
    sine_ratio = xp.where(near, 1.0 - theta2 / 6.0 * (1.0 - theta2 / 20.0), xp.sin(theta) / theta)
    cosine = xp.where(near, 1.0 - theta2 / 2.0 * (1.0 - theta2 / 12.0), xp.cos(theta))
    far_bend = (cosine - sine_ratio) / (theta * theta)
    return sine_ratio, cosine, xp.where(near, -1.0 / 3.0 + theta2 / 30.0, far_bend)


def _equidistant_to_ray(xp: ModuleType, x: Array, y: Array) -> tuple[Array, Array, Array]:
    sine_ratio, cosine, _ = _sine_ratio_and_cosine(xp, x * x + y * y)
    return x * sine_ratio, y * sine_ratio, cosine


def _equidistant_ray_jacobian(xp: ModuleType, x: Array, y: Array) -> Array:
    sine_ratio, _, bend = _sine_ratio_and_cosine(xp, x * x + y * y)
    return matrix(
        xp,
        [
            [sine_ratio + x * x * bend, x * y * bend],
            [x * y * bend, sine_ratio + y * y * bend],
            [-x * sine_ratio, -y * sine_ratio],
        ],
    )


def _equidistant_normalized(
    xp: ModuleType, x: Array, y: Array
) -> tuple[Array, Array, tuple[Array, Array, Array, Array], Array]:
    sine_ratio, cosine, bend = _sine_ratio_and_cosine(xp, x * x + y * y)
    ahead = cosine > _LEAST_DEPTH
    inverse = 1.0 / xp.where(ahead, cosine, 1.0)
    tangent_ratio = sine_ratio * inverse
    # d(tan θ/θ)/d(θ²), twice
    growth = bend * inverse + tangent_ratio * tangent_ratio
    shear = growth * x * y
    jacobian = (tangent_ratio + growth * x * x, shear, shear, tangent_ratio + growth * y * y)
    return x * tangent_ratio, y * tangent_ratio, jacobian, ahead


PERSPECTIVE = Chart(
    to_plane=_perspective_to_plane,
    to_ray=_perspective_to_ray,
    ray_jacobian=_perspective_ray_jacobian,
    radius_limit=math.inf,
    half_angle=math.atan,
    is_normalized=True,
    normalized=_perspective_normalized,
)

EQUIDISTANT = Chart(
    to_plane=_equidistant_to_plane,
    to_ray=_equidistant_to_ray,
    ray_jacobian=_equidistant_ray_jacobian,
    radius_limit=math.pi,
    half_angle=float,
    is_normalized=False,
    normalized=_equidistant_normalized,
)
