"""How smooth a patch is, and how far its tangents can be trusted: by the likelihood of what was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, solve_triangular
from scipy.optimize import minimize

from .equations import Equations
from .kernel import Prior, by_log_length, covariance, pairs, trend
from .solution import factor

MOST_EQUATIONS = 480
"""More are thinned for this search: three numbers need no more."""
INCLINE = 2.0
"""Prior standard deviation of the trend's slope over the tangent plane: any that a patch may have, and more."""
BEST = np.log([0.7, 0.2, 0.01])
"""Before the data: the length and the amplitude over the patch's extent, the tangents' slack in rad ..."""
WIDTH = np.array([1.2, 1.5, 1.5])
"""... and the standard deviations of their logarithms."""
ROUGHER = 1e-4
POLISHING, STEP, NEAR = 2, 1e-3, 0.5
"""Newton's steps after the search, the step of their differences, and the longest that is believed: a prior that hangs
on where a search stopped moves the surface by parts of its deviation."""
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
            lower = np.linalg.cholesky(whole + ROUGHER * np.diag(np.diag(whole)))
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
        slopes = [np.sum(left * by_log_length(between, prior)), 2.0 * np.sum(left * shape), 2.0 * np.diag(left) @ doubt]
        away = (logs - BEST[:free]) / WIDTH[:free]
        return unlikely + 0.5 * float(away @ away), 0.5 * np.array(slopes[:free]) + away / WIDTH[:free]

    first = BEST[:free]
    if start is not None:
        prior, turn = start
        first = np.log([prior.length_m / extent_m, prior.amplitude_m / extent_m, turn])[:free]
    found = minimize(
        improbability,
        np.clip(first, LOWEST[:free], HIGHEST[:free]),
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(LOWEST[:free], HIGHEST[:free], strict=True)),
    )
    return prior_of(_polished(found.x, lambda logs: improbability(logs)[1]))


def _polished(logs: np.ndarray, slope_at: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Where the slope is zero, by Newton's steps: the search stops where the improbability is lost in its rounding."""
    for _ in range(POLISHING):
        inside = np.flatnonzero((logs > LOWEST[: len(logs)]) & (logs < HIGHEST[: len(logs)] - STEP))
        if not len(inside):
            break
        slope, moves = slope_at(logs), STEP * np.eye(len(logs))[inside]
        bend = np.array([(slope_at(logs + move) - slope)[inside] / STEP for move in moves])
        bend = 0.5 * (bend + bend.T)
        if np.linalg.eigvalsh(bend)[0] <= 0.0:
            break
        step = np.linalg.solve(bend, -slope[inside])
        if np.abs(step).max() > NEAR:
            break
        logs = logs.copy()
        logs[inside] += step
    return np.clip(logs, LOWEST[: len(logs)], HIGHEST[: len(logs)])
