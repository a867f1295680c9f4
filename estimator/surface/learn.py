"""How smooth a patch is, and how far its tangents can be trusted: by the likelihood of what was measured."""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, solve_triangular
from scipy.optimize import minimize

from .equations import Equations
from .kernel import Prior, covariance, pairs
from .solution import factor

MOST_EQUATIONS = 480
"""More are thinned for this search: three numbers need no more."""
INCLINE = 2.0
"""Prior standard deviation of the trend's slope over the tangent plane: any that a patch may have, and more."""
BEST = np.log([0.7, 0.2, 0.01])
"""Before the data: the length and the amplitude over the patch's extent, the tangents' slack in rad ..."""
WIDTH = np.array([1.2, 1.5, 1.5])
"""... and the standard deviations of their logarithms."""
LOWEST, HIGHEST = np.log([0.03, 1e-4, 1e-4]), np.log([30.0, 100.0, 3.0])


def learn(
    equations: Equations, extent_m: float, start: tuple[Prior, float] | None, yield_per_N: float
) -> tuple[Prior, float]:
    """The most probable prior of the shape and slack of the tangents, rad.

    Parameters
    ----------
    extent_m : of the patch. start : where to begin, from an earlier search.
    yield_per_N : the largest compliance to think of, m/N; zero where there is none.
    """
    extent_m = max(extent_m, 1e-3)
    count = min(len(equations), MOST_EQUATIONS)
    # at random: evenly spaced ones of strokes that repeat would all lie at the same places
    thin = np.sort(np.random.default_rng(0).choice(len(equations), count, replace=False))
    rows = type(equations.rows)(*(values[thin] for values in vars(equations.rows).values()))
    between, y, slack = pairs(rows, rows), equations.y[thin], equations.slack[thin]
    modes = np.column_stack([equations.modes[thin], yield_per_N * equations.force_N[thin]])
    fixed = equations.noise[np.ix_(thin, thin)] + modes @ modes.T
    free = 3 if slack.any() else 2

    def prior_of(logs: np.ndarray) -> tuple[Prior, float]:
        length, amplitude, turn = np.exp(np.clip(np.concatenate([logs, BEST[len(logs) :]]), LOWEST, HIGHEST))
        return Prior(length * extent_m, amplitude * extent_m, 10 * extent_m, INCLINE), float(turn)

    def improbability(logs: np.ndarray) -> float:
        prior, turn = prior_of(logs)
        try:
            lower = factor(covariance(between, prior) + fixed + np.diag((turn * slack) ** 2))
        except LinAlgError:
            return np.inf
        white = solve_triangular(lower, y, lower=True, check_finite=False)
        unlikely = 0.5 * float(white @ white) + float(np.log(np.diag(lower)).sum())
        return unlikely + 0.5 * float(np.sum(((logs - BEST[:free]) / WIDTH[:free]) ** 2))

    first = BEST[:free]
    if start is not None:
        prior, turn = start
        first = np.log([prior.length_m / extent_m, prior.amplitude_m / extent_m, turn])[:free]
    simplex = np.vstack([first, first + np.diag([0.7, 0.7, 1.0])[:free, :free] * (0.4 if start else 1.0)])
    found = minimize(
        improbability,
        first,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.08, "fatol": 0.05, "maxfev": 120},
    )
    return prior_of(found.x)
