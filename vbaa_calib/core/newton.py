"""Newton's method for one small system of equations, compiled into the kernel that needs it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .compiled import kernel

_DIFFERENCE = -1e-7
"""Backward, so that a variable at its upper limit is still differentiated from the allowed side."""
_HALVINGS, _ITERATIONS = 8, 30
_SINGULAR, _DAMPING = 1e-14, 1e-12
"""Of the matrix' largest number, and of its square."""

Newton = Callable[[Any, np.ndarray, np.ndarray, np.ndarray, float], float]
Slopes = Callable[[Any, np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]


def newton_for(residual: Callable[[Any, np.ndarray, np.ndarray], None]) -> Newton:
    """Damped Newton with difference quotients for n equations, a kernel.

    Parameters
    ----------
    residual : kernel (problem, x (n,), values (n,)) that writes the values. Variables and residuals are scaled by the
        caller so that 1 is a typical size.

    Returns
    -------
    kernel (problem, x (n,), lower (n,), upper (n,), tolerance) → float. x is where to start, and is overwritten by the
    solution; the limits cut off steps; the tolerance is on the largest absolute residual, which is returned, inf where
    one is not finite. A system that did not converge stays as it stands: the caller compares with the tolerance.
    """
    differentiate = slopes_of(residual)

    @kernel
    def newton(problem: Any, x: np.ndarray, lower: np.ndarray, upper: np.ndarray, tolerance: float) -> float:
        n = len(x)
        values, others, trial, step, slopes = np.empty(n), np.empty(n), np.empty(n), np.empty((n, 1)), np.empty((n, n))
        for i in range(n):
            x[i] = min(max(x[i], lower[i]), upper[i])
        residual(problem, x, values)
        size = largest(values)
        for _ in range(_ITERATIONS):
            if size <= tolerance or not np.isfinite(size):
                break
            differentiate(problem, x, values, slopes, others)
            for i in range(n):
                step[i, 0] = -values[i]
            if not solve(slopes, step):
                break
            better = False
            for halving in range(_HALVINGS):
                for i in range(n):
                    trial[i] = min(max(x[i] + 0.5**halving * step[i, 0], lower[i]), upper[i])
                residual(problem, trial, others)
                now = largest(others)
                better = now < size
                if better:
                    x[:], values[:], size = trial, others, now
                    break
            if not better:
                break
        return size

    return newton


def slopes_of(residual: Callable[[Any, np.ndarray, np.ndarray], None]) -> Slopes:
    """Difference quotients of a residual, a kernel.

    Returns
    -------
    kernel (problem, x (n,), values (m,), slopes (m, n), others (m,)) that writes the slopes at x, where the residual
    has these values; `others` is scratch.
    """

    @kernel
    def differentiate(problem: Any, x: np.ndarray, values: np.ndarray, slopes: np.ndarray, others: np.ndarray) -> None:
        for j in range(len(x)):
            kept = x[j]
            x[j] = kept + _DIFFERENCE
            residual(problem, x, others)
            x[j] = kept
            for i in range(len(values)):
                slopes[i, j] = (others[i] - values[i]) / _DIFFERENCE

    return differentiate


@kernel
def largest(values: np.ndarray) -> float:
    """The largest absolute value, inf where one is not finite."""
    size = 0.0
    for value in values:
        if not np.isfinite(value):
            return np.inf
        size = max(size, abs(value))
    return size


@kernel
def solve(matrix: np.ndarray, right: np.ndarray) -> bool:
    """Overwrite `right` (n, k) with x, where matrix (n, n) · x = right; of a singular matrix with the least squares' x.

    Returns
    -------
    bool : False where something is not finite; `right` is as it was then.
    """
    n, k = right.shape
    x = right.copy()
    if not _eliminate(matrix.copy(), x):
        # a trace of damping gives what the pseudo-inverse would
        squared, x[:] = np.zeros((n, n)), 0.0
        damping = _DAMPING * np.abs(matrix).max() ** 2
        for i in range(n):
            squared[i, i] = damping
            for row in range(n):
                for j in range(n):
                    squared[i, j] += matrix[row, i] * matrix[row, j]
                for j in range(k):
                    x[i, j] += matrix[row, i] * right[row, j]
        if not _eliminate(squared, x):
            return False
    right[:] = x
    return True


@kernel
def _eliminate(matrix: np.ndarray, right: np.ndarray) -> bool:
    """Gauss with pivots, in place of `right`; False where the matrix is singular or not finite."""
    n, k = right.shape
    least = _SINGULAR * np.abs(matrix).max()
    for column in range(n):
        pivot = column
        for row in range(column + 1, n):
            if abs(matrix[row, column]) > abs(matrix[pivot, column]):
                pivot = row
        best = matrix[pivot, column]
        if not (least < abs(best) < np.inf):
            return False
        if pivot != column:
            for j in range(column, n):
                matrix[column, j], matrix[pivot, j] = matrix[pivot, j], matrix[column, j]
            for j in range(k):
                right[column, j], right[pivot, j] = right[pivot, j], right[column, j]
        for row in range(column + 1, n):
            factor = matrix[row, column] / best
            for j in range(column + 1, n):
                matrix[row, j] -= factor * matrix[column, j]
            for j in range(k):
                right[row, j] -= factor * right[column, j]
    for row in range(n - 1, -1, -1):
        for j in range(k):
            for i in range(row + 1, n):
                right[row, j] -= matrix[row, i] * right[i, j]
            right[row, j] /= matrix[row, row]
    return bool(np.isfinite(right).all())
