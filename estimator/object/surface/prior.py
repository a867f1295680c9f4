"""How smooth a patch is: the most probable prior of its shape, from its own touches (evidence maximisation)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, solve_triangular
from scipy.optimize import minimize

from .equations import Equations
from .kernel import Prior, covariance, covariance_by_log_length, pairs, trend
from .solution import factor

_MOST_EQUATIONS = 480  # more are thinned for this search: three numbers need no more
_INCLINE = 2.0  # prior standard deviation of the trend's slope over the tangent plane: any that a patch may have
# before the data: logarithms of length and amplitude over the patch's extent, and of the tangents' slack in rad; the
# standard deviations of these logarithms; and their bounds
_BEST, _WIDTH = np.log([0.7, 0.2, 0.01]), np.array([1.2, 1.5, 1.5])
_LOWEST, _HIGHEST = np.log([0.03, 1e-4, 1e-4]), np.log([30.0, 100.0, 3.0])
_ROUGHER = 1e-4
# Newton's steps after the search, the step of their differences, and the longest that is believed: a prior that hangs
# on where a search stopped moves the surface by parts of its deviation
_POLISHING, _STEP, _NEAR = 2, 1e-3, 0.5


def learn_prior(
    equations: Equations, extent_m: float, start: tuple[Prior, float] | None, yield_per_N: float
) -> tuple[Prior, float]:
    """The most probable prior of the shape and slack of the tangents, rad; `start` is where an earlier search ended.

    `extent_m` is the patch's, `yield_per_N` the largest compliance to think of, m/N; zero where there is none.
    """
    extent_m = max(extent_m, 1e-3)
    count = min(len(equations), _MOST_EQUATIONS)
    # at random: evenly spaced ones of strokes that repeat would all lie at the same places
    thin = np.sort(np.random.default_rng(0).choice(len(equations), count, replace=False))
    rows, y, slack = equations.rows.select(thin), equations.y[thin], equations.slack[thin]
    between = pairs(rows, rows)
    modes = np.column_stack([equations.modes[thin], yield_per_N * equations.force_N[thin]])
    fixed = equations.noise[np.ix_(thin, thin)] + modes @ modes.T
    free = 3 if slack.any() else 2

    def prior_of(logs: np.ndarray) -> tuple[Prior, float]:
        length, amplitude, turn = np.exp(np.clip(np.concatenate([logs, _BEST[len(logs) :]]), _LOWEST, _HIGHEST))
        return Prior(length * extent_m, amplitude * extent_m, 10 * extent_m, _INCLINE), float(turn)

    def improbability(logs: np.ndarray) -> tuple[float, np.ndarray]:
        """What is to be least, and its slope (Rasmussen and Williams, Eqs. 2.43 and 5.9).

        The trend's variance is so large that in one sum with the rest it would take half of the digits.
        """
        prior, turn = prior_of(logs)
        shape = covariance(between, replace(prior, offset_m=0.0, incline=0.0))
        doubt = (turn * slack) ** 2
        whole = shape + fixed + np.diag(doubt)
        try:
            lower = factor(whole)
        except LinAlgError:
            # a search that meets a wall stops there: somewhat rougher numbers lead on
            lower = np.linalg.cholesky(whole + _ROUGHER * np.diag(np.diag(whole)))
        columns = np.column_stack([np.eye(count), trend(rows, prior), y])
        white = solve_triangular(lower, columns, lower=True, check_finite=False)
        inverse, lines, seen = white[:, :count], white[:, count:-1], white[:, -1]
        inner = np.linalg.cholesky(np.eye(lines.shape[1]) + lines.T @ lines)
        course = cho_solve((inner, True), lines.T @ seen)
        rest = seen - lines @ course
        weights = inverse.T @ rest
        unlikely = 0.5 * float(rest @ rest + course @ course)
        unlikely += float(np.log(np.diag(lower)).sum() + np.log(np.diag(inner)).sum())
        along = solve_triangular(inner, lines.T @ inverse, lower=True)
        left = inverse.T @ inverse - along.T @ along - np.outer(weights, weights)
        by_length = np.sum(left * covariance_by_log_length(between, prior))
        slopes = np.array([by_length, 2.0 * np.sum(left * shape), 2.0 * np.diag(left) @ doubt])
        away = (logs - _BEST[:free]) / _WIDTH[:free]
        return unlikely + 0.5 * float(away @ away), 0.5 * slopes[:free] + away / _WIDTH[:free]

    first, low, high = _BEST[:free], _LOWEST[:free], _HIGHEST[:free]
    if start is not None:
        first = np.log([start[0].length_m / extent_m, start[0].amplitude_m / extent_m, start[1]])[:free]
    bounds = list(zip(low, high, strict=True))
    found = minimize(improbability, np.clip(first, low, high), jac=True, method="L-BFGS-B", bounds=bounds)
    return prior_of(_newton(found.x, lambda logs: improbability(logs)[1]))


def _newton(logs: np.ndarray, slope_at: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Where the slope is zero, by Newton's steps: the search stops where the improbability is lost in its rounding."""
    low, high = _LOWEST[: len(logs)], _HIGHEST[: len(logs)]
    for _ in range(_POLISHING):
        inside = np.flatnonzero((logs > low) & (logs < high - _STEP))
        if not len(inside):
            break
        slope, moves = slope_at(logs), _STEP * np.eye(len(logs))[inside]
        bend = np.array([(slope_at(logs + move) - slope)[inside] / _STEP for move in moves])
        bend = 0.5 * (bend + bend.T)
        if np.linalg.eigvalsh(bend)[0] <= 0.0:
            break
        step = np.linalg.solve(bend, -slope[inside])
        if np.abs(step).max() > _NEAR:
            break
        logs = logs.copy()
        logs[inside] += step
    return np.clip(logs, low, high)
