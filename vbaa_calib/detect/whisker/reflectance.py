"""An antenna with its own reflectance: bare steel, or a highlight at its side; bright here, dark there, as its
background there.

Across the antenna it is a polynomial that ends at the silhouette's two edges, whose distance the rig tells, seen
through blur and pixel. Its coefficients change smoothly along the antenna and may have either sign, so that bright goes
over into dark through nothing. Only edges tell where the line is: where one of them does not show, a lopsided
reflectance looks like a line that lies aside, for as long as the light stays the same. That much the place is
uncertain, alike for many neighbours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.core import smooth
from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.polyline import arc_lengths
from vbaa_calib.core.smooth import quantile, solve, triangle_sums

from .crossings import Crossings, dot, every, remove_background, shares, tapered
from .line_shape import LIKELY_TAPER, MOST_TAPER, CrossSection, alike
from .silhouette import (
    ALL,
    MEAN_SQUARE,
    G,
    K,
    Y,
    blurred,
    coefficients_alone,
    explained_by_edges,
    normal_equations,
    tables,
)

_LIKELY = np.array([3.0, 0.8, 0.8, 0.5])
"""Deviations beforehand, over the antenna's contrast, of the polynomial's coefficients: level, brighter on one side, a
highlight, and that aside."""
LEAST_LIKELY, LIKELY_PROFILES = 0.22, 10.0
"""Where a line shows nothing of them they shrink to this part; so many profiles count for what was likely before."""
LIKELY_LOG_WIDTH, LIKELY_LOG_BLUR = 0.03, 0.3
"""Deviations beforehand of the silhouette's width and blur, logarithmic."""
WINDOW_PX, LEARNING = 21.0, 48
"""Over so much of its length the antenna looks alike; at least so many of its profiles are learned from at first."""
_PASSES = 4
INDEPENDENT, WELL_BEGUN, ALIKE = 8.0, 60.0, 30.0
"""What the shape cannot follow is alike in many neighbours. A whole line tells as much as so many profiles where it is;
once that is about right, as so many; and of its width and blur each profile as much as one part in so many."""
QUIET = 0.4
"""Quantile of the profiles' residuals taken for what noise and a wrong shape leave."""
START_STEP_PX, START_BENDS, START_PROFILES = 0.5, 9, 24
"""At first the line is looked for at such steps, in so many places of either end and the middle, in so many
profiles."""
MISFIT, PULLED, LEFT = 0.01, (0.01, 0.1), 0.42
"""Part of the profiles' power that no shape follows; parts of the width by which the line may be pulled in any case,
and by a reflectance that is lopsided by the line's whole height; and what is left, when the line was followed, of the
deviation of where it was begun."""
OVER_EDGE, UNSURE = 20.0, 0.17
"""Where a line does not explain the profiles near by better than one edge, an object's or a shadow's, by so much,
squares over the noise's, it may lie off by up to this part of its width; before and beyond all that is clear there is
none where the edge explains more."""
STIFF_PIECES, PIECES = 4, 10
"""Of the smooth path that is begun with, and of the line's course about it."""


class _Reflectance(NamedTuple):
    """Cross-sections of N profiles.

    Attributes
    ----------
    width_px, blur_px : of the silhouette.
    coefficients : (N, K) of Legendre polynomials across it, grey levels above the background.
    height : (N,) contrast to the background, grey levels: root mean square over the silhouette.
    section : the cross-sections over their heights: the blurred polynomials, weighted.
    """

    width_px: float
    blur_px: float
    coefficients: np.ndarray
    height: np.ndarray
    section: CrossSection


class _Learned(NamedTuple):
    """What N profiles show: the reflectance, the line's course (N,) along them, the deviation (N,) of that, px, which
    neighbours share, by which part the line is broader at the path's end, where there is none, (N,), and how surely
    there is one, (N,): 1 where an edge does not explain the profiles."""

    reflectance: _Reflectance
    course: np.ndarray
    shared_px: np.ndarray
    taper: float
    none: np.ndarray
    sure: np.ndarray


@kernel
def stiffened(path_px: np.ndarray) -> np.ndarray:
    """A path (K, 2) as smooth as an antenna: on bare metal a highlight that changes sides leads it to and fro."""
    along = arc_lengths(path_px)
    share, weights = along / max(along[-1], 1e-6), np.ones(len(path_px))
    path = np.empty(path_px.shape)
    for axis in range(2):
        path[:, axis] = smooth.fit(share, path_px[:, axis].copy(), weights, (1.0, 0.5), STIFF_PIECES, 1e-6).values
    return path


