"""Steps along which uncertain numbers vary independently."""

from __future__ import annotations

import numpy as np


def independent_axes(covariance: np.ndarray) -> np.ndarray:
    """A (P, P) with A·Aᵀ the covariance (P, P): steps along its columns are independent, of unit deviation.

    The covariance may be singular: what is known exactly has a row of zeros, and so has what rounding left below nothing.
    """
    std = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    unit = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return std[:, None] * vectors * np.sqrt(np.clip(values, 0.0, None))
