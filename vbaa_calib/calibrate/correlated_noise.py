"""How far a least-squares estimate may be off when neighbouring readings err together.

The readings' errors are taken as s² [(1 − ν) exp(−|Δx|/λ) + ν δ]: errors that die out over the length λ (a gauge's
bearing, a guide rail, a bow the model leaves out) and a share ν of plain scatter. Neither is known and 30 readings tell
little about them, so they are not fitted but summed over, each pair weighted with its restricted likelihood. Errors
that stay together over half of the table or more look like bending and are beyond any such account: 95 % intervals
then cover 85 to 90 %.

The estimate itself stays plain least squares: for smooth regressors it is nearly as good as the weighted one, and it
does not depend on the correlation that is guessed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import brentq
from scipy.stats import t as student

_LENGTHS = 8
_LEVEL = 0.95
_PLAIN_SHARES = (0.0, 0.2)
_PLAIN_ONLY = 0.6
"""Prior probability of no correlation. By sampling: less of it overstates the std of plain scatter by half and more,
more of it understates that of correlated errors."""


@dataclass(frozen=True, eq=False)
class ErrorModels:
    """K models of the readings' errors and what each says about P least-squares parameters.

    Attributes
    ----------
    weights : (K,) probabilities, adding up to 1.
    lengths_m : (K,) correlation length λ; 0 for plain scatter.
    covariances : (K, P, P) of the least-squares estimate.
    freedom : N − P, degrees of freedom of every one of them.
    """

    weights: np.ndarray
    lengths_m: np.ndarray
    covariances: np.ndarray
    freedom: int

    @property
    def covariance(self) -> np.ndarray:
        """(P, P) mean over the models."""
        return np.einsum("k,kij->ij", self.weights, self.covariances)

    @property
    def length_m(self) -> float:
        """The weighted median of the correlation length."""
        order = np.argsort(self.lengths_m)
        at = int(np.searchsorted(np.cumsum(self.weights[order]), 0.5))
        return float(self.lengths_m[order[min(at, len(order) - 1)]])

    def half_width(self, direction: np.ndarray, other_std: float) -> float:
        """Half the 95 % interval of direction @ parameters, with an independent error of known std added.

        direction : (P,). Student's t under every model, with Welch and Satterthwaite's degrees of freedom for the sum.
        """
        own = np.einsum("i,kij,j->k", direction, self.covariances, direction)
        scale = np.sqrt(own + other_std**2)
        if not scale.any():
            return 0.0
        freedom = self.freedom * (scale**2 / np.maximum(own, 1e-30 * scale.max() ** 2)) ** 2
        tail = 0.5 + 0.5 * _LEVEL

        def excess(half: float) -> float:
            return float(self.weights @ student.cdf(half / scale, freedom)) - tail

        widest = float(scale.max() * student.ppf(tail, self.freedom))
        return float(brentq(excess, 0.0, widest * (1.0 + 1e-9)))


def error_models(x_m: np.ndarray, design: np.ndarray, residuals_m: np.ndarray, least_std_m: float) -> ErrorModels:
    """Weigh the error models by the residuals (N,) of a least-squares fit with the design matrix (N, P), N > P.

    λ runs log-uniformly from half the typical spacing to the whole span of x (N,), beyond which it cannot be told from
    the parameters; `least_std_m` bounds the readings' standard deviation from below.
    """
    count, parameters = design.shape
    inverse = np.linalg.pinv(design)
    pairs = [(0.0, 1.0)]
    priors = np.full(1 + _LENGTHS * len(_PLAIN_SHARES), (1.0 - _PLAIN_ONLY) / (_LENGTHS * len(_PLAIN_SHARES)))
    priors[0] = _PLAIN_ONLY
    span, spacing = np.ptp(x_m), np.median(np.diff(x_m))
    for length in np.geomspace(0.5 * spacing, span, _LENGTHS):
        pairs += [(float(length), share) for share in _PLAIN_SHARES]
    weighed = [
        _weigh(_correlation(x_m, length, share), design, residuals_m, inverse, least_std_m) for length, share in pairs
    ]
    log_weights = np.log(priors) + [log_weight for log_weight, _ in weighed]
    weights = np.exp(log_weights - log_weights.max())
    return ErrorModels(
        weights / weights.sum(),
        np.array([length for length, _ in pairs]),
        np.array([covariance for _, covariance in weighed]),
        count - parameters,
    )


def neighbour_correlation(residuals: np.ndarray) -> float:
    """Correlation of each residual (N,) with the next; 0 where there are none."""
    square = float(residuals @ residuals)
    return float(residuals[1:] @ residuals[:-1]) / square if square > 0.0 else 0.0


def _correlation(x_m: np.ndarray, length_m: float, plain_share: float) -> np.ndarray:
    if length_m == 0.0:
        return np.eye(len(x_m))
    apart = np.abs(x_m[:, None] - x_m)
    # 1e-9: places that all but coincide must not make it singular
    return (1.0 - plain_share) * np.exp(-apart / length_m) + (plain_share + 1e-9) * np.eye(len(x_m))


def _weigh(
    correlation: np.ndarray, design: np.ndarray, residuals_m: np.ndarray, inverse: np.ndarray, least_std_m: float
) -> tuple[float, np.ndarray]:
    """Restricted log-likelihood of one model, the scale integrated out, and its covariance (P, P) of the estimate."""
    lower = np.linalg.cholesky(correlation)
    weighted = cho_solve((lower, True), design)
    normal = design.T @ weighted
    left = residuals_m - design @ np.linalg.solve(normal, weighted.T @ residuals_m)
    freedom = len(residuals_m) - design.shape[1]
    variance = float(left @ cho_solve((lower, True), left)) / freedom
    variance = max(variance, least_std_m**2, np.finfo(float).tiny)
    log_weight = -np.log(lower.diagonal()).sum() - 0.5 * np.linalg.slogdet(normal)[1] - 0.5 * freedom * np.log(variance)
    return float(log_weight), variance * inverse @ correlation @ inverse.T
