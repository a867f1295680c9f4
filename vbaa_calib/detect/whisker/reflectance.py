"""An antenna with its own reflectance: bare steel, or a highlight at its side; bright here, dark there, as its
background there.

Across the antenna it is a polynomial that ends at the silhouette's two edges, whose distance the rig tells, seen
through blur and pixel. Its coefficients change smoothly along the antenna and may have either sign, so that bright goes
over into dark through nothing. Only edges tell where the line is: where one of them does not show, a lopsided
reflectance looks like a line that lies aside, for as long as the light stays the same. That much the place is
uncertain, alike for many neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import leg2poly
from scipy.ndimage import uniform_filter1d
from scipy.special import ndtr

from vbaa_calib.core import smooth
from vbaa_calib.core.polyline import arc_lengths

from .crossings import Crossings
from .line_shape import LIKELY_TAPER, MOST_TAPER, PER_PX, LineShape, without_background

LIKELY = np.array([3.0, 0.8, 0.8, 0.5])
"""Deviations beforehand, over the antenna's contrast, of the polynomial's coefficients: level, brighter on one side, a
highlight, and that aside."""
LEAST_LIKELY, LIKELY_PROFILES = 0.22, 10.0
"""Where a line shows nothing of them they shrink to this part; so many profiles count for what was likely before."""
LIKELY_LOG_WIDTH, LIKELY_LOG_BLUR = 0.03, 0.3
"""Deviations beforehand of the silhouette's width and blur, logarithmic."""
PIXEL_BLUR_PX = 0.29
"""A pixel's own square, as a standard deviation."""
WINDOW_PX, LEARNING = 21.0, 48
"""Over so much of its length the antenna looks alike; at least so many of its profiles are learned from at first."""
PASSES = 4
INDEPENDENT, WELL_BEGUN, ALIKE = 8.0, 60.0, 30.0
"""What the shape cannot follow is alike in many neighbours. A whole line tells as much as so many profiles where it is;
once that is about right, as so many; and of its width and blur each profile as much as one part in so many."""
QUIET = 0.4
"""Quantile of the profiles' residuals taken for what noise and a wrong shape leave."""
START_STEP_PX, START_BENDS, START_PROFILES = 0.5, 9, 24
"""At first the line is looked for at such steps, in so many places of either end and the middle, in so many
profiles."""
MISFIT, PULLED = 0.01, 0.03
"""Part of the profiles' power that no shape follows; and of the width by which what it does not follow may pull."""
STIFF_PIECES, PIECES = 4, 10
"""Of the smooth path that is begun with, and of the line's course about it."""

_K = len(LIKELY)
_DIAGONAL = np.arange(_K)
_C, _D, _G, _Y = slice(0, _K), slice(_K, _K + 3), _K + 3, _K + 4
"""Columns of a profile's normal equations: coefficients; width, blur and taper; place; grey levels."""
_CG = [*range(_K), _G]
_POWERS = np.stack([np.pad(leg2poly(row[: k + 1]), (0, _K - 1 - k)) for k, row in enumerate(np.eye(_K))])
_MEAN_SQUARE = 1.0 / (2.0 * _DIAGONAL + 1.0)


