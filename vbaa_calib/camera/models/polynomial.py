"""Roots of the polynomials that say where a lens folds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def smallest_positive_root(coefficients: Sequence[float] | np.ndarray, limit: float) -> float:
    """Smallest real root in (0, limit] of Σ c_i s^i, coefficients (n,), or inf.

    Terms that do not matter anywhere up to the limit are left out: their roots lie beyond it.
    """
    scaled = np.asarray(coefficients, float) * limit ** np.arange(len(coefficients), dtype=float)
    kept = np.flatnonzero(np.abs(scaled) > 1e-15 * np.abs(scaled).max(initial=0.0))
    if kept.size == 0 or kept[-1] == 0:
        return math.inf
    roots = np.roots(scaled[kept[-1] :: -1])
    # a pair that rounding has lifted off the real axis still counts: the lens is flat there
    real = roots.real[np.abs(roots.imag) <= 1e-7 * np.abs(roots)]
    inside = real[(real > 0.0) & (real <= 1.0)]
    return float(inside.min() * limit) if inside.size else math.inf
