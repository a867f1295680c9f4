"""Loose inputs (numbers, lists, arrays, tensors) made one kind."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from ..arrays import Array


def alike(*values: Any) -> list[Array]:
    """All values as tensors of the first tensor's dtype and device if one is a tensor, else as NumPy's float64."""
    for value in values:
        if isinstance(value, torch.Tensor):
            return [torch.as_tensor(other, dtype=value.dtype, device=value.device) for other in values]
    return [np.asarray(value, float) for value in values]
