"""All patches of an object in one linear Gaussian solve: shapes, common errors and one compliance (universal kriging).

y = K-shapes + modes · s + noise + compliance · force,   s ~ N(0, 1), the compliance without any prior
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, block_diag, cho_factor, cho_solve, solve_triangular

from .equations import Equations
from .kernel import Prior, Rows, covariance, pairs, variance

JITTERS = (0.0, 1e-12, 1e-10, 1e-8)


@dataclass(frozen=True, eq=False)
class Fitted:
    """The equations of a patch, the prior of its shape, and the tangents' standard deviation beyond what is known."""

    equations: Equations
    prior: Prior
    slack_rad: float

    @property
    def own(self) -> np.ndarray:
        """(M, M) covariance of everything but the common errors."""
        own = covariance(pairs(self.equations.rows, self.equations.rows), self.prior)
        return own + self.equations.noise + np.diag((self.slack_rad * self.equations.slack) ** 2)


@dataclass(frozen=True, eq=False)
class Solution:
    """Of all patches.

    Attributes
    ----------
    patches : as given. start : (patches,) where the equations of each begin.
    lower : (M, M) Cholesky factor of the covariance of y. weights : (M,) covariance⁻¹ (y − compliance · force).
    lift : (M,) covariance⁻¹ force. compliance_m_N, variance, own_variance : beyond what was taken into the points;
        zero where it is left out. The own variance leaves out the common errors.
    """

    patches: tuple[Fitted, ...]
    start: np.ndarray
    lower: np.ndarray
    weights: np.ndarray
    lift: np.ndarray
    compliance_m_N: float
    variance: float
    own_variance: float

    def seen_by(self, patch: int, rows: Rows) -> np.ndarray:
        """(Q, M) prior covariance of views of a patch with all equations."""
        fitted = self.patches[patch]
        result = np.zeros((len(rows), len(self.weights)))
        begin = self.start[patch]
        result[:, begin : begin + len(fitted.equations)] = covariance(pairs(rows, fitted.equations.rows), fitted.prior)
        return result

    def mean(self, patch: int, rows: Rows) -> np.ndarray:
        """(Q,) views of the unpressed shape of a patch."""
        fitted, begin = self.patches[patch], self.start[patch]
        known = self.weights[begin : begin + len(fitted.equations)]
        return covariance(pairs(rows, fitted.equations.rows), fitted.prior) @ known

    def spread(self, patch: int, rows: Rows) -> np.ndarray:
        """(Q,) standard deviations of the same."""
        seen = self.seen_by(patch, rows)
        half = solve_triangular(self.lower, seen.T, lower=True, check_finite=False)
        left = variance(rows, self.patches[patch].prior) - np.sum(half**2, axis=0)
        left += (seen @ self.lift) ** 2 * self.variance
        return np.sqrt(np.maximum(left, 0.0))

    def joint(self, views: list[tuple[int, Rows]]) -> np.ndarray:
        """(Q, Q) covariance of views of several patches, one after the other."""
        seen = np.concatenate([self.seen_by(patch, rows) for patch, rows in views])
        prior = block_diag(*(covariance(pairs(rows, rows), self.patches[patch].prior) for patch, rows in views))
        half = solve_triangular(self.lower, seen.T, lower=True, check_finite=False)
        lifted = seen @ self.lift
        return prior - half.T @ half + self.variance * np.outer(lifted, lifted)


def factor(matrix: np.ndarray) -> np.ndarray:
    """Lower Cholesky factor; what rounding takes away is given back, as little as will do."""
    diagonal = np.diag(np.diag(matrix))
    for jitter in JITTERS:
        try:
            return cho_factor(matrix + jitter * diagonal, lower=True, check_finite=False)[0]
        except LinAlgError:
            continue
    raise LinAlgError("the covariance of the touches is not positive definite")


def solve(patches: tuple[Fitted, ...], yielding: bool) -> Solution:
    """The solve; `yielding`: with a compliance, otherwise the object is taken as rigid."""
    sizes = [len(fitted.equations) for fitted in patches]
    modes = np.concatenate([fitted.equations.modes for fitted in patches])
    y = np.concatenate([fitted.equations.y for fitted in patches])
    force = np.concatenate([fitted.equations.force_N for fitted in patches])
    lower = factor(block_diag(*(fitted.own for fitted in patches)) + modes @ modes.T)
    weights, lift = cho_solve((lower, True), y), cho_solve((lower, True), force)
    compliance = spread = own = 0.0
    told = float(force @ lift)
    if yielding and told > 0.0:
        spread = 1.0 / told
        compliance = spread * float(lift @ y)
        own = max(spread - float(np.sum((spread * lift @ modes) ** 2)), 0.0)
        weights = weights - compliance * lift
    return Solution(patches, np.cumsum([0, *sizes[:-1]]), lower, weights, lift, compliance, spread, own)


def left_out_residuals(solution: Solution) -> np.ndarray:
    """(M,) each equation less what all the others predict, in deviations (Rasmussen and Williams, Eq. 5.12)."""
    half = solve_triangular(solution.lower, np.eye(len(solution.weights)), lower=True, check_finite=False)
    return solution.weights / np.sqrt(np.sum(half**2, axis=0))