@kernel
def mean_shape(reflectance: _Reflectance, which: np.ndarray) -> CrossSection:
    """The mean cross-section, over its height, of profiles (M,)."""
    mean, known = np.zeros((K, 1)), reflectance.section
    for n in which:
        mean[:, 0] += reflectance.coefficients[n] / len(which)
    mean /= np.sqrt(max((mean[:, 0] ** 2 * MEAN_SQUARE).sum(), 1e-12))
    values, slopes = np.zeros((len(known.values), 1)), np.zeros((len(known.values), 1))
    for r in range(len(values)):
        values[r, 0], slopes[r, 0] = dot(known.values[r], mean[:, 0]), dot(known.slopes[r], mean[:, 0])
    return alike(values, slopes)


@kernel
def learn_reflectance(
    found: Crossings, width_px: float, blur_px: float, course: np.ndarray, course_std_px: float
) -> _Learned:
    """The reflectance that profiles about a path show, and where the line is.

    course, course_std_px : (N,) along the profiles and its deviation, where the line is known to lie; else empty.

    Width and blur of the whole line, its course and the coefficients at every place are solved for together, from some
    of the profiles; then the coefficients from all of them.
    """
    length = found.profiles.shape[1]
    reach_px = length // 2 + 2
    step = max(1, len(found.along) // LEARNING)
    some, count = every(found, step), max(3, int(np.rint(0.5 * WINDOW_PX / step)))
    known_course = len(course) > 0
    if known_course:
        begin, begin_std = course[::step].copy(), np.full(len(some.along), course_std_px)
        loose = begin_std**-2.0
    else:
        begin, begin_std = _begin(some, width_px, blur_px, count)
        loose = np.maximum(begin_std, START_STEP_PX) ** -2.0
    share = some.along / max(found.along[-1], 1e-6)
    base, moved, taper = begin, np.zeros(3), 0.0
    precision = np.array([LIKELY_LOG_WIDTH, LIKELY_LOG_BLUR, LIKELY_TAPER]) ** -2.0
    contrast = _first_contrast(some, width_px)
    noise, likely, weight = 0.1 * contrast, _LIKELY.copy(), some.inside.astype(np.float64)
    width, blur, coefficients = width_px, blur_px, np.zeros((len(base), K))
    known = np.ones(len(base))
    for turn in range(_PASSES):
        each = normal_equations(tapered(some, taper), base, (width, blur), coefficients, reach_px)
        local = _with_neighbours(each, weight / noise**2, count, likely * contrast)
        change, moves = np.zeros(3), np.zeros(len(base))
        if turn:
            change = _shape_step(local, moved, precision, count)
            moved = moved + change
        free, toward, variance, known, shift = _solved(local, change)
        if turn:
            told = weight * known * (WELL_BEGUN / len(found.along))
            target = (told * (base + np.minimum(np.maximum(shift, -1.0), 1.0)) + loose * begin) / (told + loose)
            better = smooth.fit(share, target, told + loose, (1.0, 0.5), PIECES, 1e-3).values
            moves, base = better - base, better
        coefficients = free - toward * moves.reshape(-1, 1)
        rms = _left(each, coefficients, change, moves) / np.sqrt(length - 4.0)
        noise = max(quantile(rms[some.inside], QUIET), 1e-3 * contrast)
        weight = some.inside / (1.0 + (rms / (3.0 * noise)) ** 2)
        contrast = np.sqrt((weight * _square(coefficients)).sum() / max(weight.sum(), 1e-9)) + 1e-6
        if turn:
            likely = _likely(coefficients / contrast, variance / contrast**2, likely, weight)
        width, blur = width_px * np.exp(moved[0]), blur_px * np.exp(moved[1])
        taper = min(max(moved[2], -MOST_TAPER), MOST_TAPER)
    values, slopes = tables(width, blur, reach_px)
    whole = np.empty((len(found.along), K))
    for k in range(K):
        whole[:, k] = np.interp(found.along, some.along, coefficients[:, k])
    weight = np.interp(found.along, some.along, weight) * found.inside / noise**2
    course = np.interp(found.along, some.along, base)
    found, near = tapered(found, taper), int(np.rint(0.5 * WINDOW_PX))
    local = _with_neighbours(coefficients_alone(found, course, values), weight, near, likely * contrast)
    if known_course:  # an antenna of known polarity was found there
        over_edge = np.full(len(whole), np.inf)
    else:
        over_edge = -explained_by_edges(found, course, (width, blur), weight, near)
    matrix, side = np.empty((K, K)), np.empty((K, 1))
    for n in range(len(whole)):
        for i in range(K):
            side[i, 0] = local[n, i, K]
            for j in range(K):
                matrix[i, j] = local[n, i, j]
        solve(matrix, side)
        for k in range(K):
            whole[n, k] = side[k, 0]
            over_edge[n] += side[k, 0] * local[n, k, K]
    height = np.sqrt(np.maximum(_square(whole), 1e-12))
    lopsided = np.sqrt(whole[:, 1] ** 2 * MEAN_SQUARE[1] + whole[:, 3] ** 2 * MEAN_SQUARE[3]) / height
    shared = LEFT * np.interp(found.along, some.along, begin_std)
    shared_px = np.hypot(shared, width_px * np.hypot(PULLED[0], PULLED[1] * lopsided)) / found.stretch
    unsure = 1.0 - np.minimum(np.maximum(over_edge / OVER_EDGE, 0.0), 1.0)
    shared_px = np.hypot(shared_px, UNSURE * width_px * unsure / found.stretch)
    none, clear = over_edge < 0.0, np.flatnonzero(over_edge > OVER_EDGE)
    if len(clear):
        none[clear[0] : clear[-1]] = False
    section = CrossSection(values, slopes, whole / height.reshape(-1, 1))
    return _Learned(_Reflectance(width, blur, whole, height, section), course, shared_px, taper, none, 1.0 - unsure)


@kernel
def _square(coefficients: np.ndarray) -> np.ndarray:
    """(N,) mean squares over the silhouette of polynomials (N, K)."""
    squares = np.zeros(len(coefficients))
    for n in range(len(coefficients)):
        for k in range(K):
            squares[n] += coefficients[n, k] ** 2 * MEAN_SQUARE[k]
    return squares


@kernel
def _first_contrast(found: Crossings, width_px: float) -> float:
    """Contrast of most profiles, grey levels, of whatever there is in them."""
    grey = found.profiles.copy()
    remove_background(grey)
    power = (grey**2).sum(axis=1) / width_px
    return np.sqrt(quantile(power[found.inside], 0.7)) + 1e-6


@kernel
def _with_neighbours(each: np.ndarray, weight: np.ndarray, count: int, likely: np.ndarray) -> np.ndarray:
    """Normal equations (N, M, M) summed over neighbours, with the prior of the coefficients."""
    number, size, _ = each.shape
    weighted = each.reshape(number, size * size) * weight.reshape(-1, 1)
    local = triangle_sums(weighted, count).reshape(number, size, size)
    for n in range(number):
        for k in range(K):
            local[n, k, k] += likely[k] ** -2.0
        if size > G:
            local[n, G, G] += 1.0 / START_STEP_PX**2
    return local


@kernel
def _shape_step(local: np.ndarray, moved: np.ndarray, precision: np.ndarray, count: int) -> np.ndarray:
    """(3,) step of width, blur and taper, for any coefficients and place: normal equations (N, K + 5, K + 5)."""
    matrix, side = np.diag(precision), np.empty((3, 1))
    side[:, 0] = -moved * precision
    left, right = np.empty((K + 1, K + 1)), np.empty((K + 1, 4))
    for n in range(len(local)):
        for i in range(K + 1):
            row = G if i == K else i
            for j in range(K + 1):
                left[i, j] = local[n, row, G if j == K else j]
            for j in range(3):
                right[i, j] = local[n, row, K + j]
            right[i, 3] = local[n, row, Y]
        solve(left, right)
        for i in range(3):
            for j in range(4):
                told = local[n, K + i, K + j if j < 3 else Y]
                for k in range(K + 1):
                    told -= local[n, K + i, G if k == K else k] * right[k, j]
                if j < 3:
                    matrix[i, j] += told / (count * ALIKE)
                else:
                    side[i, 0] += told / (count * ALIKE)
    solve(matrix, side)
    return np.minimum(np.maximum(side[:, 0], -0.3), 0.3)


@kernel
def _solved(local: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of normal equations (N, K + 5, K + 5), after a step (3,) of width, blur and taper: the coefficients (N, K) where
    the line is, how they change with its place (N, K), their variances (N, K), what is known of the place (N,) and
    where it would be better (N,)."""
    count = len(local)
    free, toward, variance = np.empty((count, K)), np.empty((count, K)), np.empty((count, K))
    known, shift = np.empty(count), np.empty(count)
    side, right = np.empty(ALL), np.empty((K, K + 2))
    for n in range(count):
        for i in range(ALL):
            side[i] = local[n, i, Y]
            for j in range(3):
                side[i] -= local[n, i, K + j] * step[j]
        right[:] = 0.0
        for k in range(K):
            right[k, k], right[k, K], right[k, K + 1] = 1.0, side[k], local[n, k, G]
        solve(local[n, :K, :K].copy(), right)
        known[n], shift[n] = local[n, G, G], side[G]
        for k in range(K):
            variance[n, k], free[n, k], toward[n, k] = right[k, k], right[k, K], right[k, K + 1]
            known[n] -= toward[n, k] * local[n, k, G]
            shift[n] -= toward[n, k] * side[k]
        shift[n] /= known[n]
    return free, toward, variance, known, shift


@kernel
def _left(each: np.ndarray, coefficients: np.ndarray, step: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """(N,) what coefficients (N, K), a step (3,) of the shape and moves (N,) of the place leave: roots of squares."""
    left, parts = np.empty(len(each)), np.empty(ALL)
    for n in range(len(each)):
        parts[:K], parts[K:G], parts[G], parts[Y] = -coefficients[n], -step, -moves[n], 1.0
        square = 0.0
        for i in range(ALL):
            square += parts[i] * dot(each[n, i], parts)
        left[n] = np.sqrt(max(square, 0.0))
    return left


@kernel
def _likely(over_contrast: np.ndarray, variance: np.ndarray, likely: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(K,) deviations of the coefficients (N, K) as this line shows them; `variance` (N, K) of these."""
    fresh = _LIKELY.copy()
    for k in range(1, K):
        told = (weight * np.maximum(1.0 - variance[:, k] / likely[k] ** 2, 0.0)).sum() + LIKELY_PROFILES
        square = (weight * over_contrast[:, k] ** 2).sum() + LIKELY_PROFILES * (LEAST_LIKELY * _LIKELY[k]) ** 2
        fresh[k] = min(np.sqrt(square / told), 2.0 * _LIKELY[k])
    return fresh


@kernel
def _begin(found: Crossings, width_px: float, blur_px: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Where across the path (N,) a silhouette of this width, whatever is on it, explains most; and its deviation (N,).

    The mean over all smooth courses, for between a highlight's sides many explain as much.
    """
    steps = int(np.ceil(0.6 * width_px / START_STEP_PX))
    offsets = START_STEP_PX * np.arange(-steps, steps + 1)
    left = np.empty((len(found.along), len(offsets)))
    values = blurred(width_px, blur_px, found.profiles.shape[1] // 2 + 2)
    for column in range(len(offsets)):
        each = coefficients_alone(found, np.full(len(left), offsets[column]), values)
        local = triangle_sums(each.reshape(len(left), -1), count).reshape(each.shape)
        for n in range(len(left)):
            power, explained = local[n, K, K], 0.0
            matrix, side = local[n, :K, :K].copy(), local[n, :K, K:].copy()
            for k in range(K):
                matrix[k, k] += 0.01 / _LIKELY[k] ** 2
            solve(matrix, side)
            for k in range(K):
                explained += side[k, 0] * local[n, k, K]
            left[n, column] = np.log(max(power - explained, 0.0) + MISFIT * power + 1e-9)
    return _mean_course(shares(found), found.inside, offsets, left, 0.5 * found.profiles.shape[1] * INDEPENDENT)


@kernel
def _mean_course(
    share: np.ndarray, inside: np.ndarray, offsets: np.ndarray, left: np.ndarray, sharpness: float
) -> tuple[np.ndarray, np.ndarray]:
    """The mean (N,) of smooth courses and its deviation (N,), by how little they leave (N, O) at offsets (O,)."""
    bends = np.linspace(offsets[0], offsets[-1], START_BENDS)
    shapes = np.empty((len(share), 3))
    shapes[:, 0] = (1.0 - share) * (1.0 - 2.0 * share)
    shapes[:, 1] = 4.0 * share * (1.0 - share)
    shapes[:, 2] = share * (2.0 * share - 1.0)
    every_place = max(1, len(share) // START_PROFILES)
    tried, score = np.empty((START_BENDS**3, 3)), np.zeros(START_BENDS**3)
    for c in range(len(tried)):
        tried[c, 0] = bends[c // START_BENDS**2]
        tried[c, 1], tried[c, 2] = bends[c // START_BENDS % START_BENDS], bends[c % START_BENDS]
        places = 0
        for n in range(0, len(share), every_place):
            place = shapes[n, 0] * tried[c, 0] + shapes[n, 1] * tried[c, 1] + shapes[n, 2] * tried[c, 2]
            place = (place - offsets[0]) / START_STEP_PX
            place = min(max(place, 0.0), len(offsets) - 1.001)
            row = int(place)
            if inside[n]:
                score[c] += left[n, row] + (left[n, row + 1] - left[n, row]) * (place - row)
            places += 1
        score[c] /= places
    weight = np.exp(-sharpness * (score - score.min()))
    weight /= weight.sum()
    mean, spread = np.zeros(3), np.zeros((3, 3))
    for c in range(len(tried)):
        for i in range(3):
            mean[i] += weight[c] * tried[c, i]
    for c in range(len(tried)):
        for i in range(3):
            for j in range(3):
                spread[i, j] += weight[c] * (tried[c, i] - mean[i]) * (tried[c, j] - mean[j])
    course, deviation = np.empty(len(share)), np.empty(len(share))
    for n in range(len(share)):
        square = 0.0
        for i in range(3):
            square += shapes[n, i] * dot(spread[i], shapes[n])
        course[n], deviation[n] = dot(shapes[n], mean), np.sqrt(max(square, 0.0))
    return course, deviation
