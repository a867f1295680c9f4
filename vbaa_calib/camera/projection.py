"""Between pixels, a model's chart and rays: the same formulas for NumPy and torch, differentiable in torch.

Nothing is checked here and nothing is NaN: points that are not valid are harmless finite numbers beside a False.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import torch

from vbaa_calib.camera.models.model import Coefficients
from vbaa_calib.core.arrays import Array, matrix, namespace

from .inverse import invert
from .lens import each_lens, lens_of
from .models import LensModel

Angles = tuple[Array, Array]


def _sin_cos(angle: Array) -> tuple[Array, Array]:
    if isinstance(angle, torch.Tensor):
        return torch.sin(angle), torch.cos(angle)
    return math.sin(angle), math.cos(angle)


def apply_tilt(x: Array, y: Array, angles: Angles) -> tuple[Array, Array, Array]:
    """Onto the tilted sensor: (x, y) → (x, y, whether the point is in front of it)."""
    (sx, cx), (sy, cy) = map(_sin_cos, angles)
    a, b, w = cy * x + sy * sx * y - sy * cx, cx * y + sx, sy * x - cy * sx * y + cy * cx
    front = w > 0
    w = namespace(w).where(front, w, 1.0)
    return cy * cx * (a / w) + sy * cx, cy * cx * (b / w) - sx, front


def remove_tilt(x: Array, y: Array, angles: Angles) -> tuple[Array, Array, Array]:
    """From the tilted sensor back: the inverse of apply_tilt."""
    (sx, cx), (sy, cy) = map(_sin_cos, angles)
    a, b = (x - sy * cx) / (cy * cx), (y + sx) / (cy * cx)
    m0, m1, m2 = cy * a + sy, sy * sx * a + cx * b - cy * sx, -sy * cx * a + sx * b + cy * cx
    front = m2 > 0
    m2 = namespace(m2).where(front, m2, 1.0)
    return m0 / m2, m1 / m2, front


def _rotation(angles: Angles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """R and its derivatives by τ_x and by τ_y, each (3, 3)."""
    (sx, cx), (sy, cy) = map(_sin_cos, angles)
    rotation = np.array([[cy, sy * sx, -sy * cx], [0.0, cx, sx], [sy, -cy * sx, cy * cx]])
    by_x = np.array([[0.0, sy * cx, sy * sx], [0.0, -sx, cx], [0.0, -cy * cx, -cy * sx]])
    by_y = np.array([[-sy, cy * sx, -cy * cx], [0.0, 0.0, 0.0], [cy, sy * sx, -sy * cx]])
    return rotation, by_x, by_y


def remove_tilt_jacobians(xp: ModuleType, x: Array, y: Array, angles: tuple[float, float]) -> tuple[Array, Array]:
    """d(remove_tilt)/d(x, y) and d(remove_tilt)/d(τ_x, τ_y), each (..., 2, 2), at tilted points (x, y)."""
    rotation, *by_angle = _rotation(angles)
    R = rotation.tolist()
    a, b = (x + R[0][2]) / R[2][2], (y + R[1][2]) / R[2][2]
    m = [R[0][i] * a + R[1][i] * b + R[2][i] for i in range(3)]
    ideal = m[0] / m[2], m[1] / m[2]

    def column(dm: list[Array]) -> tuple[Array, Array]:
        return (dm[0] - ideal[0] * dm[2]) / m[2], (dm[1] - ideal[1] * dm[2]) / m[2]

    def by_tilt(D: list[list[float]]) -> tuple[Array, Array]:
        da, db = (D[0][2] - a * D[2][2]) / R[2][2], (D[1][2] - b * D[2][2]) / R[2][2]
        moved = [R[0][i] * da + R[1][i] * db + D[0][i] * a + D[1][i] * b + D[2][i] for i in range(3)]
        return column(moved)

    by_point = [column([R[row][i] / R[2][2] for i in range(3)]) for row in range(2)]
    by_angles = [by_tilt(derivative.tolist()) for derivative in by_angle]
    return tuple(matrix(xp, [[c[k] for c in columns] for k in range(2)]) for columns in (by_point, by_angles))


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A model with its numbers: floats, or tensors that broadcast against the points (coefficients in front of k)."""

    model: LensModel
    fx: Array
    fy: Array
    cx: Array
    cy: Array
    coefficients: Coefficients | torch.Tensor

    @property
    def separate(self) -> Coefficients:
        """The coefficients one by one."""
        c = self.coefficients
        return c.unbind(-1) if isinstance(c, torch.Tensor) else c


