"""Covariance matrices: validity, independent axes, variances along directions, conditioning."""

from __future__ import annotations

import numpy as np


def independent_axes(covariance: np.ndarray) -> np.ndarray:
    """A matrix A (P, P) with A·Aᵀ equal to the covariance (P, P): steps along its columns are independent, one
    standard deviation long.

    The covariance may be singular: exact numbers get rows of zeros, and eigenvalues that rounding made negative count
    as zero.
    """
    std = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    unit = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return std[:, None] * vectors * np.sqrt(np.clip(values, 0.0, None))


def conditioned(covariance: np.ndarray, first: int) -> tuple[np.ndarray, np.ndarray]:
    """Conditional normal distribution of the last P − F numbers on the first F: regression coefficients (P − F, F)
    and conditional standard deviations (P − F,). covariance : (P, P), not singular for the first F.

    By a triangular factor: the difference of two covariances that are nearly the same may be negative.
    """
    _, factor = np.linalg.qr(independent_axes(covariance).T)
    slopes = np.linalg.solve(factor[:first, :first], factor[:first, first:]).T
    return slopes, np.linalg.norm(factor[first:, first:], axis=0)


def largest_std(covariance: np.ndarray) -> np.ndarray:
    """(...) standard deviation in the worst direction of covariances (..., D, D); NaN where one is not finite."""
    std = np.full(covariance.shape[:-2], np.nan)
    known = np.isfinite(covariance).all(axis=(-1, -2))
    std[known] = np.sqrt(np.linalg.eigvalsh(covariance[known])[..., -1].clip(0.0))
    return std


def variance_along(covariance: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N,) variances, along directions (N, D), of vectors with covariances (N, D, D)."""
    return np.asarray(np.einsum("ni,nij,nj->n", directions, covariance, directions))


def is_covariance(matrix: np.ndarray) -> bool:
    """Whether a matrix is symmetric and positive semidefinite, whatever the units of its rows."""
    variance = np.diag(matrix)
    if (variance < 0).any():
        return False
    deviation = np.sqrt(np.where(variance > 0, variance, 1.0))
    with np.errstate(over="ignore"):
        correlation = matrix / deviation / deviation[:, None]
    if np.abs(correlation).max() > 1 + 1e-6 or np.abs(correlation - correlation.T).max() > 1e-6:
        return False
    return bool(np.linalg.eigvalsh(correlation).min() > -1e-6)
