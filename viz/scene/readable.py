"""What a reader can take in: fewer of many, larger where too small, round lengths."""

from __future__ import annotations

import numpy as np

_ENLARGEMENTS = (1, 2, 5, 10, 20, 50, 100)


def thinned(indices: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the indices (N,), evenly spread; the first and the last among them."""
    if len(indices) <= most:
        return indices
    return indices[np.unique(np.linspace(0, len(indices) - 1, most).round().astype(int))]


def enlargement(sizes: np.ndarray, visible: float) -> int:
    """How many times larger than life the middle one of sizes (N,) can be seen, a round number up to 100."""
    known = sizes[np.isfinite(sizes)]
    wanted = visible / max(float(np.median(known)), 1e-12) if len(known) else 1.0
    return next((factor for factor in _ENLARGEMENTS if factor >= wanted), _ENLARGEMENTS[-1])


def round_down(value: float) -> float:
    """The next 1, 2 or 5 times a power of ten that is not larger."""
    power = 10.0 ** float(np.floor(np.log10(value)))
    return float(f"{power * max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)):.1g}")
