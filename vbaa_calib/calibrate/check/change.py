"""Generalised least squares for a change in some of a rig's parameters, the others uncertain as calibrated.

The data are linear in the parameters' errors: r = J·(e + E·δ) + noise, e the rig's error with the joint covariance Σ, δ
the change of the parameters that E picks. With A = JᵀJ, s = Jᵀr (whitened by the noise) and W = A (I + Σ A)⁻¹, which
needs no inverse of either, δ has the information EᵀWE and the score Eᵀ(I + A Σ)⁻¹ s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_LEAST_INFORMATION = 1.0  # information, in units of the scale, from which on the data show a direction
_UNOBSERVED_STD, _FREE_STD = 10.0, 100.0  # in the same units: directions that the data do not show; free parameters
_SIGNIFICANT_STD = 3.0


@dataclass(frozen=True, eq=False)
class Information:
    """Whitened data about P parameters: JᵀJ (P, P) and Jᵀr (P,). Two sets of data add up."""

    matrix: np.ndarray
    score: np.ndarray

    @staticmethod
    def of(jacobian: np.ndarray, residuals: np.ndarray, nuisance: np.ndarray | None = None) -> Information:
        """From whitened derivatives (N, P) and residuals (N,), observed less predicted; nuisance : (N, K) derivatives
        by unknowns of these data alone, each 0 ± 1, which are marginalised."""
        if nuisance is None or not nuisance.any():
            return Information(jacobian.T @ jacobian, jacobian.T @ residuals)
        both = nuisance.T @ np.column_stack([jacobian, residuals])
        lost = both[:, :-1].T @ np.linalg.solve(np.eye(nuisance.shape[1]) + nuisance.T @ nuisance, both)
        return Information(jacobian.T @ jacobian - lost[:, :-1], jacobian.T @ residuals - lost[:, -1])

    def __add__(self, other: Information) -> Information:
        return Information(self.matrix + other.matrix, self.score + other.score)


@dataclass(frozen=True, eq=False)
class Change:
    """An estimated change of Q parameters."""

    step: np.ndarray  # (Q,), zero along directions that the data do not show
    covariance: np.ndarray  # (Q, Q) of rig and new data together; large along those directions
    significant: np.ndarray  # (Q,) the step along directions in which it exceeds three standard deviations
    distance_std: float  # Mahalanobis length of the step
    freedom: int  # number of directions that the data show

    @property
    def std(self) -> np.ndarray:
        """(Q,)."""
        return np.sqrt(np.diag(self.covariance).clip(0.0))


def estimate_change(
    information: Information, covariance: np.ndarray, wanted: np.ndarray, scale: np.ndarray, free: Sequence[int] = ()
) -> Change:
    """The change of the parameters with indices `wanted` (Q,), those of `free` unconstrained; covariance : (P, P) of
    the rig's parameters, scale : (P,) noticeable changes. Directions in which the data do not show one are left out."""
    # in units of the scale, so that metres and radians weigh alike
    matrix, score = information.matrix * np.outer(scale, scale), information.score * scale
    prior = covariance / np.outer(scale, scale)
    prior[list(free), list(free)] += _FREE_STD**2
    spread = np.eye(len(covariance)) + matrix @ prior
    weight, score = np.linalg.solve(spread, matrix), np.linalg.solve(spread, score)
    values, axes = np.linalg.eigh(weight[np.ix_(wanted, wanted)])
    seen, std = values > _LEAST_INFORMATION, 1.0 / np.sqrt(np.maximum(values, _UNOBSERVED_STD**-2))
    along = np.where(seen, (axes.T @ score[wanted]) * std**2, 0.0)
    units = scale[wanted]
    return Change(
        step=(axes @ along) * units,
        covariance=(axes * std**2) @ axes.T * np.outer(units, units),
        significant=(axes @ np.where(np.abs(along) > _SIGNIFICANT_STD * std, along, 0.0)) * units,
        distance_std=float(np.linalg.norm(along / std)),
        freedom=int(seen.sum()),
    )
