"""Newton's method for many small systems at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Residual = Callable[[np.ndarray, np.ndarray], np.ndarray]

_DIFFERENCE = -1e-7
"""Backward, so that a variable at its upper limit is still differentiated from the allowed side."""
_HALVINGS = 8


def newton(
    residual: Residual,
    start: np.ndarray,
    *,
    tolerance: float,
    lower: np.ndarray | float = -np.inf,
    upper: np.ndarray | float = np.inf,
    iterations: int = 30,
) -> tuple[np.ndarray, np.ndarray]:
    """Solve B independent systems of n equations by damped Newton with difference quotients.

    Parameters
    ----------
    residual : (x (A, n), rows (A,)) → (A, n); `rows` says to which system each row of x belongs. Variables and
        residuals are scaled by the caller so that 1 is a typical size.
    start : (B, n).
    tolerance : on the largest absolute residual of a system.
    lower, upper : limits on the variables, broadcast to (B, n); steps are cut off there.

    Returns
    -------
    solution (B, n) and its largest absolute residual (B,). Systems that did not converge are returned as they stand:
    the caller compares with the tolerance. A residual that is not finite counts as infinite.
    """
    lower, upper = np.broadcast_to(lower, start.shape), np.broadcast_to(upper, start.shape)
    solution = np.clip(start, lower, upper)
    with np.errstate(over="ignore", invalid="ignore"):
        return _iterate(residual, solution, tolerance, lower, upper, iterations)


def _iterate(
    residual: Residual, solution: np.ndarray, tolerance: float, lower: np.ndarray, upper: np.ndarray, iterations: int
) -> tuple[np.ndarray, np.ndarray]:
    values = residual(solution, np.arange(len(solution)))
    size = _size(values)
    for _ in range(iterations):
        rows = np.flatnonzero((size > tolerance) & np.isfinite(size))
        if rows.size == 0:
            break
        step = _newton_step(residual, solution[rows], values[rows], rows)
        stuck = np.ones(rows.size, bool)
        for halving in range(_HALVINGS):
            at = np.flatnonzero(stuck)
            trial = np.clip(solution[rows[at]] + 0.5**halving * step[at], lower[rows[at]], upper[rows[at]])
            trial_values = residual(trial, rows[at])
            better = _size(trial_values) < size[rows[at]]
            winners = rows[at[better]]
            solution[winners], values[winners] = trial[better], trial_values[better]
            size[winners] = _size(trial_values[better])
            stuck[at[better]] = False
            if not stuck.any():
                break
        if stuck.all():
            break
    return solution, size


def _size(values: np.ndarray) -> np.ndarray:
    size = np.abs(values).max(axis=1, initial=0.0)
    return np.where(np.isfinite(size), size, np.inf)


def _newton_step(residual: Residual, x: np.ndarray, values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    count, n = x.shape
    moved = (x[None] + _DIFFERENCE * np.eye(n)[:, None]).reshape(n * count, n)
    quotient = (residual(moved, np.tile(rows, n)).reshape(n, count, n) - values) / _DIFFERENCE
    jacobian = np.moveaxis(quotient, 0, -1)
    usable = np.isfinite(jacobian).all(axis=(1, 2))
    step = np.zeros_like(x)
    # the pseudo-inverse never raises: a singular system just fails to improve
    step[usable] = -np.einsum("bij,bj->bi", np.linalg.pinv(jacobian[usable]), values[usable])
    return step
