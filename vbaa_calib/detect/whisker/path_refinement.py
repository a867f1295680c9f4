"""Path refinement: the best place across a rough path, column by column, and a smooth curve through these."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from vbaa_calib.core import smooth
from vbaa_calib.core.polyline import arc_lengths, normals, resample

COLUMN_PX, COLUMNS = 2.0, 120
"""Spacing of the columns across the path, or wider where it takes more columns than these."""
LEAST_REST = 1e-3
"""Least texture of the strip, as a part of its highest ridge."""

CURVE_POINTS, CURVE_STEP_PX, CLAMP_PX, BENT_COST = 60, 2.0, 8.0, 0.3
"""Points and spacing of the curves that are tried, how far off they may begin, and what a bent one must show more."""

FAINT_COLUMNS, EDGE_COST, PEAK_ROWS = 7, 0.3, 7
"""Columns that are looked at together, what part of the square of an edge's height is no line's, and the rows of which
only the highest counts, where the polarity changes."""


@dataclass(frozen=True, eq=False)
class RefinedPath:
    """A path that follows a ridge.

    Attributes
    ----------
    path_px : (K, 2).
    share : fraction of the path along which there is a ridge.
    strength : median height of the ridge where there is one, grey levels.
    """

    path_px: np.ndarray
    share: float
    strength: float


def refine_path(
    image: np.ndarray, path_px: np.ndarray, width_px: float, reach_px: float, bright: bool | None
) -> RefinedPath:
    """Move a path (K, 2) by up to `reach_px` across itself onto the antenna.

    Two rounds: over the whole reach with a stiff curve, then near that curve with a supple one.
    """
    columns, along = resample(path_px, max(COLUMN_PX, arc_lengths(path_px)[-1] / COLUMNS))
    normal = normals(columns)
    rows = np.arange(-np.ceil(reach_px), np.ceil(reach_px) + 1)
    ridge = _ridge(image, columns, normal, rows, width_px, bright)
    share = along / max(along[-1], 1e-6)
    clarity = _clarity(ridge)
    if bright is None:
        # power within a width is as high beside the middle: only the peak counts
        clarity = clarity * (ridge / np.maximum(cv2.dilate(ridge, np.ones((PEAK_ROWS, 1))), 1e-9)) ** 4
        stiff, scale = _clearest_curve(clarity, rows), smooth.quantile(clarity.max(axis=0), 0.75)
    else:
        stiff, scale = _smoothed(clarity, rows, share, (0.7 * reach_px, 3.0, 2.0), 6)
    near = np.abs(rows[:, None] - stiff[None]) <= max(0.6 * width_px, 3.0)
    supple, _ = _smoothed(clarity * near, rows, share, (1.5, 0.7), 16)
    shift = np.clip(supple, rows[0], rows[-1])
    at = np.clip(np.rint(shift - rows[0]).astype(int), 0, len(rows) - 1)
    height = ridge[at, np.arange(len(shift))]
    there = clarity[at, np.arange(len(shift))] > 0.5 * scale
    strength = smooth.median(height[there]) if there.any() else 0.0
    return RefinedPath(columns + shift[:, None] * normal, float(there.mean()), strength)


def _ridge(
    image: np.ndarray, columns: np.ndarray, normal: np.ndarray, rows: np.ndarray, width: float, bright: bool | None
) -> np.ndarray:
    """(R, K): the mean over the antenna's width less the brighter one of the flanks; for a dark line the reverse.

    With `bright` None by how much the antenna's width differs from its flanks, be it here brighter, there darker, or
    with a highlight at its side; less by how much these differ from each other, as they do at an edge.
    """
    core = 2 * int(0.35 * width) + 1
    flank = int(np.ceil(0.5 * width + 1.2 + 0.5 * core))
    wide = np.arange(rows[0] - flank, rows[-1] + flank + 1)
    strip = _sampled(image, *(columns[:, axis] + wide[:, None] * normal[:, axis] for axis in (0, 1)))

    def mean(values: np.ndarray, columns: int, rows: int) -> np.ndarray:
        return np.asarray(cv2.blur(values, (columns, rows), borderType=cv2.BORDER_REPLICATE))

    def flanks(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return values[: -2 * flank], values[2 * flank :]

    if bright is not None:
        level = mean(strip if bright else -strip, 3, core)
        return level[flank:-flank] - np.maximum(*flanks(level))
    # what is faint in a column shows in several together
    strip = mean(strip, FAINT_COLUMNS, 1)
    one, other = flanks(mean(strip, 1, core))
    body = 2 * int(0.5 * width) + 1
    between = 0.5 * (one + other)
    level, square = (mean(values, 1, body)[flank:-flank] for values in (strip, strip**2))
    power = square - 2.0 * between * level + between**2 - EDGE_COST * (one - other) ** 2
    return np.sqrt(np.maximum(power, 0.0))


def _sampled(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(R, K) the picture between its pixels, beyond its border as at the border.

    OpenCV's `remap` rounds places to a 32nd of a pixel: a path that moves by nothing would then see another picture.
    """
    height, width = image.shape
    u, v = np.clip(u, 0.0, width - 1.0), np.clip(v, 0.0, height - 1.0)
    left, top = (
        np.minimum(u.astype(np.intp), max(width - 2, 0)),
        np.minimum(v.astype(np.intp), max(height - 2, 0)),
    )
    flat, first = np.ascontiguousarray(image).ravel(), top * width + left
    right, down = u - left, v - top
    aside, below = min(width - 1, 1), width * min(height - 1, 1)
    near, far = (
        flat.take(first + step) * (1.0 - right) + flat.take(first + step + aside) * right for step in (0, below)
    )
    return np.asarray(near * (1.0 - down) + far * down)


