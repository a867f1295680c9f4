"""How ideal normalized points X/Z, Y/Z move with the pixel and with the lens, as plain numbers without gradients.

Nothing here is differentiable and nothing needs to be: these are the derivatives, in closed form.
"""

from __future__ import annotations

import math
from functools import partial
from types import ModuleType

import numpy as np
import torch

from vbaa_calib.core.arrays import Array, detached, empty, namespace

from .inverse import in_pieces, invert_distortion
from .lens import Lens, lens_of
from .projection import Intrinsics, apply_tilt, remove_tilt, remove_tilt_jacobians

Matrix = tuple[Array, Array, Array, Array]
"""(xx, xy, yx, yy), each (...) or a number."""


def pixel_to_normalized_with_slopes(intrinsics: Intrinsics, pixels: Array) -> tuple[Array, Array, Array]:
    """Ideal points (..., 2) of pixels (..., 2), d(X/Z, Y/Z)/d(u, v) (..., 2, 2), and validity (...).

    NaN where not valid. The intrinsics must be floats.
    """
    if isinstance(pixels, torch.Tensor) and pixels.device.type == "cpu":
        # NumPy needs a fraction of the time per call, and its pieces stay in the cache; the memory is shared
        on_processor = pixel_to_normalized_with_slopes(intrinsics, detached(pixels).numpy())
        points, slopes, valid = map(torch.from_numpy, on_processor)
        return points, slopes, valid
    shape = tuple(pixels.shape[:-1])
    count = math.prod(shape)
    points, slopes = empty(pixels, (count, 2)), empty(pixels, (count, 2, 2))
    valid = empty(pixels, (count,), boolean=True)
    results = [points[:, i] for i in range(2)] + [slopes[:, i, j] for i in range(2) for j in range(2)] + [valid]
    lens = lens_of(intrinsics.model, intrinsics.coefficients)
    flat = detached(pixels).reshape(count, 2)
    with np.errstate(all="ignore"):
        in_pieces(partial(by_pixel_of_points, namespace(pixels), intrinsics, lens), flat[:, 0], flat[:, 1], results)
    invalid = ~valid
    points[invalid], slopes[invalid] = np.nan, np.nan
    return points.reshape(*shape, 2), slopes.reshape(*shape, 2, 2), valid.reshape(shape)


def normalized_by_lens(intrinsics: Intrinsics, points: Array) -> Array:
    """d(X/Z, Y/Z)/d(fx, fy, cx, cy, *distortion) of the fixed pixels of ideal points (..., 2): (..., 2, 4 + k).

    NaN where the lens does not see the point one to one. The intrinsics must be floats.
    """
    if isinstance(points, torch.Tensor) and points.device.type == "cpu":
        return torch.from_numpy(normalized_by_lens(intrinsics, detached(points).numpy()))
    shape, parameters = tuple(points.shape[:-1]), 4 + len(intrinsics.coefficients)
    count = math.prod(shape)
    slopes = empty(points, (count, 2, parameters))
    valid = empty(points, (count,), boolean=True)
    results = [slopes[:, i, j] for j in range(parameters) for i in range(2)] + [valid]
    lens = lens_of(intrinsics.model, intrinsics.coefficients)
    flat = detached(points).reshape(count, 2)
    with np.errstate(all="ignore"):
        in_pieces(partial(by_lens_of_points, namespace(points), intrinsics, lens), flat[:, 0], flat[:, 1], results)
    slopes[~valid] = np.nan
    return slopes.reshape(*shape, 2, parameters)


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
    """The slopes column by column, validity, and that nothing is put off, each (...), of ideal points (X, Y).

    By the implicit function theorem −(∂pixel/∂ideal)⁻¹ ∂pixel/∂parameters.
    """
    model, c, chart = lens.model, lens.coefficients, lens.model.chart
    x, y = (X, Y) if chart.is_normalized else chart.to_plane(xp, X, Y, xp.ones_like(X))[:2]
    valid = lens.contains(xp, x, y)
    sensor_x, sensor_y, *jacobian = model.linearize(x, y, c)
    by_distorted = _inverse(tuple(jacobian))
    if not chart.is_normalized:
        by_distorted = _product(chart.normalized(xp, x, y)[2], by_distorted)
    by_sensor, by_tilt = by_distorted, []
    angles = model.tilt(c)
    if angles is not None:
        sensor_x, sensor_y, front = apply_tilt(sensor_x, sensor_y, angles)
        untilted, turned = map(_entries, remove_tilt_jacobians(xp, sensor_x, sensor_y, angles))
        by_sensor, (xx, xy, yx, yy) = _product(by_distorted, untilted), _product(by_distorted, turned)
        by_tilt, valid = [xx, yx, xy, yy], valid & front
    by_u_x, by_v_x, by_u_y, by_v_y = by_sensor
    by_u_x, by_u_y = by_u_x / -intrinsics.fx, by_u_y / -intrinsics.fx
    by_v_x, by_v_y = by_v_x / -intrinsics.fy, by_v_y / -intrinsics.fy
    by_matrix = [by_u_x * sensor_x, by_u_y * sensor_x, by_v_x * sensor_y, by_v_y * sensor_y]
    by_matrix += [by_u_x, by_u_y, by_v_x, by_v_y]
    xx, xy, yx, yy = (-entry for entry in by_distorted)
    by_coefficient = [
        entry for dx, dy in model.by_coefficient(x, y, c) for entry in (xx * dx + xy * dy, yx * dx + yy * dy)
    ]
    return *by_matrix, *by_coefficient, *by_tilt, valid, False


def _inverse(of: Matrix) -> Matrix:
    xx, xy, yx, yy = of
    scale = 1.0 / (xx * yy - xy * yx)
    return yy * scale, -xy * scale, -yx * scale, xx * scale


def _product(left: Matrix, right: Matrix) -> Matrix:
    (a, b, c, d), (e, f, g, h) = left, right
    return a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h


def _entries(of: Array) -> Matrix:
    return of[..., 0, 0], of[..., 0, 1], of[..., 1, 0], of[..., 1, 1]
