"""What a silhouette of known width shows: polynomials across it, blurred, and what profiles say of them and of it."""

from __future__ import annotations

from math import erfc

import numpy as np
from numpy.polynomial.legendre import leg2poly

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.smooth import triangle_sums

from .crossings import Crossings, distances, dot, remove_background, shares
from .line_shape import PER_PX

K = 4
"""Legendre polynomials that an antenna's reflectance across it is made of: level, brighter on one side, a highlight,
and that aside."""
G, Y, ALL = K + 3, K + 4, K + 5
"""Columns of a profile's normal equations: K coefficients; width, blur and taper; place; grey levels."""
MEAN_SQUARE = 1.0 / (2.0 * np.arange(K) + 1.0)
"""(K,) of the polynomials over the silhouette."""
PIXEL_BLUR_PX = 0.29
"""A pixel's own square, as a standard deviation."""
EDGES = 16
"""Places across a line at which an edge is tried in its stead."""
_EDGE_PX = 12
"""So far from an edge nothing of its blur is left."""
_FAR = 8.0
"""Deviations beyond an edge at which nothing is left of it."""
_POWERS = np.stack([np.pad(leg2poly(row[: k + 1]), (0, K - 1 - k)) for k, row in enumerate(np.eye(K))])


@kernel
def tables(width_px: float, blur_px: float, reach_px: int) -> tuple[np.ndarray, np.ndarray]:
    """The blurred polynomials and their derivatives (R, K), tabled as a cross-section is."""
    values = blurred(width_px, blur_px, reach_px)
    slopes, last = np.empty(values.shape), len(values) - 1
    for r in range(last + 1):
        before, after = max(r - 1, 0), min(r + 1, last)
        for k in range(K):
            slopes[r, k] = (values[after, k] - values[before, k]) * (PER_PX / (after - before))
    return values, slopes


@kernel
def blurred(width_px: float, blur_px: float, reach_px: int) -> np.ndarray:
    """(R, K) Legendre polynomials over the silhouette, blurred, at the table's distances from its centre.

    By the recurrence of the powers' convolution with a bell over an interval. Odd ones change their sign in the middle.
    """
    half, variance = 0.5 * width_px, blur_px**2 + PIXEL_BLUR_PX**2
    std = np.sqrt(variance)
    middle, height = reach_px * PER_PX, 1.0 / (np.sqrt(2.0 * np.pi) * std)
    values, powers, halves = np.zeros((2 * middle + 1, K)), np.empty(K), half ** np.arange(float(K))
    for r in range(middle + 1):
        across = r / PER_PX
        left, right = (across + half) / std, (across - half) / std
        if right > _FAR:
            break
        rising, falling = height * np.exp(-0.5 * left**2), height * np.exp(-0.5 * right**2)
        powers[0] = 0.5 * (erfc(-left / np.sqrt(2.0)) - erfc(-right / np.sqrt(2.0)))
        for k in range(K - 1):
            before = k * powers[k - 1] if k else 0.0
            ends = halves[k] * (falling + rising if k % 2 else falling - rising)
            powers[k + 1] = across * powers[k] + variance * (before - ends)
        for k in range(K):
            for i in range(k + 1):
                values[middle + r, k] += _POWERS[k, i] * powers[i] / halves[i]
            values[middle - r, k] = -values[middle + r, k] if k % 2 else values[middle + r, k]
    return values


@kernel
def _products(columns: np.ndarray, products: np.ndarray) -> None:
    """Sums of the products of rows (M, T), less the background's level and slope: into (M, M)."""
    several, length = columns.shape
    remove_background(columns)
    for i in range(several):
        for j in range(i + 1):
            total = 0.0
            for t in range(length):
                total += columns[i, t] * columns[j, t]
            products[i, j] = products[j, i] = total


