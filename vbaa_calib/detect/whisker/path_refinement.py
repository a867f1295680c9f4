"""Path refinement: the best place across a rough path, column by column, and a smooth curve through these."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from . import smooth
from .corridor import arc_lengths_px, normals, resample

COLUMN_PX, COLUMNS = 2.0, 120
"""Spacing of the columns across the path, or wider where it takes more columns than these."""
LEAST_REST = 1e-3
"""Least texture of the strip, as a part of its highest ridge."""


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
    columns, along = resample(path_px, max(COLUMN_PX, arc_lengths_px(path_px)[-1] / COLUMNS))
    normal = normals(columns)
    rows = np.arange(-np.ceil(reach_px), np.ceil(reach_px) + 1)
    ridge = _ridge(image, columns, normal, rows, width_px, bright)
    share = along / max(along[-1], 1e-6)
    clarity = _clarity(ridge)
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
    """(R, K): the mean over the antenna's width less the brighter one of the flanks; for a dark line the reverse."""
    core = 2 * int(0.35 * width) + 1
    flank = int(np.ceil(0.5 * width + 1.2 + 0.5 * core))
    wide = np.arange(rows[0] - flank, rows[-1] + flank + 1)
    strip = _sampled(image, *(columns[:, axis] + wide[:, None] * normal[:, axis] for axis in (0, 1)))
    mean = np.asarray(cv2.blur(strip if bright is not False else -strip, (3, core), borderType=cv2.BORDER_REPLICATE))
    inner = mean[flank:-flank]
    flanks = mean[: len(inner)], mean[2 * flank :]
    bright_ridge = inner - np.maximum(*flanks)
    return bright_ridge if bright is not None else np.maximum(bright_ridge, np.minimum(*flanks) - inner)


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
