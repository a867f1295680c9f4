"""The lens for torch tensors, differentiable in both directions, on any device. Loads torch.

The forward map is kornia's where kornia has it; the inverse is solved without gradients (by the core on the processor)
and differentiated by the implicit function theorem. Points that are not valid are harmless finite numbers marked False
until `masked`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
import torch
from torch import Tensor

from vbaa_calib.core.arrays import Array, like

from .lens import Intrinsics, prepared
from .models import LensModel

_SMALL_ANGLE_SQUARED = 1e-6
_BEFORE_TILT = 12  # coefficients

_Matrix = tuple[Array, Array, Array, Array]  # (xx, xy, yx, yy), each (...)
_Solution = tuple[Tensor, Tensor, Tensor]


def pixel_to_ray(intrinsics: Intrinsics, pixels: Tensor) -> tuple[Tensor, Tensor]:
    """Unit rays (..., 3) of pixels (..., 2), and validity; the optical axis where not valid."""
    x, y, valid = _pixel_to_chart(intrinsics, pixels[..., 0], pixels[..., 1])
    return torch.stack(_to_ray(intrinsics.model, x, y), -1), valid


def pixel_to_normalized(intrinsics: Intrinsics, pixels: Tensor) -> tuple[Tensor, Tensor]:
    """Ideal (X/Z, Y/Z), (..., 2), of pixels (..., 2), and validity."""
    x, y, valid = _pixel_to_chart(intrinsics, pixels[..., 0], pixels[..., 1])
    if intrinsics.model.is_fisheye:
        x, y, z = _to_ray(intrinsics.model, x, y)
        # a unit vector's Z from which on X/Z counts as a number
        ahead = z > 1e-12
        z, valid = torch.where(ahead, z, 1.0), valid & ahead
        x, y = x / z, y / z
    return torch.stack([x, y], -1), valid


def point_to_pixel(intrinsics: Intrinsics, points: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels (..., 2) of points or directions (..., 3) in the camera frame, and validity."""
    finite = torch.isfinite(points).all(-1)
    x, y, seen = _to_chart(intrinsics.model, *torch.where(finite[..., None], points, 0.0).unbind(-1))
    u, v, valid = _chart_to_pixel(intrinsics, x, y)
    return torch.stack([u, v], -1), valid & seen


