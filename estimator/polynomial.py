"""Many small polynomials at once: arrays (n, degree + 1) of coefficients in rising powers."""

from __future__ import annotations

import numpy as np


def product(first: np.ndarray, *factors: np.ndarray) -> np.ndarray:
    """Products of polynomials, (n, degree + 1) each."""
    for factor in factors:
        total = np.zeros((len(first), first.shape[1] + factor.shape[1] - 1))
        for power in range(factor.shape[1]):
            total[:, power : power + first.shape[1]] += first * factor[:, power : power + 1]
        first = total
    return first


def real_roots(rising: np.ndarray) -> np.ndarray:
    """Real roots (n, degree) of polynomials (n, degree + 1) in rising powers; NaN in place of the complex ones."""
    degree = rising.shape[1] - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        monic = rising / rising[:, -1:]
    usable = np.isfinite(monic).all(axis=-1)
    companion = np.zeros((len(rising), degree, degree))
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    companion[usable, :, -1] = -monic[usable, :-1]
    roots = np.linalg.eigvals(companion)
    real = np.where(np.abs(roots.imag) <= 1e-6 * np.abs(roots), roots.real, np.nan)
    real[~usable] = np.nan
    slope = monic[:, 1:] * np.arange(1, degree + 1)
    # the companion matrix's eigenvalues carry its norm's rounding; Newton's steps take that off simple roots
    for _ in range(2):
        with np.errstate(divide="ignore", invalid="ignore"):
            step = _value(monic, real) / _value(slope, real)
        real = np.where(np.abs(step) < 1e-3 * np.abs(real), real - step, real)
    return real


def _value(rising: np.ndarray, at: np.ndarray) -> np.ndarray:
    total = np.zeros_like(at)
    for column in rising.T[::-1]:
        total = total * at + column[:, None]
    return total
