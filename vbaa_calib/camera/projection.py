"""Between pixels, a model's chart and rays: the same formulas for NumPy and torch, differentiable in torch.

Nothing is checked here and nothing is NaN: points that are not valid are harmless finite numbers beside a False.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np
import torch

from ..arrays import Array, matrix, namespace
from .implicit import invert
from .lens import each_lens, lens_of
from .models import LensModel
from .models.model import Coefficients
from .tilt import apply_tilt, remove_tilt, remove_tilt_jacobians


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
    if intrinsics.model.chart.is_normalized:
        return xp.stack([x, y], -1), valid
    X, Y, Z = intrinsics.model.chart.to_ray(xp, x, y)
    valid = valid & (Z > 1e-12)
    depth = xp.where(valid, Z, 1.0)
    return xp.stack([X / depth, Y / depth], -1), valid


def point_to_pixel(intrinsics: Intrinsics, points: Array) -> tuple[Array, Array]:
    """Pixels (..., 2) of points or directions (..., 3) in the camera frame, and validity."""
    xp = namespace(points)
    finite = xp.isfinite(points).all(-1)
    X, Y, Z = (xp.where(finite, points[..., i], 0.0) for i in range(3))
    x, y, seen = intrinsics.model.chart.to_plane(xp, X, Y, Z)
    u, v, valid = chart_to_pixel(intrinsics, x, y)
    return xp.stack([u, v], -1), valid & seen


@dataclass(frozen=True, eq=False)
class RayDerivatives:
    """Unit rays and how they move.

    Attributes
    ----------
    rays : (..., 3), the axis where not valid.
    by_pixel : (..., 3, 2) d(ray)/d(u, v).
    by_parameter : (..., 3, 4 + k) d(ray)/d(fx, fy, cx, cy, *distortion) for a fixed pixel.
    valid : (...)
    """

    rays: Array
    by_pixel: Array
    by_parameter: Array
    valid: Array


def ray_derivatives(intrinsics: Intrinsics, pixels: Array) -> RayDerivatives:
    """Rays of pixels (..., 2) with their derivatives in closed form. The intrinsics must be floats."""
    xp, model, c = namespace(pixels), intrinsics.model, intrinsics.separate
    chart_by_sensor, chart_by_coefficient, x, y, valid, sensor = _chart_derivatives(xp, intrinsics, pixels)
    chart_by_pixel = chart_by_sensor / xp.stack([0.0 * x + intrinsics.fx, 0.0 * x + intrinsics.fy], -1)[..., None, :]
    by_matrix = xp.concatenate([-chart_by_pixel * sensor[..., None, :], -chart_by_pixel], -1)
    by_chart = model.chart.ray_jacobian(xp, x, y)
    chart_by_parameter = xp.concatenate([by_matrix, chart_by_coefficient], -1) if len(c) else by_matrix
    rays = xp.stack(model.chart.to_ray(xp, x, y), -1)
    return RayDerivatives(rays, by_chart @ chart_by_pixel, by_chart @ chart_by_parameter, valid)


def _chart_derivatives(
    xp: ModuleType, intrinsics: Intrinsics, pixels: Array
) -> tuple[Array, Array | None, Array, Array, Array, Array]:
    model, c = intrinsics.model, intrinsics.separate
    sensor_x = (pixels[..., 0] - intrinsics.cx) / intrinsics.fx
    sensor_y = (pixels[..., 1] - intrinsics.cy) / intrinsics.fy
    angles = model.tilt(c)
    x, y = sensor_x, sensor_y
    if angles is not None:
        x, y, front = remove_tilt(x, y, angles)
    x, y, valid = invert(model, x, y, intrinsics.coefficients)
    _, _, xx, xy, yx, yy = (entry + 0.0 * x for entry in model.linearize(x, y, c))
    determinant = xx * yy - xy * yx
    inverse = matrix(xp, [[yy, -xy], [-yx, xx]]) / determinant[..., None, None]
    columns = model.by_coefficient(x, y, c)
    by_coefficient = -inverse @ matrix(xp, [[d[k] for d in columns] for k in range(2)]) if columns else None
    if angles is not None:
        by_sensor, by_angles = remove_tilt_jacobians(xp, sensor_x, sensor_y, angles)
        by_coefficient = xp.concatenate([by_coefficient, inverse @ by_angles], -1)
        inverse, valid = inverse @ by_sensor, valid & front
    return inverse, by_coefficient, x, y, valid, xp.stack([sensor_x, sensor_y], -1)