def _pixel_to_chart(intrinsics: Intrinsics, u: Tensor, v: Tensor) -> _Solution:
    """Ideal point in the model's chart of pixels, each (...), and validity."""
    valid = torch.isfinite(u) & torch.isfinite(v)
    u, v = torch.where(valid, u, 0.0), torch.where(valid, v, 0.0)
    x, y = (u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy
    c = like(u, intrinsics.coefficients)
    if c.shape[-1] > _BEFORE_TILT:
        x, y, front = _remove_tilt(x, y, c)
        valid = valid & front
    x, y, solved = _Invert.apply(x, y, c, intrinsics.model)
    return x, y, valid & solved


def _chart_to_pixel(intrinsics: Intrinsics, x: Tensor, y: Tensor) -> _Solution:
    """Pixels of ideal points in the model's chart, each (...), and validity."""
    model, c = intrinsics.model, like(x, intrinsics.coefficients)
    valid = _trusted(model, c, x, y)
    x, y = _distort(model, torch.where(valid, x, 0.0), torch.where(valid, y, 0.0), c)
    if c.shape[-1] > _BEFORE_TILT:
        x, y, front = _apply_tilt(x, y, c)
        valid = valid & front
    return x * intrinsics.fx + intrinsics.cx, y * intrinsics.fy + intrinsics.cy, valid


def _to_chart(model: LensModel, X: Tensor, Y: Tensor, Z: Tensor) -> _Solution:
    """x, y in the model's chart of vectors of any length, and whether they are in view; x = y = 0 where not."""
    if not model.is_fisheye:
        seen = Z > 0
        depth = torch.where(seen, Z, 1.0)
        return torch.where(seen, X / depth, 0.0), torch.where(seen, Y / depth, 0.0), seen
    off_axis2 = X * X + Y * Y
    near = (Z > 0) & (off_axis2 < _SMALL_ANGLE_SQUARED * Z * Z)
    seen = near | (off_axis2 > 0)
    # each branch gets arguments at which it and its gradient are finite, also where the other one is taken
    depth = torch.where(near, Z, 1.0)
    tan2 = torch.where(near, off_axis2, 0.0) / (depth * depth)
    off_axis = torch.sqrt(torch.where(seen & ~near, off_axis2, 1.0))
    far_ratio = torch.arctan2(off_axis, Z) / off_axis
    ratio = torch.where(near, (1.0 - tan2 * (1.0 / 3.0 - tan2 / 5.0)) / depth, far_ratio)
    return torch.where(seen, X * ratio, 0.0), torch.where(seen, Y * ratio, 0.0), seen


def _to_ray(model: LensModel, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    square = x * x + y * y
    if not model.is_fisheye:
        z = 1.0 / torch.sqrt(1.0 + square)
        return x * z, y * z, z
    near = square < _SMALL_ANGLE_SQUARED
    angle = torch.sqrt(torch.where(near, 1.0, square))
    ratio = torch.where(near, 1.0 - square / 6.0 * (1.0 - square / 20.0), torch.sin(angle) / angle)
    return x * ratio, y * ratio, torch.where(near, 1.0 - square / 2.0 * (1.0 - square / 12.0), torch.cos(angle))


def _turn(c: Tensor) -> list[list[Array]]:
    """(..., 3, 3) rotation of the tilted sensor, from coefficients (..., 14)."""
    sx, cx, sy, cy = c[..., 12].sin(), c[..., 12].cos(), c[..., 13].sin(), c[..., 13].cos()
    return [[cy, sy * sx, -sy * cx], [0.0, cx, sx], [sy, -cy * sx, cy * cx]]


def _apply_tilt(x: Tensor, y: Tensor, c: Tensor) -> _Solution:
    """Points projected onto the tilted sensor, and whether they are in front of it."""
    r = _turn(c)
    a, b, w = (row[0] * x + row[1] * y + row[2] for row in r)
    front = w > 0
    w = torch.where(front, w, 1.0)
    return r[2][2] * (a / w) - r[0][2], r[2][2] * (b / w) - r[1][2], front


def _remove_tilt(x: Tensor, y: Tensor, c: Tensor) -> _Solution:
    """Points projected back from the tilted sensor: the inverse of `_apply_tilt`."""
    r = _turn(c)
    a, b = (x + r[0][2]) / r[2][2], (y + r[1][2]) / r[2][2]
    m0, m1, m2 = (r[0][i] * a + r[1][i] * b + r[2][i] for i in range(3))
    front = m2 > 0
    m2 = torch.where(front, m2, 1.0)
    return m0 / m2, m1 / m2, front


def _radial(model: LensModel, s: Tensor, c: Sequence[Array]) -> tuple[Tensor, Tensor, Array]:
    """Radial gain, its slope by s = x² + y², and one over its denominator."""
    if model.is_fisheye:
        k1, k2, k3, k4 = c
        slope = k1 + s * (2.0 * k2 + s * (3.0 * k3 + s * (4.0 * k4)))
        return 1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))), slope, 1.0
    k1, k2, _, _, k3, k4, k5, k6, *_ = _padded(c)
    inverse = 1.0 / (1.0 + s * (k4 + s * (k5 + s * k6)))
    gain = (1.0 + s * (k1 + s * (k2 + s * k3))) * inverse
    top, bottom = k1 + s * (2.0 * k2 + s * (3.0 * k3)), k4 + s * (2.0 * k5 + s * (3.0 * k6))
    return gain, (top - gain * bottom) * inverse, inverse


def _padded(c: Sequence[Array]) -> tuple[Array, ...]:
    return (*c, *(0.0,) * (14 - len(c)))


def _distort(model: LensModel, x: Tensor, y: Tensor, c: Tensor) -> tuple[Tensor, Tensor]:
    """The distorted point before the sensor's tilt, by kornia, for its tested gradients; each point is a batch of
    its own, so that coefficients may broadcast against points."""
    if model.is_fisheye:
        gain, _, _ = _radial(model, x * x + y * y, c.unbind(-1))
        return x * gain, y * gain
    if c.shape[-1] == 0:
        return x, y
    # importing kornia costs a second, and only those who work with tensors need it
    from kornia.geometry.calibration import distort_points

    terms, eye = c[..., :_BEFORE_TILT], torch.eye(3, dtype=x.dtype, device=x.device)
    points = torch.stack(torch.broadcast_tensors(x, y), -1)[..., None, :]
    distorted = distort_points(points, eye, terms.expand(*points.shape[:-2], -1), eye)[..., 0, :]
    return distorted[..., 0], distorted[..., 1]


