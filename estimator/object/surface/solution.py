"""All patches of an object in one linear Gaussian solve: shapes, common errors and one compliance (universal kriging).

y = K-shapes + modes · s + noise + compliance · force,   s ~ N(0, 1), the compliance without any prior
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, block_diag, cho_factor, cho_solve, solve_triangular

from .equations import Equations
from .kernel import Functionals, Prior, covariance, pairs, variance


@dataclass(frozen=True, eq=False)
class PatchModel:
    """The equations of a patch, the prior of its shape, and the tangents' standard deviation beyond what is known."""

    equations: Equations
    prior: Prior
    slack_rad: float

    @property
    def own(self) -> np.ndarray:
        """(M, M) covariance of everything but the common errors."""
        own = self.seen_by(self.equations.rows) + self.equations.noise
        return own + np.diag((self.slack_rad * self.equations.slack) ** 2)

    def seen_by(self, rows: Functionals) -> np.ndarray:
        """(Q, M) prior covariance of views with the equations."""
        return covariance(pairs(rows, self.equations.rows), self.prior)


@dataclass(frozen=True, eq=False)
class Solution:
    """Of all patches, whose equations begin at `start` (patches,).

    `lower` (M, M) is the Cholesky factor of the covariance of y, weights (M,) is covariance⁻¹ (y − compliance · force),
    lift (M,) is covariance⁻¹ force. The compliance is beyond what was taken into the points, zero where it is left out.
    """

    patches: tuple[PatchModel, ...]
    start: np.ndarray
    lower: np.ndarray
    weights: np.ndarray
    lift: np.ndarray
    compliance_m_N: float
    variance: float

    def _seen_by(self, patch: int, rows: Functionals) -> np.ndarray:
        """(Q, M) prior covariance of views of a patch with all equations."""
        result = np.zeros((len(rows), len(self.weights)))
        result[:, self._of(patch)] = self.patches[patch].seen_by(rows)
        return result

    def _of(self, patch: int) -> slice:
        return slice(self.start[patch], self.start[patch] + len(self.patches[patch].equations))

    def mean(self, patch: int, rows: Functionals) -> np.ndarray:
        """(Q,) views of the unpressed shape of a patch."""
        return self.patches[patch].seen_by(rows) @ self.weights[self._of(patch)]

    def spread(self, patch: int, rows: Functionals) -> np.ndarray:
        """(Q,) standard deviations of the same."""
        seen = self._seen_by(patch, rows)
        half = solve_triangular(self.lower, seen.T, lower=True, check_finite=False)
        left = variance(rows, self.patches[patch].prior) - np.sum(half**2, axis=0)
        left += (seen @ self.lift) ** 2 * self.variance
        return np.sqrt(np.maximum(left, 0.0))

    def joint(self, views: list[tuple[int, Functionals]]) -> np.ndarray:
        """(Q, Q) covariance of views of several patches, one after the other."""
        seen = np.concatenate([self._seen_by(patch, rows) for patch, rows in views])
        prior = block_diag(*(covariance(pairs(rows, rows), self.patches[patch].prior) for patch, rows in views))
        half = solve_triangular(self.lower, seen.T, lower=True, check_finite=False)
        lifted = seen @ self.lift
        return prior - half.T @ half + self.variance * np.outer(lifted, lifted)

    @property
    def leave_one_out_residuals(self) -> np.ndarray:
        """(M,) each equation less what all the others predict, in deviations (Rasmussen and Williams, Eq. 5.12)."""
        half = solve_triangular(self.lower, np.eye(len(self.weights)), lower=True, check_finite=False)
        return self.weights / np.sqrt(np.sum(half**2, axis=0))


def factor(matrix: np.ndarray) -> np.ndarray:
    """Lower Cholesky factor; what rounding takes away is given back, as little as will do."""
    for jitter in (0.0, 1e-12, 1e-10, 1e-8):
        try:
            return cho_factor(matrix + jitter * np.diag(np.diag(matrix)), lower=True, check_finite=False)[0]
        except LinAlgError:
            continue
    raise LinAlgError("the covariance of the touches is not positive definite")


def solve(patches: tuple[PatchModel, ...], yielding: bool) -> Solution:
    """The solve; `yielding`: with a compliance, otherwise the object is taken as rigid."""
    every = [fitted.equations for fitted in patches]
    modes = np.concatenate([each.modes for each in every])
    y, force = np.concatenate([each.y for each in every]), np.concatenate([each.force_N for each in every])
    lower = factor(block_diag(*(fitted.own for fitted in patches)) + modes @ modes.T)
    weights, lift = cho_solve((lower, True), y), cho_solve((lower, True), force)
    compliance = spread = 0.0
    information = float(force @ lift)
    if yielding and information > 0.0:
        spread = 1.0 / information
        compliance = spread * float(lift @ y)
        weights = weights - compliance * lift
    start = np.cumsum([0, *map(len, every[:-1])])
    return Solution(patches, start, lower, weights, lift, compliance, spread)