@kernel
def normal_equations(
    found: Crossings, base: np.ndarray, silhouette: tuple[float, float], coefficients: np.ndarray, reach_px: int
) -> np.ndarray:
    """(N, K + 5, K + 5) products of every profile's columns, for lines at (N,) of some width and blur, px."""
    width_px, blur_px = silhouette
    count, length = found.profiles.shape
    values, slopes = tables(width_px, blur_px, reach_px)
    wider = (blurred(width_px * 1.02, blur_px, reach_px) - values) / 0.02
    softer = (blurred(width_px, blur_px * 1.02, reach_px) - values) / 0.02
    share, last = shares(found), len(values) - 1
    each, columns, across = np.zeros((count, ALL, ALL)), np.empty((ALL, length)), np.empty(length)
    for n in range(count):
        if not found.inside[n]:
            continue
        distances(found, n, base[n], across)
        by_place = -found.side[n] / found.stretch[n]
        for t in range(length):
            place = min(max(across[t] * PER_PX + 0.5 * last, 0.0), float(last))
            row = min(int(place), last - 1)
            far = place - row
            slope, width, blur = 0.0, 0.0, 0.0
            for k in range(K):
                own = coefficients[n, k]
                columns[k, t] = values[row, k] + far * (values[row + 1, k] - values[row, k])
                slope += own * (slopes[row, k] + far * (slopes[row + 1, k] - slopes[row, k]))
                width += own * (wider[row, k] + far * (wider[row + 1, k] - wider[row, k]))
                blur += own * (softer[row, k] + far * (softer[row + 1, k] - softer[row, k]))
            columns[K, t], columns[K + 1, t], columns[K + 2, t] = width, blur, width * (share[n] - 0.5)
            columns[G, t], columns[Y, t] = slope * by_place, found.profiles[n, t]
        _products(columns, each[n])
    return each


@kernel
def coefficients_alone(found: Crossings, base: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(N, K + 1, K + 1) the same of coefficients and grey levels only, for polynomials tabled (R, K)."""
    count, length = found.profiles.shape
    each, columns, across = np.zeros((count, K + 1, K + 1)), np.empty((K + 1, length)), np.empty(length)
    last = len(values) - 1
    for n in range(count):
        distances(found, n, base[n], across)
        for t in range(length):
            place = min(max(across[t] * PER_PX + 0.5 * last, 0.0), float(last))
            row = min(int(place), last - 1)
            for k in range(K):
                columns[k, t] = values[row, k] + (place - row) * (values[row + 1, k] - values[row, k])
            columns[K, t] = found.profiles[n, t]
        _products(columns, each[n])
    return each


@kernel
def explained_by_edges(
    found: Crossings, base: np.ndarray, silhouette: tuple[float, float], weight: np.ndarray, near: int
) -> np.ndarray:
    """(N,) weighted squares of so many profiles near by that one blurred edge explains, in the stead of a line at (N,)
    of some width and blur, px, and wherever across it. weight : (N,) of the profiles."""
    width_px, blur_px = silhouette
    count, length = found.profiles.shape
    spread, last = np.sqrt(2.0 * (blur_px**2 + PIXEL_BLUR_PX**2)), _EDGE_PX * PER_PX
    table = np.empty(2 * last + 1)
    for r in range(2 * last + 1):
        table[r] = 0.5 * erfc((last - r) / (PER_PX * spread))
    # its square, and its product with the grey levels
    told, rows, across = np.empty((count, 2 * EDGES)), np.empty((EDGES + 1, length)), np.empty(length)
    for n in range(count):
        distances(found, n, base[n], across)
        rows[EDGES] = found.profiles[n]
        for e in range(EDGES):
            place = (width_px + 2.0) * (e / (EDGES - 1.0) - 0.5)
            for t in range(length):
                rows[e, t] = table[min(max(int(np.rint((across[t] - place) * PER_PX)) + last, 0), 2 * last)]
        remove_background(rows)
        for e in range(EDGES):
            told[n, 2 * e] = weight[n] * dot(rows[e], rows[e])
            told[n, 2 * e + 1] = weight[n] * dot(rows[e], rows[EDGES])
    told, most = triangle_sums(told, near), np.zeros(count)
    for n in range(count):
        for e in range(EDGES):
            most[n] = max(most[n], told[n, 2 * e + 1] ** 2 / max(told[n, 2 * e], 1e-9))
    return most
