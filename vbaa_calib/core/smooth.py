"""A smooth curve through points of which some are wrong: cubic B-splines, a penalty on bends, robust weights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

TABLE = 256
"""Rows of the tabled basis, linear in between. So small that no matrix product is worth a thread of the linear algebra
library, which would cost more than the product."""
_PLACES = np.linspace(0.0, 1.0, TABLE)


@lru_cache(maxsize=8)
def _basis(pieces: int) -> np.ndarray:
    """(TABLE, pieces + 3) uniform cubic B-splines over [0, 1]."""
    at = np.linspace(0.0, pieces, TABLE)
    first = np.minimum(at.astype(int), pieces - 1)
    t = at - first
    values = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1) / 6
    table = np.zeros((TABLE, pieces + 3))
    np.put_along_axis(table, first[:, None] + np.arange(4), values, axis=1)
    return table


@lru_cache(maxsize=8)
def _bending(pieces: int) -> np.ndarray:
    """(pieces + 3, pieces + 3) sum of the squared second differences of the coefficients."""
    second = np.diff(np.eye(pieces + 3), 2, axis=0)
    return second.T @ second


@dataclass(frozen=True, eq=False)
class _Smooth:
    """A fitted curve: its values at the N places that were given, and its `coefficients`."""

    values: np.ndarray
    coefficients: np.ndarray

    def at(self, share: np.ndarray) -> np.ndarray:
        """Values at other places, given as fractions (M,) of the way."""
        return np.interp(share, _PLACES, _basis(len(self.coefficients) - 3) @ self.coefficients)


def rows(share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) rows of the tabled basis before places (N,) in [0, 1], and the part of the way to the next row."""
    place = np.clip(share, 0.0, 1.0) * (TABLE - 1)
    row = np.minimum(place.astype(np.intp), TABLE - 2)
    return row, place - row


def _summed(values: np.ndarray, row: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(TABLE,) sums of values (N,), each divided between the rows beside its place."""
    after = values * part
    total = np.bincount(row, values - after, TABLE)
    total[1:] += np.bincount(row, after, TABLE - 1)
    return total


def fit(
    share: np.ndarray,
    values: np.ndarray,
    weights: np.ndarray,
    scales: tuple[float, ...],
    pieces: int,
    stiffness: float,
) -> _Smooth:
    """Weighted fit with Cauchy weights whose scale shrinks from one round to the next.

    Parameters
    ----------
    share : (N,) places as fractions of the way.
    values, weights : (N,) what was measured there, and how far to trust it before any residual is seen.
    scales : residual at which a point counts half, one round each, in the unit of `values`.
    stiffness : of the penalty on bends, as a fraction of the mean weight of a coefficient.
    """
    table, (row, part) = _basis(pieces), rows(share)
    penalty = stiffness * (weights.sum() / (pieces + 3) + 1e-12) * _bending(pieces) + 1e-9 * np.eye(pieces + 3)
    trusted, curve = weights, np.zeros(len(share))
    coefficients = np.zeros(pieces + 3)
    for scale in scales:
        total, summed = _summed(trusted, row, part), _summed(trusted * values, row, part)
        coefficients = np.linalg.solve((table * total[:, None]).T @ table + penalty, summed @ table)
        curve = np.interp(share, _PLACES, table @ coefficients)
        trusted = weights / (1.0 + ((values - curve) / scale) ** 2)
    return _Smooth(curve, coefficients)


def quantile(values: np.ndarray, share: float) -> float:
    """The number below which a share of values (N,), N > 0, lies; NumPy's care for axes costs more than sorting."""
    place = min(int(share * values.size), values.size - 1)
    return float(np.partition(values, place, axis=None)[place])


def median(values: np.ndarray) -> float:
    """The upper median of values (N,), N > 0."""
    return quantile(values, 0.5)
