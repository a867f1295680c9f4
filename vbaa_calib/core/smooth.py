"""A smooth curve through points of which some are wrong: cubic B-splines, a penalty on bends, robust weights.

And what goes with it: running means, quantiles, small systems of equations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .compiled import kernel

TABLE = 256
"""Rows of the tabled splines, linear in between: a curve costs no more, however many points it goes through."""
ZEROS, END_VALUE, MIRRORED = 0, 1, 2
"""What a running mean takes to be beyond the ends."""


class _Smooth(NamedTuple):
    """A fitted curve: its values (N,) at the places that were given, and its values (TABLE,) all along."""

    values: np.ndarray
    table: np.ndarray


@kernel
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
    unknowns = pieces + 3
    row, part = np.empty(len(share), np.int64), np.empty(len(share))
    for n in range(len(share)):
        row[n], part[n] = _row(share[n])
    bending = stiffness * (weights.sum() / unknowns + 1e-12)
    trusted, curve, table = weights.copy(), np.empty(len(share)), np.empty(TABLE)
    spline = np.empty(4)
    for scale in scales:
        total, summed = np.zeros(TABLE), np.zeros(TABLE)
        for n in range(len(share)):
            near, far = trusted[n] * (1.0 - part[n]), trusted[n] * part[n]
            total[row[n]] += near
            total[row[n] + 1] += far
            summed[row[n]] += near * values[n]
            summed[row[n] + 1] += far * values[n]
        band, side = _bending(unknowns, bending), np.zeros(unknowns)
        for r in range(TABLE):
            first = _splines(r, pieces, spline)
            for i in range(4):
                side[first + i] += summed[r] * spline[i]
                for j in range(i + 1):
                    band[first + i, i - j] += total[r] * spline[i] * spline[j]
        _solve_band(band, side)
        for r in range(TABLE):
            first = _splines(r, pieces, spline)
            table[r] = 0.0
            for i in range(4):
                table[r] += spline[i] * side[first + i]
        for n in range(len(share)):
            curve[n] = table[row[n]] + (table[row[n] + 1] - table[row[n]]) * part[n]
            trusted[n] = weights[n] / (1.0 + ((values[n] - curve[n]) / scale) ** 2)
    return _Smooth(curve, table)


@kernel
def at(curve: _Smooth, share: np.ndarray) -> np.ndarray:
    """Values at other places, given as fractions (M,) of the way."""
    values = np.empty(len(share))
    for n in range(len(share)):
        row, part = _row(share[n])
        values[n] = curve.table[row] + (curve.table[row + 1] - curve.table[row]) * part
    return values


@kernel
def _row(share: float) -> tuple[int, float]:
    """Row of the table before a place in [0, 1], and the part of the way to the next."""
    place = min(max(share, 0.0), 1.0) * (TABLE - 1)
    row = min(max(int(place), 0), TABLE - 2)
    return row, place - row


@kernel
def _splines(row: int, pieces: int, values: np.ndarray) -> int:
    """The four cubic B-splines that are not zero in a row of the table, into `values`; which is the first of them."""
    place = row * (pieces / (TABLE - 1.0))
    first = min(int(place), pieces - 1)
    t = place - first
    values[0] = (1.0 - t) ** 3 / 6.0
    values[1] = (3.0 * t**3 - 6.0 * t**2 + 4.0) / 6.0
    values[2] = (-3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0) / 6.0
    values[3] = t**3 / 6.0
    return first


@kernel
def _bending(unknowns: int, stiffness: float) -> np.ndarray:
    """(unknowns, 4) lower band, the diagonal first, of the sum of the coefficients' squared second differences."""
    band = np.zeros((unknowns, 4))
    band[:, 0] = 1e-9
    weight = (1.0, -2.0, 1.0)
    for k in range(unknowns - 2):
        for i in range(3):
            for j in range(i + 1):
                band[k + i, i - j] += stiffness * weight[i] * weight[j]
    return band