def _clarity(ridge: np.ndarray) -> np.ndarray:
    """(R, K) ridge height against texture: levels off at a few times what the strip shows everywhere."""
    over = np.maximum(ridge, 0.0)
    # where a drawn picture shows nothing at all, rounding must not look like a ridge
    rest = max(2.0 * smooth.median(np.abs(ridge)), LEAST_REST * float(over.max())) + 1e-12
    return over / (over + 3.0 * rest)


@lru_cache(maxsize=4)
def _curves(reach_px: float) -> tuple[np.ndarray, np.ndarray]:
    """(C, CURVE_POINTS) smooth curves within ±`reach_px`, and how bent each (C,) is: 0 straight, 1 most."""
    share = np.linspace(0.0, 1.0, CURVE_POINTS)
    bow = 4.0 * share * (1.0 - share)
    parts = np.stack([1.0 - share, share, bow, 2.6 * bow * (1.0 - 2.0 * share)])
    reaches = np.array([min(CLAMP_PX, reach_px), reach_px, 0.5 * reach_px, 0.25 * reach_px])
    steps = [CURVE_STEP_PX * np.arange(-(far // CURVE_STEP_PX), far // CURVE_STEP_PX + 1) for far in reaches]
    places = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, len(parts))
    curves = places @ parts
    inside = np.abs(curves).max(axis=1) <= reach_px
    return curves[inside], ((places / reaches) ** 2).mean(axis=1)[inside]


def _clearest_curve(clarity: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(K,) of the smooth curves through the strip (R, K) the one along which it is clearest in all.

    Where the antenna is faint no column's best place is to be trusted: only their sum along the antenna tells.
    """
    columns = np.linspace(0, clarity.shape[1] - 1, CURVE_POINTS)
    few = clarity[:, np.rint(columns).astype(np.intp)]
    thick = cv2.dilate(few, np.ones((int(CURVE_STEP_PX) + 1, 1)))
    curves, bent = _curves(float(rows[-1]))
    along = np.arange(CURVE_POINTS)

    def total(seen: np.ndarray, tried: np.ndarray) -> np.ndarray:
        at = np.clip(np.rint(tried - rows[0]), 0, len(rows) - 1).astype(np.intp)
        return seen.ravel().take(at * CURVE_POINTS + along).mean(axis=1)

    best = curves[int((total(thick, curves) - BENT_COST * bent * thick.max()).argmax())]
    finer = best + 0.5 * _curves(2.0 * CURVE_STEP_PX)[0]
    best = finer[int(total(few, finer).argmax())]
    return np.interp(np.arange(clarity.shape[1]), columns, best)


def _smoothed(
    clarity: np.ndarray, rows: np.ndarray, share: np.ndarray, scales: tuple[float, ...], pieces: int
) -> tuple[np.ndarray, float]:
    """(K,) a smooth curve through every column's best place, and the clarity of a typical one."""
    best = clarity.argmax(axis=0)
    at = np.arange(clarity.shape[1])
    peak = clarity[best, at]
    inner = np.clip(best, 1, len(rows) - 2)
    left, middle, right = (clarity[inner + k, at] for k in (-1, 0, 1))
    bend = left - 2.0 * middle + right
    part = np.where((best == inner) & (bend < -1e-6), 0.5 * (left - right) / np.minimum(bend, -1e-6), 0.0)
    scale = smooth.quantile(peak, 0.75)
    weights = np.where((best > 0) & (best < len(rows) - 1), peak**2, 0.0)
    curve = smooth.fit(share, rows[best] + np.clip(part, -0.5, 0.5), weights, scales, pieces, 0.3)
    return curve.values, scale
