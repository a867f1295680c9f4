"""Numbers, lists, arrays or tensors of broadcasting shapes, taken through formulas in pieces."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from vbaa_calib.arrays import Array, like, namespace, widest_float

_PIECE = {np: 16384, torch: 65536}
"""Frames worked on at a time: few enough for the cache, for torch enough to share among its threads."""


def floats(*values: Any) -> list[Array]:
    """Values in float64: tensors on one device as soon as one of them is a tensor, otherwise arrays."""
    tensors = [value for value in values if isinstance(value, torch.Tensor)]
    if not tensors:
        return [np.asarray(value, float) for value in values]
    device = tensors[0].device
    reference = torch.empty(0, dtype=widest_float(device), device=device)
    return [like(reference, value) for value in values]


def in_pieces(work: Callable[..., tuple[Array, ...]], batch: tuple[int, ...], *values: Array) -> list[Array]:
    """Results (batch) of a function of flat arrays (n,), worked out in pieces that stay in a processor's cache.

    `values` broadcast to the batch, and one of them has its shape; single numbers are handed on as they are. Warnings
    about NaN are off.
    """
    xp = namespace(values[0])
    flat = [v if v.ndim == 0 and batch else xp.broadcast_to(v, batch).reshape(-1) for v in values]
    count = math.prod(batch)
    step = _PIECE[xp] if xp is np or values[0].device.type == "cpu" else max(count, 1)
    with np.errstate(all="ignore"):
        pieces = [
            work(*(v if v.ndim == 0 else v[start : start + step] for v in flat))
            for start in range(0, max(count, 1), step)
        ]
    return [xp.concat(list(column)).reshape(batch) for column in zip(*pieces, strict=True)]
