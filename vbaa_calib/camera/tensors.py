"""The way back through the lens for tensors, with gradients. Loads torch."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from vbaa_calib.core.arrays import Array, like

from .inverse import solve
from .lens import Lens, each_lens, lens_of
from .models import Coefficients, LensModel

_Solution = tuple[Array, Array, Array]


def invert(model: LensModel, x: torch.Tensor, y: torch.Tensor, c: Coefficients | torch.Tensor) -> _Solution:
    """Ideal points (...) in the model's chart of distorted ones (...) before the sensor's tilt, and their validity; c
    floats, or a tensor (..., k). Differentiable in x, y and c; invalid points are (0, 0) without gradient."""
    coefficients = like(x, c)
    if coefficients.shape[-1] == 0:
        return solve(lens_of(model, ()), x, y)
    return _Invert.apply(x, y, coefficients, model)


class _Invert(torch.autograd.Function):
    @staticmethod
    def forward(x: torch.Tensor, y: torch.Tensor, c: torch.Tensor, model: LensModel) -> _Solution:
        return _solve_tensors(model, x.detach(), y.detach(), c.detach())

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: _Solution) -> None:
        x, y, c, ctx.model = inputs
        ideal_x, ideal_y, valid = output
        ctx.shapes = x.shape, y.shape, c.shape
        ctx.mark_non_differentiable(valid)
        ctx.save_for_backward(ideal_x, ideal_y, c, valid)
        ctx.save_for_forward(ideal_x, ideal_y, c, valid)

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, None]:
        ideal_x, ideal_y, c, valid = ctx.saved_tensors
        along_x, along_y = (torch.where(valid, gradient, 0.0) for gradient in gradients[:2])
        _, _, xx, xy, yx, yy = ctx.model.linearize(ideal_x, ideal_y, c.unbind(-1))
        determinant = xx * yy - xy * yx
        by_x, by_y = (yy * along_x - yx * along_y) / determinant, (xx * along_y - xy * along_x) / determinant
        columns = ctx.model.by_coefficient(ideal_x, ideal_y, c.unbind(-1))
        by_c = [-(by_x * dx + by_y * dy) for dx, dy in columns]
        by_c += [torch.zeros_like(by_x)] * (c.shape[-1] - len(columns))
        shape_x, shape_y, shape_c = ctx.shapes
        return by_x.sum_to_size(shape_x), by_y.sum_to_size(shape_y), torch.stack(by_c, -1).sum_to_size(shape_c), None

    @staticmethod
    def jvp(ctx: Any, dx: Array, dy: Array, dc: Array, _: None) -> tuple[Array, Array, None]:
        ideal_x, ideal_y, c, valid = ctx.saved_tensors
        dx, dy = (torch.zeros_like(ideal_x) if tangent is None else tangent for tangent in (dx, dy))
        if dc is not None:
            columns = ctx.model.by_coefficient(ideal_x, ideal_y, c.unbind(-1))
            for (column_x, column_y), tangent in zip(columns, dc.unbind(-1), strict=False):
                dx, dy = dx - column_x * tangent, dy - column_y * tangent
        _, _, xx, xy, yx, yy = ctx.model.linearize(ideal_x, ideal_y, c.unbind(-1))
        inverse = valid / (xx * yy - xy * yx)
        return (yy * dx - xy * dy) * inverse, (xx * dy - yx * dx) * inverse, None

    @staticmethod
    def vmap(info: Any, in_dims: tuple, x: torch.Tensor, y: torch.Tensor, c: torch.Tensor, model: LensModel) -> Any:
        # what is mapped over becomes one more of the points' leading dimensions
        ranks = [
            value.ndim - last - (dim is not None)
            for value, dim, last in zip((x, y, c), in_dims, (0, 0, 1), strict=False)
        ]

        def fronted(value: torch.Tensor, dim: int | None, rank: int) -> torch.Tensor:
            if dim is None:
                return value
            value = value.movedim(dim, 0)
            return value.reshape(len(value), *(1,) * (max(ranks) - rank), *value.shape[1:])

        mapped = (fronted(*each) for each in zip((x, y, c), in_dims, ranks, strict=False))
        return _Invert.apply(*mapped, model), (0, 0, 0)


def _solve_tensors(model: LensModel, x: torch.Tensor, y: torch.Tensor, c: torch.Tensor) -> _Solution:
    shape = torch.broadcast_shapes(x.shape, y.shape, c.shape[:-1])
    x, y = x.expand(shape), y.expand(shape)
    ideal_x, ideal_y = x.new_zeros(shape), x.new_zeros(shape)
    valid = x.new_zeros(shape, dtype=torch.bool)
    for where, lens in each_lens(model, c, shape):
        ideal_x[where], ideal_y[where], valid[where] = _solve_one_lens(lens, x[where], y[where])
    return ideal_x, ideal_y, valid


def _solve_one_lens(lens: Lens, x: torch.Tensor, y: torch.Tensor) -> _Solution:
    if x.device.type != "cpu":
        return solve(lens, x, y)
    # on the processor NumPy needs a fraction of the time per call; the memory is shared, nothing is copied
    ideal_x, ideal_y, valid = (torch.from_numpy(np.asarray(part)) for part in solve(lens, x.numpy(), y.numpy()))
    return ideal_x, ideal_y, valid
