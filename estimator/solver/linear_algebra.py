"""Small dense linear algebra inside compiled functions: symmetric matrices of a few to a few dozen rows."""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.compiled import compiled
from vbaa_calib.core.lanes import LANES, load_from, spread, store_to

_LEAST_DAMPING = 1e-12
"""Added to the diagonal of scaled normal equations: a direction without information stays where it is."""
_SWEEPS = 12
"""Of Jacobi's rotations; four by four matrices are diagonal to the last digit after five."""


@compiled
def put(source, target):
    """Numbers (K,) into a place for as many: a slice's assignment takes long to compile."""
    for k in range(len(target)):
        target[k] = source[k]


@compiled
def fill(target, value):
    """One number into all places (K,)."""
    for k in range(len(target)):
        target[k] = value


@compiled
def factorise(information, first, size, damping, factor, scale):
    """Cholesky's upper factor of an information matrix, `size` rows from `first` on, scaled to a unit diagonal, with
    damping added.

    factor : (K, K), K a multiple of LANES; scale : (K,), filled from 0 on. What is no positive matrix gives NaN.
    """
    wide = (size + LANES - 1) // LANES * LANES
    for a in range(size):
        own = information[first + a, first + a]
        scale[a] = 1.0 / np.sqrt(own) if own > 0.0 else 1.0
    for a in range(size):
        for b in range(a, size):
            factor[a, b] = information[first + a, first + b] * scale[a] * scale[b]
        for b in range(size, wide):
            factor[a, b] = 0.0
        factor[a, a] += damping + _LEAST_DAMPING
    for k in range(size):
        own = factor[k, k]
        inverse = 1.0 / np.sqrt(own) if own > 0.0 else np.nan
        for b in range(k // LANES * LANES, wide, LANES):
            store_to(factor, inverse * load_from(factor, k, b), k, b)
        for a in range(k + 1, size):
            part = factor[k, a]
            for b in range(a // LANES * LANES, wide, LANES):
                store_to(factor, load_from(factor, a, b) - part * load_from(factor, k, b), a, b)


@compiled
def solve_factorised(factor, scale, size, right_side, step):
    """Step (size,) of normal equations that `factorise` has factorised."""
    for a in range(size):
        step[a] = right_side[a] * scale[a]
    for k in range(size):
        step[k] /= factor[k, k]
        part = step[k]
        for b in range(k + 1, size):
            step[b] -= factor[k, b] * part
    for k in range(size - 1, -1, -1):
        total = step[k]
        for b in range(k + 1, size):
            total -= factor[k, b] * step[b]
        step[k] = total / factor[k, k]
    for a in range(size):
        step[a] *= scale[a]


@compiled
def solve_many(factor, scale, size, sides, whole):
    """`solve_factorised` for right sides (size, C), in place, C a multiple of LANES; half the way where not `whole`."""
    for first in range(0, sides.shape[1], LANES):
        for k in range(size):
            row = (scale[k] / factor[k, k]) * load_from(sides, k, first)
            for b in range(k):
                row = row - (factor[b, k] / factor[k, k]) * load_from(sides, b, first)
            store_to(sides, row, k, first)
        if whole:
            for k in range(size - 1, -1, -1):
                row = load_from(sides, k, first)
                for b in range(k + 1, size):
                    row = row - factor[k, b] * load_from(sides, b, first)
                store_to(sides, (1.0 / factor[k, k]) * row, k, first)
            for k in range(size):
                store_to(sides, scale[k] * load_from(sides, k, first), k, first)


@compiled
def inner_products(columns, product, total):
    """The lower triangle of columnsᵀ · product, (M, K) both, K a multiple of LANES."""
    for a in range(0, len(total), LANES):
        for b in range(0, a + LANES, LANES):
            # eight sums side by side: one alone would wait for itself
            first, second, third, fourth = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
            fifth, sixth, seventh, eighth = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
            for j in range(len(product)):
                row = load_from(product, j, b)
                first = first + columns[j, a] * row
                second = second + columns[j, a + 1] * row
                third = third + columns[j, a + 2] * row
                fourth = fourth + columns[j, a + 3] * row
                fifth = fifth + columns[j, a + 4] * row
                sixth = sixth + columns[j, a + 5] * row
                seventh = seventh + columns[j, a + 6] * row
                eighth = eighth + columns[j, a + 7] * row
            store_to(total, first, a, b)
            store_to(total, second, a + 1, b)
            store_to(total, third, a + 2, b)
            store_to(total, fourth, a + 3, b)
            store_to(total, fifth, a + 4, b)
            store_to(total, sixth, a + 5, b)
            store_to(total, seventh, a + 6, b)
            store_to(total, eighth, a + 7, b)


@compiled
def symmetric_eigen(matrix, values, vectors):
    """Eigenvalues (K,), lowest first, and eigenvectors, the columns (K, K), by Jacobi's rotations. Spoils it."""
    size = len(values)
    vectors[:] = 0.0
    for a in range(size):
        vectors[a, a] = 1.0
    for _ in range(_SWEEPS):
        beside, whole = 0.0, 0.0
        for a in range(size):
            whole += matrix[a, a] * matrix[a, a]
            for b in range(a):
                beside += matrix[a, b] * matrix[a, b]
        if not beside > 1e-36 * whole:
            break
        for a in range(size - 1):
            for b in range(a + 1, size):
                _rotate(matrix, vectors, a, b)
    for a in range(size):
        values[a] = matrix[a, a]
    for a in range(size - 1):
        least = a
        for b in range(a + 1, size):
            if values[b] < values[least]:
                least = b
        if least != a:
            values[a], values[least] = values[least], values[a]
            for k in range(size):
                vectors[k, a], vectors[k, least] = vectors[k, least], vectors[k, a]


@compiled
def _rotate(matrix, vectors, a, b):
    """The rotation that makes one pair of entries zero."""
    size, beside = len(matrix), matrix[a, b]
    if beside == 0.0:
        return
    half = (matrix[b, b] - matrix[a, a]) / (2.0 * beside)
    tangent = 1.0 / (abs(half) + np.sqrt(1.0 + half * half))
    tangent = -tangent if half < 0.0 else tangent
    cos = 1.0 / np.sqrt(1.0 + tangent * tangent)
    sin = tangent * cos
    for k in range(size):
        first, second = matrix[k, a], matrix[k, b]
        matrix[k, a], matrix[k, b] = cos * first - sin * second, sin * first + cos * second
    for k in range(size):
        first, second = matrix[a, k], matrix[b, k]
        matrix[a, k], matrix[b, k] = cos * first - sin * second, sin * first + cos * second
    for k in range(size):
        first, second = vectors[k, a], vectors[k, b]
        vectors[k, a], vectors[k, b] = cos * first - sin * second, sin * first + cos * second
