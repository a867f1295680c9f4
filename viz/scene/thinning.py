"""Fewer of many."""

from __future__ import annotations

import numpy as np


def thinned(indices: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the indices (N,), evenly spread; the first and the last among them."""
    if len(indices) <= most:
        return indices
    return indices[np.unique(np.linspace(0, len(indices) - 1, most).round().astype(int))]