def _linearize(model: LensModel, x: Tensor, y: Tensor, c: Sequence[Array]) -> tuple[Tensor, ...]:
    """The distorted point before the tilt and its derivatives: xd, yd, dxd/dx, dxd/dy, dyd/dx, dyd/dy."""
    s = x * x + y * y
    gain, slope, _ = _radial(model, s, c)
    p1, p2, s1, s2, s3, s4 = (0.0,) * 6 if model.is_fisheye else (*_padded(c)[2:4], *_padded(c)[8:12])
    along_x, along_y, gain = 2.0 * slope * x, 2.0 * slope * y, gain + 2.0 * (p1 * y + p2 * x)
    shear = x * (along_y + 2.0 * p1) + 2.0 * p2 * y
    prism_x, prism_y = 2.0 * s1 + 4.0 * s2 * s, 2.0 * s3 + 4.0 * s4 * s
    xd, yd = x * gain + s * (p2 + s1 + s2 * s), y * gain + s * (p1 + s3 + s4 * s)
    xx, yy = gain + x * (along_x + 4.0 * p2 + prism_x), gain + y * (along_y + 4.0 * p1 + prism_y)
    return xd, yd, xx, shear + y * prism_x, shear + x * prism_y, yy


def _by_coefficient(model: LensModel, x: Tensor, y: Tensor, c: Sequence[Array]) -> list[tuple[Tensor, Tensor]]:
    """Derivatives (dxd/dc, dyd/dc) by each coefficient, before the tilt."""
    s = x * x + y * y
    if model.is_fisheye:
        return [(x * power, y * power) for power in (s, s * s, s * s * s, s * s * s * s)]
    gain, _, inverse = _radial(model, s, c)
    first, zero = s * inverse, 0.0 * s
    radial = [(x * power, y * power) for power in (first, s * first, s * s * first)]
    columns = [*radial[:2], (2.0 * x * y, s + 2.0 * y * y), (s + 2.0 * x * x, 2.0 * x * y), radial[2]]
    columns += [(-gain * dx, -gain * dy) for dx, dy in radial]
    return [*columns, (s, zero), (s * s, zero), (zero, s), (zero, s * s)][: len(c)]


def _lenses(model: LensModel, c: Tensor, shape: tuple[int, ...]) -> Iterator[tuple[Any, Any, list[float]]]:
    """The distinct lenses in c (..., k), broadcast against an array of this shape: for each the mask of its points,
    the core's lens on the untilted sensor, and its coefficients."""
    if c.ndim == 1:
        own = c.tolist()[:_BEFORE_TILT]
        yield ..., prepared(model.is_fisheye, (1.0, 1.0, 0.0, 0.0, *own)), own
        return
    sizes = (1,) * (len(shape) + 1 - c.ndim) + tuple(c.shape[:-1])
    lenses = c.detach().reshape((*sizes, c.shape[-1]))
    for place in product(*map(range, sizes)):
        # a dimension that the lenses do not have belongs to one lens as a whole
        where = tuple(slice(None) if size == 1 else i for i, size in zip(place, sizes, strict=True))
        for _, lens, own in _lenses(model, lenses[place], ()):
            yield where, lens, own


