"""How ideal points and rays move with the pixel and with the lens: closed-form derivatives, without gradients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType

import numpy as np
import torch

from vbaa_calib.core.arrays import Array, detached, empty, matrix, namespace

from .inverse import in_pieces, invert_distortion
from .lens import Lens, lens_of
from .projection import Intrinsics, apply_tilt, pixel_to_chart, remove_tilt, remove_tilt_jacobians

_Matrix = tuple[Array, Array, Array, Array]
"""(xx, xy, yx, yy), each (...) or a number."""
_OfPoints = Callable[[ModuleType, Intrinsics, Lens, Array, Array, bool], tuple[Array, ...]]


def pixel_to_normalized_with_slopes(intrinsics: Intrinsics, pixels: Array) -> tuple[Array, Array, Array]:
    """Ideal points (..., 2) of pixels (..., 2), d(X/Z, Y/Z)/d(u, v) (..., 2, 2), and validity (...).

    NaN where not valid. The intrinsics must be floats.
    """
    points, valid = _worked(by_pixel_of_points, intrinsics, pixels, 6)
    return points[..., :2], points[..., 2:].reshape(*pixels.shape, 2), valid


def normalized_by_lens(intrinsics: Intrinsics, points: Array) -> Array:
    """d(X/Z, Y/Z)/d(fx, fy, cx, cy, *distortion) of the fixed pixels of ideal points (..., 2): (..., 2, 4 + k).

    NaN where the lens does not see the point one to one. The intrinsics must be floats.
    """
    parameters = 4 + len(intrinsics.coefficients)
    slopes, _ = _worked(by_lens_of_points, intrinsics, points, 2 * parameters)
    return slopes.reshape(*points.shape, parameters)


def _worked(function: _OfPoints, intrinsics: Intrinsics, given: Array, count: int) -> tuple[Array, Array]:
    """(..., count) numbers of points (..., 2), NaN where not valid, and validity (...)."""
    if isinstance(given, torch.Tensor) and given.device.type == "cpu":
        # NumPy needs a fraction of the time per call, and its pieces stay in the cache; the memory is shared
        values, valid = map(torch.from_numpy, _worked(function, intrinsics, detached(given).numpy(), count))
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
        x, y, front = remove_tilt(x, y, angles)
    x, y, valid, jacobian, put_off = invert_distortion(xp, lens, x, y, thorough)
    by_sensor = _inverse(jacobian)
    if angles is not None:
        by_sensor = _product(by_sensor, _entries(remove_tilt_jacobians(xp, sensor_x, sensor_y, angles)[0]))
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


@dataclass(frozen=True, eq=False)
class _RayDerivatives:
    """Unit rays (..., 3), the axis where not valid (...), and how they move.

    by_pixel : (..., 3, 2) d(ray)/d(u, v).
    by_parameter : (..., 3, 4 + k) d(ray)/d(fx, fy, cx, cy, *distortion) for a fixed pixel.
    """

    rays: Array
    by_pixel: Array
    by_parameter: Array
    valid: Array


def ray_derivatives(intrinsics: Intrinsics, pixels: Array) -> _RayDerivatives:
    """Rays of pixels (..., 2) with their derivatives. The intrinsics must be floats."""
    xp, chart = namespace(pixels), intrinsics.model.chart
    x, y, valid = pixel_to_chart(intrinsics, pixels[..., 0], pixels[..., 1])
    lens = lens_of(intrinsics.model, intrinsics.coefficients)
    (xx, xy, yx, yy), columns, _ = _by_sensor_and_lens(xp, intrinsics, lens, (x, y))
    by_pixel = matrix(xp, [[xx / intrinsics.fx, xy / intrinsics.fy], [yx / intrinsics.fx, yy / intrinsics.fy]])
    by_parameter = matrix(xp, [[column[row] for column in columns] for row in range(2)])
    by_chart, rays = chart.ray_jacobian(xp, x, y), xp.stack(chart.to_ray(xp, x, y), -1)
    return _RayDerivatives(rays, by_chart @ by_pixel, by_chart @ by_parameter, valid)


def _by_sensor_and_lens(
    xp: ModuleType, intrinsics: Intrinsics, lens: Lens, at: tuple[Array, Array], by_chart: _Matrix | None = None
) -> tuple[_Matrix, list[tuple[Array, Array]], Array]:
    """How a chart point with a fixed pixel moves with its place on the sensor's plane, and with each parameter.

    By the implicit function theorem −(∂pixel/∂ideal)⁻¹ ∂pixel/∂parameter, by_chart (2, 2) from the left. Returns also
    whether the point is in front of the sensor.
    """
    (x, y), model, c = at, lens.model, lens.coefficients
    sensor_x, sensor_y, *jacobian = model.linearize(x, y, c)
    by_distorted, front, by_tilt = _inverse(tuple(jacobian)), xp.isfinite(x), []
    if by_chart is not None:
        by_distorted = _product(by_chart, by_distorted)
    by_sensor, angles = by_distorted, model.tilt(c)
    if angles is not None:
        sensor_x, sensor_y, front = apply_tilt(sensor_x, sensor_y, angles)
        untilted, turned = map(_entries, remove_tilt_jacobians(xp, sensor_x, sensor_y, angles))
        by_sensor, (xx, xy, yx, yy) = _product(by_distorted, untilted), _product(by_distorted, turned)
        by_tilt = [(xx, yx), (xy, yy)]
    xx, xy, yx, yy = by_sensor
    by_u, by_v = (xx / -intrinsics.fx, yx / -intrinsics.fx), (xy / -intrinsics.fy, yy / -intrinsics.fy)
    by_focal = [(by_u[0] * sensor_x, by_u[1] * sensor_x), (by_v[0] * sensor_y, by_v[1] * sensor_y)]
    xx, xy, yx, yy = (-entry for entry in by_distorted)
    by_coefficient = [(xx * dx + xy * dy, yx * dx + yy * dy) for dx, dy in model.by_coefficient(x, y, c)]
    return by_sensor, [*by_focal, by_u, by_v, *by_coefficient, *by_tilt], front


def _inverse(of: _Matrix) -> _Matrix:
    xx, xy, yx, yy = of
    scale = 1.0 / (xx * yy - xy * yx)
    return yy * scale, -xy * scale, -yx * scale, xx * scale


def _product(left: _Matrix, right: _Matrix) -> _Matrix:
    (a, b, c, d), (e, f, g, h) = left, right
    return a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h


def _entries(of: Array) -> _Matrix:
    return of[..., 0, 0], of[..., 0, 1], of[..., 1, 0], of[..., 1, 1]
