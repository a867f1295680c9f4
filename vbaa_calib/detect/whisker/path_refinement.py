"""Path refinement: the best place across a rough path, column by column, and a smooth curve through these."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vbaa_calib.core import smooth
from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.polyline import arc_lengths, normals, resample
from vbaa_calib.core.smooth import END_VALUE, median, quantile, running_mean

COLUMN_PX, COLUMNS = 2.0, 120
"""Spacing of the columns across the path, or wider where it takes more columns than these."""
_LEAST_REST = 1e-3
"""Least texture of the strip, as a part of its highest ridge."""

CURVE_POINTS, CURVE_STEP_PX, CLAMP_PX, BENT_COST = 60, 2.0, 8.0, 0.3
"""Points and spacing of the curves that are tried, how far off they may begin at most, and what a bent one must show
more."""

_GIVEN_UP = 12
"""After so many points each, a curve is given up that the rest cannot make the clearest."""
LEAST_ALIKE, ALIKE, RIDGE_PART = 0.1, 2.0, 0.5
"""Where it is known how bright the antenna is: what a ridge of another brightness counts, deviations at which the
brightness counts a quarter, and what a ridge counts over what is as bright as the antenna and lies between other
things."""
BRANCH_SHARE, BRANCH_PX, BRANCH_AFTER, BRANCH_POINTS = 0.7, 2.0, 20, 8
"""Another curve is followed, too, if it is this part as clear and lies more than a width and so many px off the
clearest in so many of the points after the first ones."""
FAINT_COLUMNS, EDGE_COST, PEAK_ROWS = 7, 0.3, 7
"""Columns that are looked at together, what part of the square of an edge's height is no line's, and the rows of which
only the highest counts, where the polarity changes."""


class Known(NamedTuple):
    """What is known of an antenna that is looked for along a path.

    Attributes
    ----------
    clamp_px : how far off the path it may begin.
    levels : (L, 2) its usual brightness at places from clamp to tip and the deviation of that, grey levels; (0, 2)
        where not known.
    leaves_along : whether it leaves its clamp along the path: on a rig that is calibrated.
    stands_out : on a plane that was made for it: that it is bright where what lies behind it is says nothing there.
    """

    clamp_px: float = CLAMP_PX
    levels: np.ndarray = np.empty((0, 2))
    leaves_along: bool = False
    stands_out: bool = False


NOTHING_KNOWN = Known()
"""Of a rig that is not calibrated yet."""


class RefinedPath(NamedTuple):
    """A path that follows a ridge.

    Attributes
    ----------
    path_px : (K, 2).
    share : fraction of the path along which there is a ridge.
    strength : median height of the ridge where there is one, grey levels.
    other_px : (K, 2) another path, nearly as clear, that leaves this one; (0, 2) where there is none.
    clear : how clearly the antenna shows along it, where the polarity changes.
    """

    path_px: np.ndarray
    share: float
    strength: float
    other_px: np.ndarray
    clear: float


class _Columns(NamedTuple):
    """Columns across a path: their middles (K, 2) and normals (K, 2), how far along it they are (K,), px; they reach so
    far to either side, px, and flanks are looked at so much farther out."""

    points: np.ndarray
    normals: np.ndarray
    along: np.ndarray
    reach: int
    flank: int


class _Curves(NamedTuple):
    """Curves that are tried: (C, CURVE_POINTS) px, the same as indices of rows, how bent each (C,) is: 0 straight,
    1 most; and those (F, CURVE_POINTS) that are added to the best."""

    curves: np.ndarray
    rows: np.ndarray
    bent: np.ndarray
    finer: np.ndarray


def refine_path(
    image: np.ndarray,
    path_px: np.ndarray,
    width_px: float,
    reach_px: float,
    bright: bool | None,
    known: Known = NOTHING_KNOWN,
) -> RefinedPath:
    """Move a path (K, 2) by up to `reach_px` across itself onto the antenna.

    Two rounds: over the whole reach with a stiff curve, then near that curve with a supple one.
    """
    width_px, reach_px = float(width_px), float(reach_px)
    across = _columns(np.ascontiguousarray(path_px, np.float64), width_px, reach_px)
    strip = _sampled(np.ascontiguousarray(image), across)
    if bright is None:
        tried = _tried(across.reach, min(known.clamp_px, CLAMP_PX), known.leaves_along)
        return _refined_changing(strip, across, width_px, tried, known.levels)
    return _refined(strip if bright else -strip, across, width_px, reach_px)


@kernel
def _columns(path_px: np.ndarray, width_px: float, reach_px: float) -> _Columns:
    points, along = resample(path_px, max(COLUMN_PX, arc_lengths(path_px)[-1] / COLUMNS))
    flank = int(np.ceil(0.5 * width_px + 1.2 + 0.5 * _core(width_px)))
    return _Columns(points, normals(points), along, int(np.ceil(reach_px)), flank)


@kernel
def _core(width_px: float) -> int:
    """Rows in the middle of an antenna."""
    return 2 * int(0.35 * width_px) + 1


@kernel
def _sampled(image: np.ndarray, across: _Columns) -> np.ndarray:
    """(K, R + 2F) the picture (H, W) between its pixels along the columns, beyond its border as at the border.

    OpenCV's `remap` rounds places to a 32nd of a pixel: a path that moves by nothing would then see another picture.
    """
    height, width = image.shape
    wide = across.reach + across.flank
    aside, below = min(width - 1, 1), min(height - 1, 1)
    strip = np.empty((len(across.points), 2 * wide + 1))
    for k in range(len(strip)):
        for r in range(2 * wide + 1):
            u = min(max(across.points[k, 0] + (r - wide) * across.normals[k, 0], 0.0), width - 1.0)
            v = min(max(across.points[k, 1] + (r - wide) * across.normals[k, 1], 0.0), height - 1.0)
            left, top = min(max(int(u), 0), max(width - 2, 0)), min(max(int(v), 0), max(height - 2, 0))
            right, down = u - left, v - top
            near = image[top, left] * (1.0 - right) + image[top, left + aside] * right
            far = image[top + below, left] * (1.0 - right) + image[top + below, left + aside] * right
            strip[k, r] = near * (1.0 - down) + far * down
    return strip


@kernel
def _refined(strip: np.ndarray, across: _Columns, width_px: float, reach_px: float) -> RefinedPath:
    """The path along what is brighter than both flanks in a strip (K, R + 2F)."""
    ridge, flank = np.empty((len(strip), 2 * across.reach + 1)), across.flank
    strip = _mean_of_columns(strip, 3)
    for k in range(len(strip)):
        level = running_mean(strip[k], _core(width_px), END_VALUE)
        ridge[k] = level[flank:-flank] - np.maximum(level[: -2 * flank], level[2 * flank :])
    clarity = _clarity(ridge)
    stiff, scale = _smoothed(clarity, across, (0.7 * reach_px, 3.0, 2.0), 6)
    path, share, strength = _near(ridge, clarity, across, stiff, scale, width_px)
    return RefinedPath(path, share, strength, np.empty((0, 2)), 0.0)


@kernel
def _refined_changing(
    strip: np.ndarray, across: _Columns, width_px: float, tried: _Curves, levels: np.ndarray
) -> RefinedPath:
    """The same along what differs from its flanks, be it here brighter, there darker, or with a highlight at its side;
    or along what is as bright as the antenna, levels (L, 2), between other things.

    A ridge counts less by how much the flanks differ from each other, as they do at an edge.
    """
    ridge, flank = np.empty((len(strip), 2 * across.reach + 1)), across.flank
    # what is faint in a column shows in several together
    strip = _mean_of_columns(strip, FAINT_COLUMNS)
    body = 2 * int(0.5 * width_px) + 1
    for k in range(len(strip)):
        core = running_mean(strip[k], _core(width_px), END_VALUE)
        one, other = core[: -2 * flank], core[2 * flank :]
        between = 0.5 * (one + other)
        level = running_mean(strip[k], body, END_VALUE)[flank:-flank]
        square = running_mean(strip[k] ** 2, body, END_VALUE)[flank:-flank]
        power = square - 2.0 * between * level + between**2 - EDGE_COST * (one - other) ** 2
        ridge[k] = np.sqrt(np.maximum(power, 0.0))
    # power within a width is as high beside the middle: only the peak counts
    clarity = _clarity(ridge) * (ridge / np.maximum(_highest(ridge, PEAK_ROWS), 1e-9)) ** 4
    if len(levels):
        clarity = _as_bright(strip, across, width_px, levels, clarity)
    stiff, other = _clearest_curves(clarity, tried, width_px + BRANCH_PX)
    clearest = np.empty(len(clarity))
    for k in range(len(clarity)):
        clearest[k] = clarity[k].max()
    scale = quantile(clearest, 0.75)
    path, share, strength = _near(ridge, clarity, across, stiff, scale, width_px)
    branch = _near(ridge, clarity, across, other, scale, width_px)[0] if len(other) else np.empty((0, 2))
    clear = 0.0
    for k in range(len(clarity)):
        row = min(max(int(np.rint(stiff[k])) + across.reach, 1), 2 * across.reach - 1)
        clear += clarity[k, row - 1 : row + 2].max() / len(clarity)
    return RefinedPath(path, share, strength, branch, clear)


@kernel
def _as_bright(
    strip: np.ndarray, across: _Columns, width_px: float, levels: np.ndarray, clarity: np.ndarray
) -> np.ndarray:
    """(K, R) how clearly the antenna shows in a strip (K, R + 2F) whose ridges have a clarity (K, R): as bright as its
    levels (L, 2) say, between flanks that are not; or else a ridge."""
    clearer, flank = np.empty(clarity.shape), across.flank
    for k in range(len(strip)):
        usual, spread = usual_level(levels, across.along[k] / max(across.along[-1], 1e-6))
        off = running_mean((strip[k] - usual) ** 2, _core(width_px), END_VALUE) / (ALIKE * spread) ** 2
        alike = 1.0 / (1.0 + off) ** 2
        own, flanks = alike[flank:-flank], 0.5 * (alike[: -2 * flank] + alike[2 * flank :])
        clearer[k] = np.maximum(own - flanks, 0.0) + RIDGE_PART * (LEAST_ALIKE + own) * clarity[k]
    return clearer


@kernel
def usual_level(levels: np.ndarray, share: float) -> tuple[float, float]:
    """The usual brightness of an antenna and its deviation, levels (L, 2), so far from clamp to tip."""
    at = min(max(share * len(levels) - 0.5, 0.0), len(levels) - 1.0)
    near = min(int(at), len(levels) - 2)
    part = at - near
    usual = levels[near, 0] * (1.0 - part) + levels[near + 1, 0] * part
    return usual, levels[near, 1] * (1.0 - part) + levels[near + 1, 1] * part


@kernel
def _near(
    ridge: np.ndarray, clarity: np.ndarray, across: _Columns, stiff: np.ndarray, scale: float, width_px: float
) -> tuple[np.ndarray, float, float]:
    """The path near a stiff curve (K,) through ridges (K, R) of so much clarity (K, R), `scale` where it is clear; with
    its share and strength."""
    reach, reach_near = across.reach, max(0.6 * width_px, 3.0)
    nearby = np.zeros(clarity.shape)
    for k in range(len(stiff)):
        for r in range(2 * reach + 1):
            if abs(r - reach - stiff[k]) <= reach_near:
                nearby[k, r] = clarity[k, r]
    supple, _ = _smoothed(nearby, across, (1.5, 0.7), 16)
    path, height, there = across.points.copy(), np.empty(len(stiff)), np.zeros(len(stiff), np.bool_)
    for k in range(len(stiff)):
        shift = min(max(supple[k], -float(reach)), float(reach))
        at = min(max(int(np.rint(shift)) + reach, 0), 2 * reach)
        height[k], there[k] = ridge[k, at], clarity[k, at] > 0.5 * scale
        for axis in range(2):
            path[k, axis] += shift * across.normals[k, axis]
    return path, there.mean(), median(height[there]) if there.any() else 0.0


@kernel
def _mean_of_columns(strip: np.ndarray, several: int) -> np.ndarray:
    """(K, R) means of so many neighbouring columns of a strip (K, R), beyond its ends as at its ends."""
    mean, last = np.zeros(strip.shape), len(strip) - 1
    for k in range(last + 1):
        for other in range(k - several // 2, k + several // 2 + 1):
            for r in range(strip.shape[1]):
                mean[k, r] += strip[min(max(other, 0), last), r] / several
    return mean


@kernel
def _highest(values: np.ndarray, rows: int) -> np.ndarray:
    """(K, R) the highest of so many neighbours in each column of values (K, R)."""
    highest, half = np.empty(values.shape), rows // 2
    for k in range(values.shape[0]):
        for r in range(values.shape[1]):
            highest[k, r] = values[k, max(r - half, 0) : r + half + 1].max()
    return highest


@kernel
def _clarity(ridge: np.ndarray) -> np.ndarray:
    """(K, R) ridge height against texture: levels off at a few times what the strip shows everywhere."""
    over = np.maximum(ridge, 0.0)
    # where a drawn picture shows nothing at all, rounding must not look like a ridge
    rest = max(2.0 * median(np.abs(ridge)), _LEAST_REST * over.max()) + 1e-12
    return over / (over + 3.0 * rest)


@lru_cache(maxsize=8)
def _tried(reach: int, clamp_px: float, leaves_along: bool) -> _Curves:
    """The curves that are tried within ±`reach` px, and ±`clamp_px` at the clamp, which they may leave along zero."""
    curves, bent = _curves(float(reach), clamp_px, leaves_along)
    finer = 0.5 * _curves(2.0 * CURVE_STEP_PX, 2.0 * CURVE_STEP_PX, leaves_along)[0]
    return _Curves(curves, np.rint(curves + reach).astype(np.int16), bent, finer)


def _curves(reach_px: float, clamp_px: float, leaves_along: bool, most: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """(C, CURVE_POINTS) smooth curves within ±`reach_px`, and ±`clamp_px` at the clamp, in at most so many steps to
    either side; how bent each (C,) is."""
    share = np.linspace(0.0, 1.0, CURVE_POINTS)
    bow = 4.0 * share * (1.0 - share)
    parts = np.stack([1.0 - share, share, bow, 2.6 * bow * (1.0 - 2.0 * share)])
    if leaves_along:
        bow = 1.7 * bow * share
        parts[1:] = share**2, bow, 1.5 * bow * (1.0 - 1.6 * share)
    reaches = np.array([min(clamp_px, reach_px), reach_px, 0.5 * reach_px, 0.25 * reach_px])
    step = max(CURVE_STEP_PX, reach_px / most)
    steps = [step * np.arange(-(far // step), far // step + 1) for far in reaches]
    places = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, len(parts))
    curves = places @ parts
    inside = np.abs(curves).max(axis=1) <= reach_px
    return curves[inside], ((places / reaches) ** 2).mean(axis=1)[inside]


@kernel
def _clearest_curves(clarity: np.ndarray, tried: _Curves, apart_px: float) -> tuple[np.ndarray, np.ndarray]:
    """(K,) of the smooth curves through the strip (K, R) the one along which it is clearest in all; and the clearest
    that goes elsewhere, (0,) where none does that is nearly as clear.

    Where the antenna is faint no column's best place is to be trusted: only their sum along the antenna tells.
    """
    last = clarity.shape[1] - 1
    columns = np.linspace(0.0, len(clarity) - 1.0, CURVE_POINTS)
    few = np.empty((CURVE_POINTS, last + 1))
    for i in range(CURVE_POINTS):
        few[i] = clarity[int(np.rint(columns[i]))]
    thick = _highest(few, int(CURVE_STEP_PX) + 1)
    cost, rest = BENT_COST * thick.max() * CURVE_POINTS, np.zeros(CURVE_POINTS + 1)
    for i in range(CURVE_POINTS - 1, -1, -1):
        rest[i] = rest[i + 1] + thick[i].max()
    best, most = _clearest(thick, tried, cost, rest, (-1, 0.0, -np.inf))
    other, _ = _clearest(thick, tried, cost, rest, (best, apart_px, BRANCH_SHARE * most))
    at = np.arange(float(len(clarity)))
    stiff = np.interp(at, columns, _finer(few, tried, best))
    return stiff, np.interp(at, columns, _finer(few, tried, other)) if other >= 0 else np.empty(0)


@kernel
def _clearest(
    thick: np.ndarray, tried: _Curves, cost: float, rest: np.ndarray, beside: tuple[int, float, float]
) -> tuple[int, float]:
    """Which curve is the clearest, and how clear it is; -1 where none is clear enough.

    beside : which curve it must leave (-1: none), by how much, px; and how clear it must be.
    """
    known, apart_px, most = beside
    best = -1
    for c in range(len(tried.rows)):
        if known >= 0:
            far = 0
            for i in range(BRANCH_AFTER, CURVE_POINTS):
                far += abs(tried.rows[c, i] - tried.rows[known, i]) > apart_px
            if far < BRANCH_POINTS:
                continue
        total = -cost * tried.bent[c]
        for start in range(0, CURVE_POINTS, _GIVEN_UP):
            if total + rest[start] * (1.0 + 1e-9) < most:
                break
            for i in range(start, start + _GIVEN_UP):
                total += thick[i, tried.rows[c, i]]
        if total > most:
            best, most = c, total
    return best, most


@kernel
def _finer(few: np.ndarray, tried: _Curves, best: int) -> np.ndarray:
    """(CURVE_POINTS,) the clearest curve near one of those that were tried."""
    last = few.shape[1] - 1
    reach = last // 2
    finest, most = 0, -np.inf
    for f in range(len(tried.finer)):
        total = 0.0
        for i in range(CURVE_POINTS):
            row = int(np.rint(tried.curves[best, i] + tried.finer[f, i])) + reach
            total += few[i, min(max(row, 0), last)]
        if total > most:
            finest, most = f, total
    return tried.curves[best] + tried.finer[finest]


@kernel
def _smoothed(
    clarity: np.ndarray, across: _Columns, scales: tuple[float, ...], pieces: int
) -> tuple[np.ndarray, float]:
    """(K,) a smooth curve through every column's best place, and the clarity (K, R) of a typical one."""
    count, last = len(clarity), clarity.shape[1] - 1
    place, weights, peak = np.empty(count), np.zeros(count), np.empty(count)
    for k in range(count):
        best = clarity[k].argmax()
        inner = min(max(best, 1), last - 1)
        left, right = clarity[k, inner - 1], clarity[k, inner + 1]
        bend, part = left - 2.0 * clarity[k, inner] + right, 0.0
        if best == inner and bend < -1e-6:
            part = min(max(0.5 * (left - right) / bend, -0.5), 0.5)
        place[k], peak[k] = best - across.reach + part, clarity[k, best]
        if 0 < best < last:
            weights[k] = peak[k] ** 2
    share = across.along / max(across.along[-1], 1e-6)
    return smooth.fit(share, place, weights, scales, pieces, 0.3).values, quantile(peak, 0.75)
