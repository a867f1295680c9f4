"""Between pixels, a model's chart and rays, and how they move with pixel and lens: the same for NumPy and torch.

Nothing is checked here and nothing is NaN where it is not said: points that are not valid are harmless finite numbers
beside a False. The ways there and back are differentiable in torch; the slopes are in closed form, without gradients,
and their intrinsics must be floats.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from vbaa_calib.core.arrays import Array, detached, empty, is_tensor, like, matrix, namespace

from .inverse import in_pieces, invert_distortion, solve
from .lens import Lens, each_lens, lens_of
from .models import Coefficients, LensModel, Matrix

if TYPE_CHECKING:
    import torch

_Angles = tuple[Array, Array]


def _sin_cos(angle: Array) -> tuple[Array, Array]:
    if is_tensor(angle):
        return angle.sin(), angle.cos()
    return math.sin(angle), math.cos(angle)


def _apply_tilt(x: Array, y: Array, angles: _Angles) -> tuple[Array, Array, Array]:
    """Onto the tilted sensor: (x, y) → (x, y, whether the point is in front of it)."""
    (sx, cx), (sy, cy) = map(_sin_cos, angles)
    a, b, w = cy * x + sy * sx * y - sy * cx, cx * y + sx, sy * x - cy * sx * y + cy * cx
    front = w > 0
    w = namespace(w).where(front, w, 1.0)
    return cy * cx * (a / w) + sy * cx, cy * cx * (b / w) - sx, front


def _remove_tilt(x: Array, y: Array, angles: _Angles) -> tuple[Array, Array, Array]:
    """From the tilted sensor back: the inverse of _apply_tilt."""
    (sx, cx), (sy, cy) = map(_sin_cos, angles)
    a, b = (x - sy * cx) / (cy * cx), (y + sx) / (cy * cx)
    m0, m1, m2 = cy * a + sy, sy * sx * a + cx * b - cy * sx, -sy * cx * a + sx * b + cy * cx
    front = m2 > 0
    m2 = namespace(m2).where(front, m2, 1.0)
    return m0 / m2, m1 / m2, front


def _remove_tilt_slopes(x: Array, y: Array, angles: tuple[float, float]) -> tuple[Matrix, Matrix]:
    """d(remove_tilt)/d(x, y) and d(remove_tilt)/d(τ_x, τ_y) at tilted points (x, y)."""
    (sx, cx), (sy, cy) = map(_sin_cos, angles)
    R = [[cy, sy * sx, -sy * cx], [0.0, cx, sx], [sy, -cy * sx, cy * cx]]
    by_x = [[0.0, sy * cx, sy * sx], [0.0, -sx, cx], [0.0, -cy * cx, -cy * sx]]
    by_y = [[-sy, cy * sx, -cy * cx], [0.0, 0.0, 0.0], [cy, sy * sx, -sy * cx]]
    a, b = (x + R[0][2]) / R[2][2], (y + R[1][2]) / R[2][2]
    m = [R[0][i] * a + R[1][i] * b + R[2][i] for i in range(3)]
    ideal = m[0] / m[2], m[1] / m[2]

    def slopes(*moved: list[Array]) -> Matrix:
        """Of the ideal point, by those of m."""
        xx, xy = ((dm[0] - ideal[0] * dm[2]) / m[2] for dm in moved)
        yx, yy = ((dm[1] - ideal[1] * dm[2]) / m[2] for dm in moved)
        return xx, xy, yx, yy

    def by_angle(D: list[list[float]]) -> list[Array]:
        da, db = (D[0][2] - a * D[2][2]) / R[2][2], (D[1][2] - b * D[2][2]) / R[2][2]
        return [R[0][i] * da + R[1][i] * db + D[0][i] * a + D[1][i] * b + D[2][i] for i in range(3)]

    by_point = ([R[row][i] / R[2][2] for i in range(3)] for row in range(2))
    return slopes(*by_point), slopes(by_angle(by_x), by_angle(by_y))


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
        return tuple(c.unbind(-1)) if is_tensor(c) else c


def pixel_to_chart(intrinsics: Intrinsics, u: Array, v: Array) -> tuple[Array, Array, Array]:
    """Ideal point in the model's chart of pixels, each (...), and validity."""
    xp = namespace(u)
    valid = xp.isfinite(u) & xp.isfinite(v)
    u, v = xp.where(valid, u, 0.0), xp.where(valid, v, 0.0)
    x, y = (u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy
    angles = intrinsics.model.tilt(intrinsics.separate)
    if angles is not None:
        x, y, front = _remove_tilt(x, y, angles)
        valid = valid & front
    x, y, solved = _invert(intrinsics, x, y)
    return x, y, valid & solved


def _invert(intrinsics: Intrinsics, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Ideal points (...) of distorted ones (...) before the sensor's tilt, and their validity; (0, 0) where not."""
    if not is_tensor(x):
        return solve(lens_of(intrinsics.model, intrinsics.coefficients), x, y)
    from .tensors import invert  # loads torch

    return invert(intrinsics.model, x, y, intrinsics.coefficients)


def chart_to_pixel(intrinsics: Intrinsics, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Pixels of ideal points in the model's chart, each (...), and validity."""
    xp, model = namespace(x), intrinsics.model
    valid = _trusted(intrinsics, x, y)
    x, y = model.distort(xp.where(valid, x, 0.0), xp.where(valid, y, 0.0), intrinsics.separate)
    angles = model.tilt(intrinsics.separate)
    if angles is not None:
        x, y, front = _apply_tilt(x, y, angles)
        valid = valid & front
    return x * intrinsics.fx + intrinsics.cx, y * intrinsics.fy + intrinsics.cy, valid


def _trusted(intrinsics: Intrinsics, x: Array, y: Array) -> Array:
    model, c = intrinsics.model, intrinsics.coefficients
    if not is_tensor(x):
        with np.errstate(all="ignore"):
            return lens_of(model, c).contains(np, x, y)
    xp, x, y, c = namespace(x), x.detach(), y.detach(), like(x, c)
    shape = np.broadcast_shapes(tuple(x.shape), tuple(c.shape[:-1]))
    x, y, valid = x.expand(shape), y.expand(shape), empty(x, shape, boolean=True)
    for where, lens in each_lens(model, c, shape):
        valid[where] = lens.contains(xp, x[where], y[where])
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


_OfPoints = Callable[[ModuleType, Intrinsics, Lens, Array, Array, bool], tuple[Array, ...]]


def pixel_to_normalized_with_slopes(intrinsics: Intrinsics, pixels: Array) -> tuple[Array, Array, Array]:
    """Ideal points (..., 2) of pixels (..., 2), d(X/Z, Y/Z)/d(u, v) (..., 2, 2), and validity (...); NaN where not
    valid."""
    points, valid = _worked(by_pixel_of_points, intrinsics, pixels, 6)
    return points[..., :2], points[..., 2:].reshape(*pixels.shape, 2), valid


def normalized_by_lens(intrinsics: Intrinsics, points: Array) -> Array:
    """d(X/Z, Y/Z)/d(fx, fy, cx, cy, *distortion) of the fixed pixels of ideal points (..., 2): (..., 2, 4 + k); NaN
    where the lens does not see the point one to one."""
    parameters = 4 + len(intrinsics.coefficients)
    slopes, _ = _worked(by_lens_of_points, intrinsics, points, 2 * parameters)
    return slopes.reshape(*points.shape, parameters)


def _worked(function: _OfPoints, intrinsics: Intrinsics, given: Array, count: int) -> tuple[Array, Array]:
    """(..., count) numbers of points (..., 2), NaN where not valid, and validity (...)."""
    if is_tensor(given) and given.device.type == "cpu":
        # NumPy needs a fraction of the time per call, and its pieces stay in the cache; the memory is shared
        values, valid = map(namespace(given).from_numpy, _worked(function, intrinsics, detached(given).numpy(), count))
        return values, valid
    shape, flat = tuple(given.shape[:-1]), detached(given).reshape(-1, 2)
    values, valid = empty(given, (len(flat), count)), empty(given, (len(flat),), boolean=True)
    lens = lens_of(intrinsics.model, intrinsics.coefficients)
    work = partial(function, namespace(given), intrinsics, lens)
    with np.errstate(all="ignore"):
        in_pieces(work, flat[:, 0], flat[:, 1], [*(values[:, i] for i in range(count)), valid])
    values[~valid] = np.nan
    return values.reshape(*shape, count), valid.reshape(shape)


def by_pixel_of_points(
    xp: ModuleType, intrinsics: Intrinsics, lens: Lens, u: Array, v: Array, thorough: bool
) -> tuple[Array, ...]:
    """X/Z, Y/Z, the four slopes row by row, validity and which are put off, each (...), of pixels (u, v)."""
    sensor_x, sensor_y = (u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy
    angles = lens.model.tilt(lens.coefficients)
    x, y = sensor_x, sensor_y
    if angles is not None:
        x, y, front = _remove_tilt(x, y, angles)
    x, y, valid, jacobian, put_off = invert_distortion(xp, lens, x, y, thorough)
    by_sensor = _inverse(jacobian)
    if angles is not None:
        by_sensor = _product(by_sensor, _remove_tilt_slopes(sensor_x, sensor_y, angles)[0])
        valid, put_off = valid & front, put_off & front
    if not lens.model.chart.is_normalized:
        x, y, by_chart, ahead = lens.model.chart.normalized(xp, x, y)
        by_sensor, valid = _product(by_chart, by_sensor), valid & ahead
    xx, xy, yx, yy = by_sensor
    fx, fy = intrinsics.fx, intrinsics.fy
    return x, y, xx / fx, xy / fy, yx / fx, yy / fy, valid, put_off


def by_lens_of_points(
    xp: ModuleType, intrinsics: Intrinsics, lens: Lens, X: Array, Y: Array, _: bool
) -> tuple[Array, ...]:
    """The slopes row by row, validity, and that nothing is put off, each (...), of ideal points (X, Y)."""
    chart = lens.model.chart
    x, y = (X, Y) if chart.is_normalized else chart.to_plane(xp, X, Y, xp.ones_like(X))[:2]
    by_chart = None if chart.is_normalized else chart.normalized(xp, x, y)[2]
    columns, front = _by_sensor_and_lens(xp, intrinsics, lens, (x, y), by_chart)[1:]
    return *(column[row] for row in range(2) for column in columns), lens.contains(xp, x, y) & front, False


def ray_derivatives(intrinsics: Intrinsics, pixels: Array) -> tuple[Array, Array, Array, Array]:
    """Rays of pixels (..., 3), unit, the axis where not valid; d(ray)/d(u, v) (..., 3, 2); d(ray)/d(fx, fy, cx, cy,
    *distortion) for a fixed pixel (..., 3, 4 + k); validity (...)."""
    xp, chart = namespace(pixels), intrinsics.model.chart
    x, y, valid = pixel_to_chart(intrinsics, pixels[..., 0], pixels[..., 1])
    lens = lens_of(intrinsics.model, intrinsics.coefficients)
    (xx, xy, yx, yy), columns, _ = _by_sensor_and_lens(xp, intrinsics, lens, (x, y))
    by_pixel = matrix(xp, [[xx / intrinsics.fx, xy / intrinsics.fy], [yx / intrinsics.fx, yy / intrinsics.fy]])
    by_parameter = matrix(xp, [[column[row] for column in columns] for row in range(2)])
    by_chart, rays = chart.ray_jacobian(xp, x, y), xp.stack(chart.to_ray(xp, x, y), -1)
    return rays, by_chart @ by_pixel, by_chart @ by_parameter, valid


def _by_sensor_and_lens(
    xp: ModuleType, intrinsics: Intrinsics, lens: Lens, at: tuple[Array, Array], by_chart: Matrix | None = None
) -> tuple[Matrix, list[tuple[Array, Array]], Array]:
    """How a chart point with a fixed pixel moves with its place on the sensor's plane and with each parameter,
    −(∂pixel/∂ideal)⁻¹ ∂pixel/∂parameter, by_chart (2, 2) from the left; and whether it is in front of the sensor."""
    (x, y), model, c = at, lens.model, lens.coefficients
    sensor_x, sensor_y, *jacobian = model.linearize(x, y, c)
    by_distorted, front, by_tilt = _inverse(tuple(jacobian)), xp.isfinite(x), []
    if by_chart is not None:
        by_distorted = _product(by_chart, by_distorted)
    by_sensor, angles = by_distorted, model.tilt(c)
    if angles is not None:
        sensor_x, sensor_y, front = _apply_tilt(sensor_x, sensor_y, angles)
        untilted, turned = _remove_tilt_slopes(sensor_x, sensor_y, angles)
        by_sensor, (xx, xy, yx, yy) = _product(by_distorted, untilted), _product(by_distorted, turned)
        by_tilt = [(xx, yx), (xy, yy)]
    xx, xy, yx, yy = by_sensor
    by_u, by_v = (xx / -intrinsics.fx, yx / -intrinsics.fx), (xy / -intrinsics.fy, yy / -intrinsics.fy)
    by_focal = [(by_u[0] * sensor_x, by_u[1] * sensor_x), (by_v[0] * sensor_y, by_v[1] * sensor_y)]
    xx, xy, yx, yy = (-entry for entry in by_distorted)
    by_coefficient = [(xx * dx + xy * dy, yx * dx + yy * dy) for dx, dy in model.by_coefficient(x, y, c)]
    return by_sensor, [*by_focal, by_u, by_v, *by_coefficient, *by_tilt], front


def _inverse(of: Matrix) -> Matrix:
    xx, xy, yx, yy = of
    scale = 1.0 / (xx * yy - xy * yx)
    return yy * scale, -xy * scale, -yx * scale, xx * scale


def _product(left: Matrix, right: Matrix) -> Matrix:
    (a, b, c, d), (e, f, g, h) = left, right
    return a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h
