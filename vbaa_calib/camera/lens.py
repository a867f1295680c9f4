"""The core's lens object for a camera's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from vbaa_calib.core.arrays import Array, is_tensor, namespace, working
from vbaa_calib.native import core

from .models import LensModel

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A lens model with its parameters: floats, or tensors that broadcast against the points (coefficients before
    k)."""

    model: LensModel
    fx: Array
    fy: Array
    cx: Array
    cy: Array
    coefficients: Sequence[float] | torch.Tensor


def lens_of(intrinsics: Intrinsics) -> Any:
    """`core.lens.Lens` for intrinsics that are floats; the latest 128 are cached."""
    one = intrinsics
    return prepared(one.model.is_fisheye, (one.fx, one.fy, one.cx, one.cy, *one.coefficients))


@lru_cache(maxsize=128)
def prepared(fisheye: bool, parameters: tuple[float, ...]) -> Any:
    """`core.lens.Lens` for fx, fy, cx, cy and coefficients. Takes a fraction of a millisecond."""
    return core.lens.Lens(fisheye, np.array(parameters, float))


def from_core(
    intrinsics: Intrinsics, method: str, values: Array, last: int, name: str, *more: Any, single: bool = False
) -> list[Array]:
    """Results of a method of the core's lens for values (..., last), each (..., *) in the kind, float type and
    device of the values; tensors come back without gradients. Raises InputError that names the values.

    single : float32 arrays are worked on in float32.
    """
    ready, restore = working(values, last, name)
    shape, flat = tuple(ready.shape[:-1]), ready.reshape(-1, last)
    if is_tensor(flat):
        flat = flat.detach().cpu().double().numpy()
    kind = np.float32 if single and str(getattr(values, "dtype", "")) == "float32" else np.float64
    found = getattr(lens_of(intrinsics), method)(np.ascontiguousarray(flat, kind), *more)
    parts = [each.reshape(shape + each.shape[1:]) for each in found if len(each) == len(flat)]
    if is_tensor(values):
        tensors = [namespace(values).from_numpy(each) for each in parts]
        return [each.to(values.device, values.dtype if each.is_floating_point() else None) for each in tensors]
    return [each if each.dtype == bool else restore(each) for each in parts]


def ray_derivatives(intrinsics: Intrinsics, pixels: Array) -> tuple[Array, Array, Array, Array]:
    """Unit rays (..., 3) of pixels, their derivatives (..., 3, 2) by the pixels and (..., 3, 4 + k) by fx, fy, cx,
    cy and distortion at fixed pixels, and validity (...). NaN where not valid."""
    rays, valid, by_pixel, by_lens = from_core(intrinsics, "rays_with_slopes", pixels, 2, "pixels")
    return rays, by_pixel, by_lens, valid