@dataclass(frozen=True, eq=False)
class Reflectance:
    """Cross-sections of N profiles.

    Attributes
    ----------
    width_px, blur_px : of the silhouette.
    coefficients : (N, K) of Legendre polynomials across it, grey levels above the background.
    reach_px : how far from the centre they are tabled.
    """

    width_px: float
    blur_px: float
    coefficients: np.ndarray
    reach_px: int

    @property
    def height(self) -> np.ndarray:
        """(N,) contrast to the background, grey levels: root mean square over the silhouette."""
        return np.sqrt(np.maximum(self.coefficients**2 @ _MEAN_SQUARE, 1e-12))

    @property
    def tables(self) -> tuple[np.ndarray, np.ndarray]:
        """The blurred polynomials and their derivatives (R, K), tabled as a `LineShape` is."""
        values = _blurred(self.width_px, self.blur_px, _rows(self.reach_px))
        return values, np.gradient(values, axis=0) * PER_PX

    def at(self, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The cross-sections over their heights, and their derivatives, at distances (N, T) from the centre, px."""
        weights = (self.coefficients / self.height[:, None])[:, :, None]
        seen = _looked_up(np.hstack(self.tables), across)
        return (seen[..., :_K] @ weights)[..., 0], (seen[..., _K:] @ weights)[..., 0]

    def shape(self, which: np.ndarray | slice) -> LineShape:
        """The mean cross-section, over its height, of some profiles."""
        mean = self.coefficients[which].mean(axis=0)
        height = np.sqrt(max(float(mean**2 @ _MEAN_SQUARE), 1e-12))
        return LineShape(*(table @ mean / height for table in self.tables))


@dataclass(frozen=True, eq=False)
class Learned:
    """What N profiles show: the reflectance, the line's course (N,) along them, the deviation (N,) of that, px, which
    neighbours share, and by which part the line is broader at the path's end."""

    reflectance: Reflectance
    course: np.ndarray
    shared_px: np.ndarray
    taper: float


def stiffened(path_px: np.ndarray) -> np.ndarray:
    """A path (K, 2) as smooth as an antenna: on bare metal a highlight that changes sides leads it to and fro."""
    along = arc_lengths(path_px)
    share, weights = along / max(float(along[-1]), 1e-6), np.ones(len(path_px))
    curves = [smooth.fit(share, path_px[:, axis], weights, (1.0, 0.5), STIFF_PIECES, 1e-6) for axis in (0, 1)]
    return np.stack([curve.values for curve in curves], axis=1)


def learn_reflectance(
    found: Crossings, width_px: float, blur_px: float, reach_px: int, about: tuple[np.ndarray, float] | None = None
) -> Learned:
    """The reflectance that profiles about a path show, and where the line is.

    about : a course (N,) along the profiles and its deviation, px, where the line is known to lie.

    Width and blur of the whole line, its course and the coefficients at every place are solved for together, from some
    of the profiles; then the coefficients from all of them.
    """
    every = max(1, len(found.along) // LEARNING)
    some, count = found.every(every), max(3, round(0.5 * WINDOW_PX / every))
    length = max(float(found.along[-1]), 1e-6)
    if about is None:
        begin, begin_std = _begin(some, width_px, blur_px, reach_px, count)
        loose = np.maximum(begin_std, START_STEP_PX) ** -2.0
    else:
        begin, begin_std = about[0][::every], np.full(len(some.along), about[1])
        loose = begin_std**-2.0
    base, moved, taper = begin, np.zeros(3), 0.0
    precision = np.array([LIKELY_LOG_WIDTH, LIKELY_LOG_BLUR, LIKELY_TAPER]) ** -2.0
    power = (without_background(some.profiles) ** 2).sum(axis=1)[some.inside] / width_px
    contrast = float(np.sqrt(smooth.quantile(power, 0.7))) + 1e-6
    noise, likely, weight = 0.1 * contrast, LIKELY, some.inside.astype(float)
    now = Reflectance(width_px, blur_px, np.zeros((len(base), _K)), reach_px)
    for turn in range(PASSES):
        each = _normal_equations(some.tapered(taper), base, now)
        local = _with_neighbours(each, weight / noise**2, count, likely * contrast)
        inverse = np.linalg.inv(local[:, _C, _C])
        step, moves = np.zeros(3), np.zeros(len(base))
        if turn:
            joint = local[:, _CG]
            left = local[:, _D] - local[:, _D][..., _CG] @ np.linalg.solve(joint[..., _CG], joint)
            told = left.sum(axis=0) / (count * ALIKE)
            step = np.linalg.solve(told[:, _D] + np.diag(precision), told[:, _Y] - moved * precision)
            step = np.clip(step, -0.3, 0.3)
            moved = moved + step
        side = local[..., _Y] - local[..., _D] @ step
        toward = (inverse @ local[:, _C, _G, None])[..., 0]
        known = local[:, _G, _G] - (toward * local[:, _C, _G]).sum(axis=1)
        if turn:
            shift = np.clip((side[:, _G] - (toward * side[:, _C]).sum(axis=1)) / known, -1.0, 1.0)
            told = weight * known * (WELL_BEGUN / len(found.along))
            target = (told * (base + shift) + loose * begin) / (told + loose)
            course = smooth.fit(some.along / length, target, told + loose, (1.0, 0.5), PIECES, 1e-3).values
            moves, base = course - base, course
        coefficients = (inverse @ (side[:, _C] - local[:, _C, _G] * moves[:, None])[..., None])[..., 0]
        parts = np.column_stack([-coefficients, np.tile(-step, (len(base), 1)), -moves, np.ones(len(base))])
        squares = ((each @ parts[..., None])[..., 0] * parts).sum(axis=1)
        rms = np.sqrt(np.maximum(squares, 0.0) / (some.across.shape[1] - 4))
        noise = max(smooth.quantile(rms[some.inside], QUIET), 1e-3 * contrast)
        weight = some.inside / (1.0 + (rms / (3.0 * noise)) ** 2)
        contrast = float(np.sqrt(weight @ (coefficients**2 @ _MEAN_SQUARE) / max(float(weight.sum()), 1e-9))) + 1e-6
        if turn:
            likely = _likely(coefficients / contrast, inverse[:, _DIAGONAL, _DIAGONAL] / contrast**2, likely, weight)
        width, blur = width_px * np.exp(moved[0]), blur_px * np.exp(moved[1])
        taper = float(np.clip(moved[2], -MOST_TAPER, MOST_TAPER))
        now = Reflectance(float(width), float(blur), coefficients, reach_px)

    def everywhere(values: np.ndarray) -> np.ndarray:
        return np.interp(found.along, some.along, values)

    whole = replace(now, coefficients=np.stack([everywhere(column) for column in now.coefficients.T], axis=1))
    course = everywhere(base)
    each = _normal_equations(found.tapered(taper), course, whole, place=False)
    local = _with_neighbours(
        each, everywhere(weight) * found.inside / noise**2, round(0.5 * WINDOW_PX), likely * contrast
    )
    solved = np.linalg.solve(local[:, _C, _C], local[:, _C, -1:])[..., 0]
    shared = (PIECES + 3.0) / max(WELL_BEGUN * float(known.mean()) / count, 1e-9)
    shared_px = np.sqrt(shared + everywhere(begin_std) ** 2 + (PULLED * width_px) ** 2)
    return Learned(replace(whole, coefficients=solved), course, shared_px / found.stretch, taper)


def _blurred(width_px: float, blur_px: float, across_px: np.ndarray) -> np.ndarray:
    """(R, K) Legendre polynomials over the silhouette, blurred, at distances (R,) from its centre.

    By the recurrence of the powers' convolution with a bell over an interval.
    """
    half, variance = 0.5 * width_px, blur_px**2 + PIXEL_BLUR_PX**2
    std = np.sqrt(variance)
    left, right = (across_px + half) / std, (across_px - half) / std
    rising, falling = (np.exp(-0.5 * edge**2) / (np.sqrt(2.0 * np.pi) * std) for edge in (left, right))
    powers = [ndtr(left) - ndtr(right)]
    for k in range(_K - 1):
        before = k * powers[k - 1] if k else 0.0
        ends = half**k * falling - (-half) ** k * rising
        powers.append(across_px * powers[k] + variance * (before - ends))
    return np.stack([power / half**k for k, power in enumerate(powers)], axis=-1) @ _POWERS.T


def _rows(reach_px: int) -> np.ndarray:
    return np.arange(-reach_px * PER_PX, reach_px * PER_PX + 1) / PER_PX


def _looked_up(table: np.ndarray, across: np.ndarray) -> np.ndarray:
    """(N, T, C) of a table (R, C) with its middle row at 0 px, linear between rows."""
    last = len(table) - 1
    place = np.clip(across * PER_PX + 0.5 * last, 0.0, last - 1e-6)
    row = place.astype(np.intp)
    first = table.take(row, axis=0)
    return first + (table.take(row + 1, axis=0) - first) * (place - row)[..., None]


def _normal_equations(found: Crossings, base: np.ndarray, now: Reflectance, place: bool = True) -> np.ndarray:
    """(N, K + 5, K + 5) products of every profile's columns, less the background's level and slope; with `place` False
    (N, K + 1, K + 1), of coefficients and grey levels only."""
    across = found.distances(base)
    values, slopes = now.tables
    if not place:
        rows = [np.moveaxis(_looked_up(values, across), 2, 1), found.profiles[:, None]]
    else:
        at = _rows(now.reach_px)
        nudged = (_blurred(now.width_px * 1.02, now.blur_px, at), _blurred(now.width_px, now.blur_px * 1.02, at))
        table = np.hstack([values, slopes, *((other - values) / 0.02 for other in nudged)])
        seen = _looked_up(table, across).reshape(*across.shape, 4, _K)
        slope, wider, softer = np.moveaxis((seen[:, :, 1:] @ now.coefficients[:, None, :, None])[..., 0], 2, 0)
        share = (found.along / max(float(found.along[-1]), 1e-6) - 0.5)[:, None]
        by_place = slope * (-found.side / found.stretch)[:, None]
        rows = [
            np.moveaxis(seen[:, :, 0], 2, 1),
            np.stack([wider, softer, wider * share, by_place, found.profiles], axis=1),
        ]
    whole = np.concatenate(rows, axis=1)
    flat = without_background(whole.reshape(-1, across.shape[1])).reshape(whole.shape)
    return flat @ flat.mT * found.inside[:, None, None]


def _sums(values: np.ndarray, count: int) -> np.ndarray:
    """Sums (N, ...) over a triangle of neighbours whose weight in the middle is one."""
    for _ in range(2):
        values = uniform_filter1d(values, count, axis=0, mode="constant")
    return count * values


def _with_neighbours(each: np.ndarray, weight: np.ndarray, count: int, likely: np.ndarray) -> np.ndarray:
    """Normal equations (N, ...) summed over neighbours, with the prior of the coefficients."""
    local = _sums(each * weight[:, None, None], count)
    local[:, _DIAGONAL, _DIAGONAL] += likely**-2.0
    if local.shape[1] > _G:
        local[:, _G, _G] += 1.0 / START_STEP_PX**2
    return local


def _likely(over_contrast: np.ndarray, variance: np.ndarray, likely: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(K,) deviations of the coefficients (N, K) as this line shows them; `variance` (N, K) of these."""
    told = np.maximum(1.0 - variance / likely**2, 0.0)
    square = weight @ over_contrast**2 + LIKELY_PROFILES * (LEAST_LIKELY * LIKELY) ** 2
    fresh = np.sqrt(square / (weight @ told + LIKELY_PROFILES))
    return np.append(LIKELY[0], np.minimum(fresh, 2.0 * LIKELY)[1:])


def _begin(
    found: Crossings, width_px: float, blur_px: float, reach_px: int, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Where across the path (N,) a silhouette of this width, whatever is on it, explains most; and its deviation (N,).

    The mean over all smooth courses, for between a highlight's sides many explain as much.
    """
    steps = int(np.ceil(0.6 * width_px / START_STEP_PX))
    offsets = START_STEP_PX * np.arange(-steps, steps + 1)
    table = _blurred(width_px, blur_px, _rows(reach_px))
    grey = without_background(found.profiles) * found.inside[:, None]
    power = _sums((grey**2).sum(axis=1), count)
    left = np.empty((len(grey), len(offsets)))
    for column, offset in enumerate(offsets):
        shapes = np.moveaxis(_looked_up(table, found.distances(np.full(len(grey), offset))), 2, 1)
        shapes = without_background(shapes.reshape(-1, shapes.shape[2])).reshape(shapes.shape)
        matrix, side = _sums(shapes @ shapes.mT, count), _sums((shapes @ grey[..., None])[..., 0], count)
        matrix[:, _DIAGONAL, _DIAGONAL] += 0.01 / LIKELY**2
        explained = (side * np.linalg.solve(matrix, side[..., None])[..., 0]).sum(axis=1)
        left[:, column] = np.log(np.maximum(power - explained, 0.0) + MISFIT * power + 1e-9)
    share = found.along / max(float(found.along[-1]), 1e-6)
    shapes = np.stack([(1.0 - share) * (1.0 - 2.0 * share), 4.0 * share * (1.0 - share), share * (2.0 * share - 1.0)])
    bends = np.linspace(offsets[0], offsets[-1], START_BENDS)
    tried = np.stack([grid.ravel() for grid in np.meshgrid(bends, bends, bends, indexing="ij")])
    few = slice(None, None, max(1, len(share) // START_PROFILES))
    place = np.clip((shapes.T[few] @ tried - offsets[0]) / START_STEP_PX, 0.0, len(offsets) - 1.001)
    row = place.astype(np.intp)
    before, after = (np.take_along_axis(left[few], row + k, axis=1) for k in (0, 1))
    score = (found.inside[few, None] * (before + (after - before) * (place - row))).mean(axis=0)
    weight = np.exp(-0.5 * grey.shape[1] * INDEPENDENT * (score - score.min()))
    weight /= weight.sum()
    mean = tried @ weight
    apart = tried - mean[:, None]
    variance = np.einsum("in,ij,jn->n", shapes, (apart * weight) @ apart.T, shapes)
    return mean @ shapes, np.sqrt(np.maximum(variance, 0.0))
