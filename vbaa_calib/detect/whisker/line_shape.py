"""The antenna's cross-section as this picture shows it: paint, light, focus and motion, learned from its own profiles.

A function of the distance from the centreline, in cubic splines, symmetric; what is not is `reflectance`'s.
With it every profile is a least-squares problem in four unknowns: level and slope of the background, the line's
height, its place.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.smooth import solve

from .crossings import Crossings, distances, shares

PER_PX = 32
"""Rows of a tabled shape per pixel."""
_BINS_PER_PX = 4
WIDTHS, BLURS_PX = (0.85, 1.0, 1.2), (0.45, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 3.0, 4.0)
"""Widths, as parts of the antenna's, and blurs that are tried."""
MOST_TAPER = 0.6
"""By which part the line may be broader at one end than at the other."""
LIKELY_TAPER = 0.3
"""Deviation of that beforehand: where little of the line is seen, its noise is no taper."""
_KNOT_PX = 0.85
"""Spacing of the splines' knots: finer than the point spread of an ordinary lens."""


class CrossSection(NamedTuple):
    """What lines look like across: sums of C tabled functions of the distance from the centre.

    Attributes
    ----------
    values, slopes : (2R + 1, C) the functions and their derivatives, `PER_PX` rows a pixel, the middle one at 0 px.
    weights : (N, C) of every profile; (1, 1), one, where all are alike.
    """

    values: np.ndarray
    slopes: np.ndarray
    weights: np.ndarray


@kernel
def alike(values: np.ndarray, slopes: np.ndarray) -> CrossSection:
    """One cross-section for all profiles, of height one: (2R + 1, 1) values and slopes."""
    return CrossSection(values, slopes, np.ones((1, 1)))


@kernel
def _look_up(section: CrossSection, n: int, across: np.ndarray, value: np.ndarray, slope: np.ndarray) -> None:
    """Profile n's cross-section and its derivative at distances (T,) from the centre, px: into (T,) each."""
    last, several = len(section.values) - 1, section.values.shape[1]
    own = n if len(section.weights) > 1 else 0
    for t in range(len(across)):
        place = min(max(across[t] * PER_PX + 0.5 * last, 0.0), float(last))
        row = min(int(place), last - 1)
        part = place - row
        if several == 1:
            value[t] = (1.0 - part) * section.values[row, 0] + part * section.values[row + 1, 0]
            slope[t] = (1.0 - part) * section.slopes[row, 0] + part * section.slopes[row + 1, 0]
            continue
        value[t], slope[t] = 0.0, 0.0
        for c in range(several):
            near, far = section.weights[own, c] * (1.0 - part), section.weights[own, c] * part
            value[t] += near * section.values[row, c] + far * section.values[row + 1, c]
            slope[t] += near * section.slopes[row, c] + far * section.slopes[row + 1, c]


@kernel
def half_width_px(section: CrossSection) -> float:
    """Half the width at half the height, of cross-sections that are alike."""
    return (section.values > 0.5).sum() / (2.0 * PER_PX)


@kernel
def expected(width_px: float, blur_px: float, reach_px: int) -> CrossSection:
    """A round, evenly painted antenna of this width, seen through this blur and the pixel's own square."""
    middle, half, blur = reach_px * PER_PX, 0.5 * width_px, np.hypot(blur_px, 0.29)
    spread = np.exp(-0.5 * ((np.arange(2 * middle + 1) - middle) / (PER_PX * blur)) ** 2)
    spread /= spread.sum()
    line, last = np.zeros(2 * middle + 1), 2 * middle
    for b in range(last + 1):
        across = abs(b - middle) / PER_PX
        if across < half:
            body = 0.4 + 0.6 * np.sqrt(max(1.0 - (across / half) ** 2, 0.0))
            first = max(b - middle, 0)
            part, own = spread[first + middle - b : min(last, b + middle) + 1 + middle - b], line[first:]
            for r in range(len(part)):
                own[r] += body * part[r]
    values, slopes = line.reshape((last + 1, 1)) / line.max(), np.empty((last + 1, 1))
    for r in range(last + 1):
        before, after = max(r - 1, 0), min(r + 1, last)
        slopes[r, 0] = (values[after, 0] - values[before, 0]) * (PER_PX / (after - before))
    return alike(values, slopes)


class Shapes(NamedTuple):
    """What a cross-section is learned with: for a width, within a reach.

    Attributes
    ----------
    bins, values, slopes : (B, M), (R, M), (R, M) even cubic splines in the bins, and they and their derivatives in a
        table's rows.
    ordinary : the antenna in focus. blurred_bins, blurred_values, blurred_slopes : (F, B), (F, R, 1), (F, R, 1) of
        antennas somewhat thinner and broader, from sharp to far out of focus.
    """

    bins: np.ndarray
    values: np.ndarray
    slopes: np.ndarray
    ordinary: CrossSection
    blurred_bins: np.ndarray
    blurred_values: np.ndarray
    blurred_slopes: np.ndarray


