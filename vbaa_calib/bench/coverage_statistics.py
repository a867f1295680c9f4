"""Predicted against sampled scatter: many errors, each with its predicted covariance, to a few honest numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

REGION = 0.95


@dataclass(frozen=True, eq=False)
class Errors:
    """K things of d numbers each in one draw: errors (K, d), solved less true, and predicted covariances (K, d, d)."""

    errors: np.ndarray
    covariances: np.ndarray

    @property
    def whitened(self) -> np.ndarray:
        """(K, d) errors over their predicted standard deviations, number by number."""
        return self.errors / np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1))

    @property
    def squares(self) -> np.ndarray:
        """(K,) eᵀ Σ⁻¹ e: χ² with d degrees of freedom if the covariances are right."""
        std = np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1))
        correlation = self.covariances / (std[..., :, None] * std[..., None, :])
        solved = np.linalg.solve(correlation, self.whitened[..., None])[..., 0]
        return (self.whitened * solved).sum(axis=-1)


@dataclass(frozen=True)
class Statistics:
    """Of one quantity over the draws.

    Attributes
    ----------
    ratio : sampled over predicted standard deviation, in the mean square over the quantity's numbers.
    ratio_error : its standard error. worst_ratio : that of the number whose ratio is furthest from 1.
    covered : share of the 95 % regions that hold the truth. covered_error : its standard error.
    bias : mean error in predicted standard deviations, of the number where it is largest; its standard error is
        1/√draws where only noise is at work.
    predicted_std : typical predicted standard deviation (rms over draws and numbers), unit of the errors.
    """

    ratio: float
    ratio_error: float
    worst_ratio: float
    covered: float
    covered_error: float
    bias: float
    predicted_std: float


def statistics(draws: Sequence[Errors]) -> Statistics:
    """Of at least two draws."""
    whitened = np.array([draw.whitened for draw in draws])
    scatter = whitened - whitened.mean(axis=0)
    squares = (scatter**2).mean(axis=(1, 2))
    count = len(draws)
    ratio = float(np.sqrt(squares.sum() / (count - 1)))
    each = whitened.std(axis=0, ddof=1)
    mean = whitened.mean(axis=0)
    things, numbers = whitened.shape[1:]
    inside = np.array([draw.squares for draw in draws]) <= chi2.ppf(REGION, numbers)
    # things that share a draw share its errors: what scatters is the draw's share
    spread = np.sqrt(REGION * (1 - REGION)) if things == 1 else float(inside.mean(axis=1).std(ddof=1))
    variances = np.array([np.diagonal(draw.covariances, axis1=-2, axis2=-1) for draw in draws])
    return Statistics(
        ratio=ratio,
        # of a mean of squares, and the root halves it
        ratio_error=float(squares.std(ddof=1) / np.sqrt(count) / (2.0 * ratio)),
        worst_ratio=float(each.ravel()[np.abs(np.log(each)).argmax()]),
        covered=float(inside.mean()),
        covered_error=spread / float(np.sqrt(count)),
        bias=float(mean.ravel()[np.abs(mean).argmax()]),
        predicted_std=float(np.sqrt(variances.mean())),
    )
