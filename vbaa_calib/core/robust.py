"""Robust statistics: scatter from medians, the weights and losses of M-estimators, and chi-squared tests."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from .arrays import Array, namespace

MAD_SCALE = 1.4826
"""Standard deviation of normal numbers over their median absolute value."""
NORMAL_QUARTILE = 0.6745
"""Median absolute value of standard normal numbers, to the digits that are divided by."""
HUBER = 2.5
"""Whitened residuals beyond this count linearly (Huber): a few false points must not pull."""


def finite_or_none(value: float) -> float | None:
    """A number for JSON, which has neither NaN nor infinity: None in their place."""
    return float(value) if np.isfinite(value) else None


def finite_median(values: np.ndarray) -> float:
    """Median of the finite values among (...); NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan


def mad_std(residuals: np.ndarray) -> float:
    """Standard deviation of residuals (N,) about zero, from their median absolute value."""
    return MAD_SCALE * float(np.median(np.abs(residuals)))


def radial_std(distances: np.ndarray) -> float:
    """Standard deviation per axis of isotropic normal vectors in a plane with these lengths (N,), from their median."""
    # median length of a normal vector in the plane, in standard deviations per axis
    return float(np.median(distances)) / 1.1774


def huber_losses(residuals: Array) -> Array:
    """Huber's loss of each whitened residual (...): half its square, linear beyond `HUBER`."""
    xp = namespace(residuals)
    size = xp.abs(residuals)
    inner = xp.clip(size, None, HUBER)
    return inner * (size - 0.5 * inner)


def huber_weights(residuals: Array) -> Array:
    """Weights (...) on squared whitened residuals (...) for iteratively reweighted least squares with Huber's loss.

    Recomputed at every step, they keep every point in it. SciPy's robust solver leaves out the points in the linear
    range, far from the solution most of them, and takes three to eight times as many steps, or does not converge.
    """
    xp = namespace(residuals)
    return HUBER / xp.clip(xp.abs(residuals), HUBER, None)


def soft_l1_weights(distances: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Weights (N,) on squared distances (N,) for the pseudo-Huber loss, linear beyond the scale."""
    return 1.0 / np.sqrt(1.0 + (distances / scale) ** 2)


def soft_l1_losses(residuals: np.ndarray) -> np.ndarray:
    """The pseudo-Huber loss of each residual (...) in units of its scale."""
    return np.sqrt(1.0 + residuals**2) - 1.0


def chi_square(errors: np.ndarray, covariance: np.ndarray) -> float:
    """Squared Mahalanobis distance eᵀ Σ⁻¹ e of errors (d,) with covariance (d, d), in any mixture of units."""
    std = np.sqrt(np.diag(covariance))
    return float(errors / std @ np.linalg.solve(covariance / np.outer(std, std), errors / std))


def chi_square_p(square: float, freedom: float) -> float:
    """p-value of χ²: the probability that a χ² variable with `freedom` degrees of freedom is larger than `square`.

    By the incomplete gamma function's series or, beyond its middle, its continued fraction: SciPy's functions take
    longer to load than a contact to find.
    """
    half, order = 0.5 * square, 0.5 * freedom
    if not 0.0 < half < math.inf:
        return math.nan if math.isnan(half) else float(half <= 0.0)
    density = math.exp(order * math.log(half) - half - math.lgamma(order))
    if half < order + 1.0:
        total = term = 1.0 / order
        while term > 1e-17 * total:
            order += 1.0
            term *= half / order
            total += term
        return 1.0 - density * total
    below = half + 1.0 - order
    upper, lower, total = 1e300, 1.0 / below, 1.0 / below
    for n in range(1, 10_000):
        below += 2.0
        lower = 1.0 / (below - n * (n - order) * lower)
        upper = below - n * (n - order) / upper
        total *= upper * lower
        if abs(upper * lower - 1.0) < 4e-16:
            break
    return density * total


@cache
def chi_limit(chance: float, freedom: float) -> float:
    """The distance in standard deviations beyond which a vector of `freedom` >= 1 normal numbers lies with the
    probability `chance`.

    Newton's steps on the logarithm of that probability, which is concave; none so long that it would become zero.
    """
    found = math.sqrt(freedom)
    for _ in range(100):
        p = chi_square_p(found**2, freedom)
        log_density = (
            (freedom - 1.0) * math.log(found) - 0.5 * found**2 + (1.0 - 0.5 * freedom) * math.log(2.0)
        ) - math.lgamma(0.5 * freedom)
        step = min(math.log(p / chance) * p / math.exp(log_density), 2.0)
        found += step
        if abs(step) < 1e-14 * found:
            break
    return found