@lru_cache(maxsize=32)
def shapes(width_px: float, blur_px: float, reach_px: int) -> Shapes:
    """What shapes are learned with, for an antenna of this width and, in focus, this blur, to `reach_px` aside."""
    several = [expected(width_px * part, blur, reach_px) for part in WIDTHS for blur in BLURS_PX]
    values, slopes = np.stack([each.values for each in several]), np.stack([each.slopes for each in several])
    rows = np.rint((np.arange(2 * reach_px * _BINS_PER_PX) + 0.5) * (PER_PX / _BINS_PER_PX)).astype(np.intp)
    bins = np.ascontiguousarray(values[:, rows, 0])
    return Shapes(*_splines(reach_px), expected(width_px, blur_px, reach_px), bins, values, slopes)


@lru_cache(maxsize=32)
def _splines(reach_px: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Even cubic splines over ±`reach_px`: values in the bins (B, M), values and slopes at the table's rows (R, M)."""
    inner = max(4, int(np.ceil(reach_px / _KNOT_PX)))
    knot_px, knots = reach_px / inner, np.arange(-inner - 1, inner + 2)
    bins = (np.arange(2 * reach_px * _BINS_PER_PX) + 0.5) / _BINS_PER_PX - reach_px
    table = np.arange(2 * reach_px * PER_PX + 1) / PER_PX - reach_px
    basis = np.minimum(np.eye(len(knots)) + np.eye(len(knots))[::-1], 1.0)[:, : inner + 2]
    off_bins, off = (places[:, None] / knot_px - knots for places in (bins, table))
    return _spline(off_bins) @ basis, _spline(off) @ basis, _spline_slope(off) / knot_px @ basis


def _spline(off: np.ndarray) -> np.ndarray:
    """The cubic spline of one knot among equal ones, by the distance from it in knots: without SciPy's interpolation,
    whose import takes longer than a frame."""
    away = np.minimum(np.abs(off), 2.0)
    return np.where(away < 1.0, (4.0 - 3.0 * away**2 * (2.0 - away)) / 6.0, (2.0 - away) ** 3 / 6.0)


def _spline_slope(off: np.ndarray) -> np.ndarray:
    away = np.minimum(np.abs(off), 2.0)
    return np.sign(off) * np.where(away < 1.0, 1.5 * away**2 - 2.0 * away, -0.5 * (2.0 - away) ** 2)


class _Binned(NamedTuple):
    """Heights by distance from the centre: how many (B,) and their means (B,), `_BINS_PER_PX` a pixel."""

    number: np.ndarray
    mean: np.ndarray


@kernel
def lopsided(seen: _Binned, noise: float) -> float:
    """Root mean square difference of the two sides where the line is, beyond what `noise` of one height makes."""
    total, power, used = 0.0, 0.0, 0
    for b in range(len(seen.number)):
        one, other = seen.mean[b], seen.mean[len(seen.mean) - 1 - b]
        weight = min(seen.number[b], seen.number[len(seen.mean) - 1 - b])
        if weight > 0.0 and abs(one) + abs(other) > 0.2:
            total, power, used = total + weight, power + weight * (0.5 * (one - other)) ** 2, used + 1
    total = max(total, 1.0)
    return np.sqrt(max(power / total - noise**2 * used / total, 0.0))


@kernel
def nearest(seen: _Binned, known: Shapes) -> CrossSection:
    """The shape that an antenna of about this width has at the blur that the heights show."""
    whole = seen.number.sum()
    offset = (seen.mean * seen.number).sum() / whole
    best, most = 0, -np.inf
    for f in range(len(known.blurred_bins)):
        shape = known.blurred_bins[f]
        middle = shape - (shape * seen.number).sum() / whole
        # the height that fits each shape best is left free
        match = (middle * seen.number * (seen.mean - offset)).sum() ** 2
        match /= max((middle**2 * seen.number).sum(), 1e-9)
        if match > most:
            best, most = f, match
    return alike(known.blurred_values[best], known.blurred_slopes[best])


@kernel
def learn(seen: _Binned, known: Shapes) -> CrossSection:
    """The smooth symmetric shape that the heights show, whatever it is."""
    bins, several = known.bins, known.bins.shape[1]
    matrix, side = np.zeros((several, several)), np.zeros((several, 1))
    for b in range(len(bins)):
        for i in range(several):
            weight = seen.number[b] * bins[b, i]
            if weight != 0.0:
                side[i, 0] += weight * seen.mean[b]
                for j in range(i + 1):
                    matrix[i, j] += weight * bins[b, j]
    bend = 1e-3 * seen.number.mean()
    second = (1.0, -2.0, 1.0)
    for k in range(several - 2):
        for i in range(3):
            for j in range(i + 1):
                matrix[k + i, k + j] += bend * second[i] * second[j]
    for i in range(several):
        matrix[i, i] += 1e-9 * (1.0 + seen.number.sum())
    solve(matrix, side)
    shape, slope = _product(known.values, side), _product(known.slopes, side)
    shape -= 0.5 * (shape[0, 0] + shape[-1, 0])
    scale = shape.max()
    scale = scale if scale > 1e-6 else 1.0
    return alike(shape / scale, slope / scale)


@kernel
def _product(table: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """(R, 1) of a table (R, M) and coefficients (M, 1)."""
    values = np.zeros((len(table), 1))
    for r in range(len(table)):
        for m in range(table.shape[1]):
            values[r, 0] += table[r, m] * coefficients[m, 0]
    return values


class Fits(NamedTuple):
    """Lines fitted to N profiles of T pixels.

    Attributes
    ----------
    shift : (N,) by how much the line lies beside the assumed centre, along the profile, px.
    height : (N,) grey levels.
    unit_height : (N,) the height's standard deviation, were the noise of every pixel one.
    gain : (N, T) derivative of the shift by each pixel.
    residuals : (N, T) grey levels. rms : (N,) their root mean square, freed of the four unknowns.
    freed : (N, T) what of a pixel's variance its residual keeps.
    stepped : (N,) by how much further the line would lie along the profile if the background had a step behind it: an
        object's edge that runs along the antenna. stepped_unit : (N,) its deviation, were the noise of every pixel one.
    """

    shift: np.ndarray
    height: np.ndarray
    unit_height: np.ndarray
    gain: np.ndarray
    residuals: np.ndarray
    rms: np.ndarray
    freed: np.ndarray
    stepped: np.ndarray
    stepped_unit: np.ndarray


@kernel
def fit(section: CrossSection, found: Crossings, centre: np.ndarray) -> Fits:
    """One Gauss–Newton step from the centres (N,), given along the profile from the path."""
    count, length = found.profiles.shape
    fits = Fits(
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty((count, length)),
        np.empty((count, length)),
        np.empty(count),
        np.empty((count, length)),
        np.empty(count),
        np.empty(count),
    )
    across, value, slope = np.empty(length), np.empty(length), np.empty(length)
    middle, per_spread = 0.5 * (length - 1), 12.0 / (length * (length**2 - 1.0))
    # one loop for all profiles: a call for each would hand on every array of the tuples
    for n in range(count):
        distances(found, n, centre[n], across)
        _look_up(section, n, across, value, slope)
        by_centre = -found.side[n] / found.stretch[n]
        # levels and slopes of the background in the shape, in its derivative, in the grey levels and in a step
        v0, v1, s0, s1, y0, y1, b0, b1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for t in range(length):
            x, b = t - middle, min(max(across[t], -1.0), 1.0)
            v0, v1 = v0 + value[t], v1 + x * value[t]
            s0, s1 = s0 + slope[t], s1 + x * slope[t]
            y0, y1 = y0 + found.profiles[n, t], y1 + x * found.profiles[n, t]
            b0, b1 = b0 + b, b1 + x * b
        v0, s0, y0, b0 = v0 / length, by_centre * s0 / length, y0 / length, b0 / length
        v1, s1, y1, b1 = v1 * per_spread, by_centre * s1 * per_spread, y1 * per_spread, b1 * per_spread
        vv, vs, ss, vy, sy, vb, sb = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for t in range(length):
            x = t - middle
            v, s = value[t] - v0 - v1 * x, by_centre * slope[t] - s0 - s1 * x
            y, b = found.profiles[n, t] - y0 - y1 * x, min(max(across[t], -1.0), 1.0) - b0 - b1 * x
            vv, vs, ss = vv + v * v, vs + v * s, ss + s * s
            vy, sy, vb, sb = vy + v * y, sy + s * y, vb + v * b, sb + s * b
        determinant = max(vv * ss - vs**2, 1e-9)
        height, product = (ss * vy - vs * sy) / determinant, (vv * sy - vs * vy) / determinant
        safe = height if abs(height) > 1e-6 else 1e-6
        # the step, less what height and place make of it
        moved, left = (vv * sb - vs * vb) / determinant, (ss * vb - vs * sb) / determinant
        by_slope, by_value, per_power = vv / determinant, vs / determinant, 1.0 / max(vv, 1e-9)
        per_height = 1.0 / safe
        square, power, stepped = 0.0, 0.0, 0.0
        for t in range(length):
            x = t - middle
            v, s = value[t] - v0 - v1 * x, by_centre * slope[t] - s0 - s1 * x
            b = min(max(across[t], -1.0), 1.0) - b0 - b1 * x
            by_pixel = by_slope * s - by_value * v
            residual = found.profiles[n, t] - y0 - y1 * x - height * v - product * s
            leverage = 1.0 / length + x * x * per_spread + by_pixel * s + v * v * per_power
            apart = b - left * v - moved * s
            fits.gain[n, t], fits.residuals[n, t] = by_pixel * per_height, residual
            fits.freed[n, t] = max(1.0 - leverage, 0.15)
            square += residual * residual
            power += apart * apart
            stepped += apart * residual
        power = max(power, 1e-9)
        fits.shift[n] = min(max(product * per_height, -0.5 * length), 0.5 * length)
        fits.height[n], fits.unit_height[n] = height, np.sqrt(ss / determinant)
        fits.rms[n] = np.sqrt(square / (length - 4))
        fits.stepped[n] = -moved * per_height * stepped / power
        fits.stepped_unit[n] = abs(moved * per_height) / np.sqrt(power)
    return fits


@kernel
def binned(found: Crossings, centre: np.ndarray, seen: np.ndarray, chosen: np.ndarray, reach_px: int) -> _Binned:
    """Heights (N, T) of the chosen profiles (N,) by their distances from centres (N,)."""
    bins = 2 * reach_px * _BINS_PER_PX
    count, total = np.zeros(bins), np.zeros(bins)
    across = np.empty(seen.shape[1])
    for n in range(len(seen)):
        if chosen[n]:
            distances(found, n, centre[n], across)
            for t in range(len(across)):
                at = int(min(max((across[t] + reach_px) * _BINS_PER_PX, 0.0), float(bins)))
                if at < bins:
                    count[at] += 1.0
                    total[at] += seen[n, t]
    return _Binned(count, total / np.maximum(count, 1.0))


@kernel
def shown(
    section: CrossSection, found: Crossings, centre: np.ndarray, fits: Fits, chosen: np.ndarray
) -> tuple[np.ndarray, float]:
    """What the chosen profiles (N,) show of the line, whatever it was fitted with.

    Returns
    -------
    (N, T) grey levels less the background, over the line's height; and by which part the line is broader at the path's
    end than at its start, as the residuals show it, to first order in how the width changes.
    """
    count, length = found.profiles.shape
    share, heights = shares(found), np.zeros((count, length))
    across, value, slope = np.empty(length), np.empty(length), np.empty(length)
    middle, per_spread = 0.5 * (length - 1), 12.0 / (length * (length**2 - 1.0))
    # sums of information, and of it and of the slopes by share
    informed, by_share, by_square, slopes, slopes_by_share = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(count):
        if not chosen[n]:
            continue
        distances(found, n, centre[n], across)
        _look_up(section, n, across, value, slope)
        v0, v1, w0, w1, per_height = 0.0, 0.0, 0.0, 0.0, 1.0 / fits.height[n]
        for t in range(length):
            wider = -across[t] * slope[t]
            v0, v1 = v0 + value[t], v1 + (t - middle) * value[t]
            w0, w1 = w0 + wider, w1 + (t - middle) * wider
            heights[n, t] = value[t] + fits.residuals[n, t] * per_height
        v0, v1, w0, w1 = v0 / length, v1 * per_spread, w0 / length, w1 * per_spread
        vv, vw, ww, rv, rw = 0.0, 0.0, 0.0, 0.0, 0.0
        for t in range(length):
            v, w = value[t] - v0 - v1 * (t - middle), -across[t] * slope[t] - w0 - w1 * (t - middle)
            vv, vw, ww = vv + v * v, vw + v * w, ww + w * w
            rv, rw = rv + fits.residuals[n, t] * v, rw + fits.residuals[n, t] * w
        # less what the height makes of it
        information, toward = (ww - vw**2 / vv) * fits.height[n] ** 2, (rw - rv * vw / vv) * fits.height[n]
        informed += information
        by_share += information * share[n]
        by_square += information * share[n] ** 2
        slopes += toward
        slopes_by_share += toward * share[n]
    middle_share = by_share / max(informed, 1e-9)
    prior = np.median(fits.rms[chosen]) ** 2 / LIKELY_TAPER**2
    variance = by_square - 2.0 * middle_share * by_share + middle_share**2 * informed
    taper = (slopes_by_share - middle_share * slopes) / max(variance + prior, 1e-9)
    return heights, min(max(taper, -MOST_TAPER), MOST_TAPER)
