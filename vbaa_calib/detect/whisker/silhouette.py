"""What a silhouette of known width shows: polynomials across it, blurred, and what profiles say of them and of it."""

from __future__ import annotations

from math import erfc

import numpy as np
from numpy.polynomial.legendre import leg2poly

from vbaa_calib.core.compiled import kernel

from .crossings import Crossings, distances, shares
from .line_shape import PER_PX, CrossSection, dot, look_up, remove_background

K = 4
"""Legendre polynomials that an antenna's reflectance across it is made of: level, brighter on one side, a highlight,
and that aside."""
G, Y, ALL = K + 3, K + 4, K + 5
"""Columns of a profile's normal equations: K coefficients; width, blur and taper; place; grey levels."""
MEAN_SQUARE = 1.0 / (2.0 * np.arange(K) + 1.0)
"""(K,) of the polynomials over the silhouette."""
PIXEL_BLUR_PX = 0.29
"""A pixel's own square, as a standard deviation."""
FAR = 8.0
"""Deviations beyond an edge at which nothing is left of it."""
_POWERS = np.stack([np.pad(leg2poly(row[: k + 1]), (0, K - 1 - k)) for k, row in enumerate(np.eye(K))])


@kernel
def tables(width_px: float, blur_px: float, reach_px: int) -> tuple[np.ndarray, np.ndarray]:
    """The blurred polynomials and their derivatives (R, K), tabled as a cross-section is."""
    values = blurred(width_px, blur_px, reach_px)
    slopes, last = np.empty(values.shape), len(values) - 1
    for r in range(last + 1):
        before, after = max(r - 1, 0), min(r + 1, last)
        slopes[r] = (values[after] - values[before]) * (PER_PX / (after - before))
    return values, slopes


@kernel
def blurred(width_px: float, blur_px: float, reach_px: int) -> np.ndarray:
    """(R, K) Legendre polynomials over the silhouette, blurred, at the table's distances from its centre.

    By the recurrence of the powers' convolution with a bell over an interval. Odd ones change their sign in the middle.
    """
    half, variance = 0.5 * width_px, blur_px**2 + PIXEL_BLUR_PX**2
    std = np.sqrt(variance)
    middle = reach_px * PER_PX
    values, powers = np.zeros((2 * middle + 1, K)), np.empty(K)
    for r in range(middle + 1):
        across = r / PER_PX
        left, right = (across + half) / std, (across - half) / std
        if right > FAR:
            break
        rising = np.exp(-0.5 * left**2) / (np.sqrt(2.0 * np.pi) * std)
        falling = np.exp(-0.5 * right**2) / (np.sqrt(2.0 * np.pi) * std)
        powers[0] = 0.5 * (erfc(-left / np.sqrt(2.0)) - erfc(-right / np.sqrt(2.0)))
        for k in range(K - 1):
            before = k * powers[k - 1] if k else 0.0
            ends = half**k * falling - (-half) ** k * rising
            powers[k + 1] = across * powers[k] + variance * (before - ends)
        for k in range(K):
            for i in range(k + 1):
                values[middle + r, k] += _POWERS[k, i] * powers[i] / half**i
            values[middle - r, k] = values[middle + r, k] * (-1.0) ** k
    return values


@kernel
def _polynomials(
    found: Crossings, n: int, centre: float, section: CrossSection, across: np.ndarray, columns: np.ndarray
) -> None:
    """Each of a cross-section's functions over profile n, less the background: into rows (≥ K, T)."""
    distances(found, n, centre, across)
    last = len(section.values) - 1
    for t in range(len(across)):
        place = min(max(across[t] * PER_PX + 0.5 * last, 0.0), float(last))
        row = min(int(place), last - 1)
        for k in range(K):
            before, after = section.values[row, k], section.values[row + 1, k]
            columns[k, t] = before + (after - before) * (place - row)
    for k in range(K):
        remove_background(columns[k])


@kernel
def normal_equations(
    found: Crossings,
    base: np.ndarray,
    width_px: float,
    blur_px: float,
    coefficients: np.ndarray,
    values: np.ndarray,
    slopes: np.ndarray,
) -> np.ndarray:
    """(N, K + 5, K + 5) products of every profile's columns, less the background's level and slope; lower halves."""
    count, length = found.profiles.shape
    reach_px = len(values) // (2 * PER_PX)
    wider = (blurred(width_px * 1.02, blur_px, reach_px) - values) / 0.02
    softer = (blurred(width_px, blur_px * 1.02, reach_px) - values) / 0.02
    place, widths = CrossSection(values, slopes, coefficients), CrossSection(wider, softer, coefficients)
    share = shares(found)
    each, columns, across = np.zeros((count, ALL, ALL)), np.empty((ALL, length)), np.empty(length)
    for n in range(count):
        if not found.inside[n]:
            continue
        _polynomials(found, n, base[n], place, across, columns)
        look_up(widths, n, across, columns[K], columns[K + 1])
        look_up(place, n, across, columns[K + 2], columns[G])
        for t in range(length):
            columns[K + 2, t] = columns[K, t] * (share[n] - 0.5)
            columns[G, t] *= -found.side[n] / found.stretch[n]
            columns[Y, t] = found.profiles[n, t]
        for i in range(K, ALL):
            remove_background(columns[i])
        for i in range(ALL):
            for j in range(i + 1):
                each[n, i, j] = dot(columns[i], columns[j])
                each[n, j, i] = each[n, i, j]
    return each


@kernel
def coefficients_alone(found: Crossings, base: np.ndarray, section: CrossSection) -> np.ndarray:
    """(N, K + 1, K + 1) the same of coefficients and grey levels only."""
    count, length = found.profiles.shape
    each, columns, across = np.zeros((count, K + 1, K + 1)), np.empty((K + 1, length)), np.empty(length)
    for n in range(count):
        _polynomials(found, n, base[n], section, across, columns)
        columns[K] = found.profiles[n]
        remove_background(columns[K])
        for i in range(K + 1):
            for j in range(i + 1):
                each[n, i, j] = dot(columns[i], columns[j])
                each[n, j, i] = each[n, i, j]
    return each