@kernel
def _solve_band(band: np.ndarray, side: np.ndarray) -> None:
    """Solve a symmetric system, given by its lower band (M, 4), by L D Lᵀ; the solution replaces `side`."""
    count = len(side)
    for i in range(count):
        for k in range(3, 0, -1):  # column i − k
            if i - k < 0:
                continue
            for m in range(k + 1, min(4, i + 1)):
                band[i, k] -= band[i, m] * band[i - k, m - k] * band[i - m, 0]
            band[i, k] /= band[i - k, 0]
        for k in range(1, min(4, i + 1)):
            band[i, 0] -= band[i, k] ** 2 * band[i - k, 0]
            side[i] -= band[i, k] * side[i - k]
    for i in range(count):
        side[i] /= band[i, 0]
    for i in range(count - 1, -1, -1):
        for k in range(1, min(4, count - i)):
            side[i] -= band[i + k, k] * side[i + k]


@kernel
def solve(matrix: np.ndarray, sides: np.ndarray) -> None:
    """Solve a small symmetric positive system (M, M) for sides (M, S) by L D Lᵀ; matrix and sides are replaced.

    Only the matrix' lower half is read. The solutions take the place of `sides`.
    """
    count, several = sides.shape
    for i in range(count):
        for j in range(i):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k] * matrix[k, k]
            matrix[i, j] /= matrix[j, j]
        for k in range(i):
            matrix[i, i] -= matrix[i, k] ** 2 * matrix[k, k]
            for s in range(several):
                sides[i, s] -= matrix[i, k] * sides[k, s]
    for i in range(count - 1, -1, -1):
        for s in range(several):
            sides[i, s] /= matrix[i, i]
            for k in range(i + 1, count):
                sides[i, s] -= matrix[k, i] * sides[k, s]


@kernel
def running_mean(values: np.ndarray, size: int, beyond: int) -> np.ndarray:
    """(N,) mean of `size` neighbours each, of an even number one more before than after.

    beyond : `ZEROS`; `END_VALUE`, the last value again; `MIRRORED`.
    """
    count = len(values)
    means = np.empty(count)
    total = 0.0
    for k in range(-(size // 2), size - size // 2):
        total += _beyond(values, k, beyond)
    for n in range(count):
        means[n] = total / size
        total += _beyond(values, n + size - size // 2, beyond) - _beyond(values, n - size // 2, beyond)
    return means


@kernel
def triangle_sums(values: np.ndarray, count: int) -> np.ndarray:
    """Sums (N, M) over a triangle of neighbours whose weight in the middle is one."""
    rows, columns = values.shape
    for _ in range(2):
        total, sums = np.zeros(columns), np.empty((rows, columns))
        for n in range(min(count - count // 2, rows)):
            for m in range(columns):
                total[m] += values[n, m]
        for n in range(rows):
            entering, leaving = n + count - count // 2, n - count // 2
            for m in range(columns):
                sums[n, m] = total[m]
                if entering < rows:
                    total[m] += values[entering, m]
                if leaving >= 0:
                    total[m] -= values[leaving, m]
        values = sums
    return values / count


@kernel
def _beyond(values: np.ndarray, place: int, beyond: int) -> float:
    count = len(values)
    if 0 <= place < count:
        return float(values[place])
    if beyond == ZEROS:
        return 0.0
    if beyond == END_VALUE:
        return float(values[min(max(place, 0), count - 1)])
    folded = place % (2 * count)
    return float(values[min(folded, 2 * count - 1 - folded)])


@kernel
def quantile(values: np.ndarray, share: float) -> float:
    """The number below which a share of values (N,), N > 0, lies. What is no number comes last."""
    rest = values.ravel().copy()
    place = min(int(share * len(rest)), len(rest) - 1)
    low, high = 0, len(rest) - 1
    for k in range(high, -1, -1):
        if np.isnan(rest[k]):
            rest[k], rest[high] = rest[high], rest[k]
            high -= 1
    if place > high:
        return np.nan
    while low < high:
        pivot, i, j = rest[(low + high) // 2], low, high
        while i <= j:
            while rest[i] < pivot:
                i += 1
            while rest[j] > pivot:
                j -= 1
            if i <= j:
                rest[i], rest[j] = rest[j], rest[i]
                i, j = i + 1, j - 1
        if place <= j:
            high = j
        elif place >= i:
            low = i
        else:
            break
    return float(rest[place])


@kernel
def median(values: np.ndarray) -> float:
    """The upper median of values (N,), N > 0."""
    return quantile(values, 0.5)