def pixel_to_chart(intrinsics: Intrinsics, u: Array, v: Array) -> tuple[Array, Array, Array]:
    """Ideal point in the model's chart of pixels, each (...), and validity."""
    xp = namespace(u)
    valid = xp.isfinite(u) & xp.isfinite(v)
    u, v = xp.where(valid, u, 0.0), xp.where(valid, v, 0.0)
    x, y = (u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy
    angles = intrinsics.model.tilt(intrinsics.separate)
    if angles is not None:
        x, y, front = remove_tilt(x, y, angles)
        valid = valid & front
    x, y, solved = invert(intrinsics.model, x, y, intrinsics.coefficients)
    return x, y, valid & solved


def chart_to_pixel(intrinsics: Intrinsics, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Pixels of ideal points in the model's chart, each (...), and validity."""
    xp, model = namespace(x), intrinsics.model
    valid = _trusted(intrinsics, x, y)
    x, y = model.distort(xp.where(valid, x, 0.0), xp.where(valid, y, 0.0), intrinsics.separate)
    angles = model.tilt(intrinsics.separate)
    if angles is not None:
        x, y, front = apply_tilt(x, y, angles)
        valid = valid & front
    return x * intrinsics.fx + intrinsics.cx, y * intrinsics.fy + intrinsics.cy, valid


def _trusted(intrinsics: Intrinsics, x: Array, y: Array) -> Array:
    model, c = intrinsics.model, intrinsics.coefficients
    if not isinstance(x, torch.Tensor):
        with np.errstate(all="ignore"):
            return lens_of(model, c).contains(np, x, y)
    x, y, c = x.detach(), y.detach(), torch.as_tensor(c, dtype=x.dtype)
    shape = torch.broadcast_shapes(x.shape, c.shape[:-1])
    x, y, valid = x.expand(shape), y.expand(shape), torch.zeros(shape, dtype=torch.bool, device=x.device)
    for where, lens in each_lens(model, c, shape):
        valid[where] = lens.contains(torch, x[where], y[where])
    return valid


def pixel_to_ray(intrinsics: Intrinsics, pixels: Array) -> tuple[Array, Array]:
    """Unit rays (..., 3) of pixels (..., 2), and validity; the axis where not valid."""
    xp = namespace(pixels)
    x, y, valid = pixel_to_chart(intrinsics, pixels[..., 0], pixels[..., 1])
    return xp.stack(intrinsics.model.chart.to_ray(xp, x, y), -1), valid


def pixel_to_normalized(intrinsics: Intrinsics, pixels: Array) -> tuple[Array, Array]:
    """Ideal (X/Z, Y/Z), (..., 2), of pixels (..., 2), and validity."""
    xp = namespace(pixels)
    x, y, valid = pixel_to_chart(intrinsics, pixels[..., 0], pixels[..., 1])
    X, Y, _, ahead = intrinsics.model.chart.normalized(xp, x, y)
    return xp.stack([X, Y], -1), valid & ahead


def point_to_pixel(intrinsics: Intrinsics, points: Array) -> tuple[Array, Array]:
    """Pixels (..., 2) of points or directions (..., 3) in the camera frame, and validity."""
    xp = namespace(points)
    finite = xp.isfinite(points).all(-1)
    X, Y, Z = (xp.where(finite, points[..., i], 0.0) for i in range(3))
    x, y, seen = intrinsics.model.chart.to_plane(xp, X, Y, Z)
    u, v, valid = chart_to_pixel(intrinsics, x, y)
    return xp.stack([u, v], -1), valid & seen
