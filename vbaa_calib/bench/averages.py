"""Root mean squares of errors, and what becomes of them where there are none."""

from __future__ import annotations

import numpy as np


def rms(values: np.ndarray) -> float:
    """Root mean square of all; NaN of nothing, and where one of them is NaN."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def rms_known(values: np.ndarray) -> float:
    """Root mean square of what is finite; NaN of nothing."""
    return rms(values[np.isfinite(values)])


def or_none(value: float | np.floating) -> float | None:
    """The number; None for NaN or infinity."""
    return float(value) if np.isfinite(value) else None