def _trusted(model: LensModel, c: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Mask of the ideal points (...) at which the lens is one to one. No gradients."""
    shape = torch.broadcast_shapes(x.shape, c.shape[:-1])
    x, y, valid = x.detach().expand(shape), y.detach().expand(shape), x.new_empty(shape, dtype=torch.bool)
    for where, lens, own in _lenses(model, c.detach(), shape):
        valid[where] = _inside(lens, x[where], y[where], _linearize(model, x[where], y[where], own)[2:])
    return valid


def _inside(lens: Any, x: Tensor, y: Tensor, jacobian: Sequence[Tensor]) -> Tensor:
    inside = x * x + y * y < lens.ideal_limit**2
    if lens.undistorted or lens.radial:
        return inside
    return inside | (_definite(*jacobian) & _encloses(lens.ideal_rim, x, y))


def _definite(xx: Tensor, xy: Tensor, yx: Tensor, yy: Tensor) -> Tensor:
    """Whether the symmetric part of [[xx, xy], [yx, yy]] is positive definite (the determinant is then positive)."""
    shear = 0.5 * (xy + yx)
    return (xx + yy > 0) & (xx * yy - shear * shear > 0)


def _encloses(rim: np.ndarray, x: Tensor, y: Tensor) -> Tensor:
    """Mask of the points (...) inside a rim, that has a radius in each of evenly spaced directions from −π on."""
    radii, count = like(x, rim), len(rim) - 1
    place = (torch.arctan2(y, x) + math.pi) * (count / (2.0 * math.pi))
    index = torch.where(torch.isfinite(place), place, 0.0).long().clamp(max=count - 1)
    return torch.sqrt(x * x + y * y) < radii[index] + (place - index) * (radii[index + 1] - radii[index])


class _Invert(torch.autograd.Function):
    """Ideal points (...) in the model's chart from distorted ones (...) before the sensor's tilt, and their
    validity.

    Differentiable in x, y and c (..., k); invalid points are (0, 0) without gradient.
    """

    @staticmethod
    def forward(x: Tensor, y: Tensor, c: Tensor, model: LensModel) -> _Solution:
        return _solved(model, x.detach(), y.detach(), c.detach())

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: _Solution) -> None:
        x, y, c, ctx.model = inputs
        ideal_x, ideal_y, valid = output
        ctx.shapes = x.shape, y.shape, c.shape
        ctx.mark_non_differentiable(valid)
        ctx.save_for_backward(ideal_x, ideal_y, c, valid)
        ctx.save_for_forward(ideal_x, ideal_y, c, valid)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor, None]:
        ideal_x, ideal_y, c, valid = ctx.saved_tensors
        along_x, along_y = (torch.where(valid, gradient, 0.0) for gradient in gradients[:2])
        _, _, xx, xy, yx, yy = _linearize(ctx.model, ideal_x, ideal_y, c.unbind(-1))
        determinant = xx * yy - xy * yx
        by_x, by_y = (yy * along_x - yx * along_y) / determinant, (xx * along_y - xy * along_x) / determinant
        columns = _by_coefficient(ctx.model, ideal_x, ideal_y, c.unbind(-1))
        by_c = [-(by_x * dx + by_y * dy) for dx, dy in columns]
        by_c += [torch.zeros_like(by_x)] * (c.shape[-1] - len(columns))
        shape_x, shape_y, shape_c = ctx.shapes
        whole = torch.stack(by_c, -1) if by_c else by_x.new_zeros((*by_x.shape, 0))
        return by_x.sum_to_size(shape_x), by_y.sum_to_size(shape_y), whole.sum_to_size(shape_c), None

    @staticmethod
    def jvp(ctx: Any, dx: Array, dy: Array, dc: Array, _: None) -> tuple[Array, Array, None]:
        ideal_x, ideal_y, c, valid = ctx.saved_tensors
        dx, dy = (torch.zeros_like(ideal_x) if tangent is None else tangent for tangent in (dx, dy))
        if dc is not None:
            columns = _by_coefficient(ctx.model, ideal_x, ideal_y, c.unbind(-1))
            for (column_x, column_y), tangent in zip(columns, dc.unbind(-1), strict=False):
                dx, dy = dx - column_x * tangent, dy - column_y * tangent
        xx, xy, yx, yy = _linearize(ctx.model, ideal_x, ideal_y, c.unbind(-1))[2:]
        inverse = valid / (xx * yy - xy * yx)
        return (yy * dx - xy * dy) * inverse, (xx * dy - yx * dx) * inverse, None

    @staticmethod
    def vmap(info: Any, in_dims: tuple, x: Tensor, y: Tensor, c: Tensor, model: LensModel) -> Any:
        # what is mapped over becomes one more of the points' leading dimensions
        ranks = [
            value.ndim - last - (dim is not None)
            for value, dim, last in zip((x, y, c), in_dims, (0, 0, 1), strict=False)
        ]

        def fronted(value: Tensor, dim: int | None, rank: int) -> Tensor:
            if dim is None:
                return value
            value = value.movedim(dim, 0)
            return value.reshape(len(value), *(1,) * (max(ranks) - rank), *value.shape[1:])

        mapped = (fronted(*each) for each in zip((x, y, c), in_dims, ranks, strict=False))
        return _Invert.apply(*mapped, model), (0, 0, 0)


def _solved(model: LensModel, x: Tensor, y: Tensor, c: Tensor) -> _Solution:
    shape = torch.broadcast_shapes(x.shape, y.shape, c.shape[:-1])
    x, y = x.expand(shape), y.expand(shape)
    ideal_x, ideal_y, valid = x.new_zeros(shape), x.new_zeros(shape), x.new_zeros(shape, dtype=torch.bool)
    for where, lens, own in _lenses(model, c, shape):
        if x.device.type == "cpu":
            found = _by_core(lens, x[where], y[where])
        else:
            found = _solve_on_device(model, lens, own, x[where], y[where])
        ideal_x[where], ideal_y[where], valid[where] = found
    return ideal_x, ideal_y, valid


def _by_core(lens: Any, x: Tensor, y: Tensor) -> _Solution:
    points, valid = lens.chart(torch.stack([x, y], -1).reshape(-1, 2).double().numpy())
    ideal, valid = torch.from_numpy(points).to(x).reshape(*x.shape, 2), torch.from_numpy(valid).reshape(x.shape)
    ideal = torch.where(valid[..., None], ideal, 0.0)
    return ideal[..., 0], ideal[..., 1], valid


def _solve_on_device(model: LensModel, lens: Any, c: Sequence[float], x: Tensor, y: Tensor) -> _Solution:
    """Ideal points (...) of distorted points (...) on an untilted sensor, and their validity; invalid ones are (0,
    0). Newton's method from the core's table, each step shortened until it stays inside the region and the residual
    falls; the same on every device, also where the core cannot read the memory."""
    distorted = torch.sqrt(x * x + y * y)
    if lens.undistorted:
        valid = torch.isfinite(distorted) & (distorted < lens.ideal_limit)
        return torch.where(valid, x, 0.0), torch.where(valid, y, 0.0), valid
    reachable = distorted < lens.table_limit if lens.radial else _encloses(lens.reach_rim, x, y)
    x, y, distorted = (torch.where(reachable, each, 0.0) for each in (x, y, distorted))
    allowed = _tolerance(distorted)
    nodes, within = like(x, lens.nodes), distorted.clip(0.0, lens.table_limit)
    place = lens.nodes_per_unit * (within / (1.0 + within))
    index = place.long().clamp(max=len(nodes) - 2)
    radius = nodes[index] + (place - index) * (nodes[index + 1] - nodes[index])
    ratio = radius / (distorted + 1e-15)
    ideal, length = (x * ratio, y * ratio), torch.ones_like(x)
    at = _linearize(model, *ideal, c)
    # what does not start inside starts from deep inside
    deep = torch.where(_kept(lens, ideal, at), 1.0, 0.5 * lens.ideal_limit / radius.clip(0.5 * lens.ideal_limit, None))
    ideal = ideal[0] * deep, ideal[1] * deep
    at = _linearize(model, *ideal, c)
    # damped Newton
    for _ in range(24):
        off_x, off_y = x - at[0], y - at[1]
        residual = torch.maximum(off_x.abs(), off_y.abs())
        if bool(((residual <= allowed) | (length < 1e-3)).all()):
            break
        xx, xy, yx, yy = at[2:]
        scale = length / (xx * yy - xy * yx)
        following = ideal[0] + (yy * off_x - xy * off_y) * scale, ideal[1] + (xx * off_y - yx * off_x) * scale
        trial = _linearize(model, *following, c)
        fell = torch.maximum((x - trial[0]).abs(), (y - trial[1]).abs()) < residual
        taken = fell & _kept(lens, following, trial)
        ideal = torch.where(taken, following[0], ideal[0]), torch.where(taken, following[1], ideal[1])
        at = tuple(torch.where(taken, new, old) for new, old in zip(trial, at, strict=True))
        length = torch.where(taken, torch.clip(2.0 * length, 0.0, 1.0), 0.5 * length)
    # near a pole a rounding of the ideal point alone moves the distorted one by more than that
    steep = sum(each.abs() for each in at[2:]) * torch.maximum(ideal[0].abs(), ideal[1].abs())
    solved = torch.maximum((x - at[0]).abs(), (y - at[1]).abs()) <= allowed + 0.1 * _tolerance(steep)
    valid = reachable & solved & _kept(lens, ideal, at)
    return torch.where(valid, ideal[0], 0.0), torch.where(valid, ideal[1], 0.0), valid


def _kept(lens: Any, point: tuple[Tensor, Tensor], at: Sequence[Tensor]) -> Tensor:
    return _definite(*at[2:]) & _inside(lens, *point, at[2:])


def _tolerance(size: Tensor) -> Tensor:
    """Residual (...) that counts as zero: some tens of rounding errors of the largest term."""
    return (5e-14 if size.dtype == torch.float64 else 3e-6) * size + 1e-300
