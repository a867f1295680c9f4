"""A path drawn closer to the antenna: the best place across it, column by column, and a smooth curve through these."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from . import smooth
from .corridor import length_px, normals, resample

COLUMN_PX, COLUMNS = 2.0, 120
"""Spacing of the columns across the path, or wider where it takes more columns than these."""


@dataclass(frozen=True, eq=False)
class Aligned:
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


def align(image: np.ndarray, path_px: np.ndarray, width_px: float, reach_px: float, bright: bool) -> Aligned:
    """Move a path (K, 2) by up to `reach_px` across itself onto the antenna.

    Two rounds: over the whole reach with a stiff curve, then near that curve with a supple one.
    """
    columns, along = resample(path_px, max(COLUMN_PX, length_px(path_px) / COLUMNS))
    normal = normals(columns)
    rows = np.arange(-int(np.ceil(reach_px)), int(np.ceil(reach_px)) + 1, dtype=np.float32)
    ridge = _ridge(image, columns, normal, rows, width_px, bright)
    share = along / max(along[-1], 1e-6)
    worth = _worth(ridge)
    stiff, scale = _followed(worth, rows, share, (0.7 * reach_px, 3.0, 2.0), 6)
    near = np.abs(rows[:, None] - stiff[None]) <= max(0.6 * width_px, 3.0)
    supple, _ = _followed(worth * near, rows, share, (1.5, 0.7), 16)
    shift = np.clip(supple, rows[0], rows[-1])
    at = np.clip(np.rint(shift - rows[0]).astype(int), 0, len(rows) - 1)
    height = ridge[at, np.arange(len(shift))]
    there = worth[at, np.arange(len(shift))] > 0.5 * scale
    strength = smooth.median(height[there]) if there.any() else 0.0
    return Aligned(columns + shift[:, None] * normal, float(there.mean()), strength)


def _ridge(
    image: np.ndarray, columns: np.ndarray, normal: np.ndarray, rows: np.ndarray, width: float, bright: bool
) -> np.ndarray:
    """(R, K) float32: the mean over the antenna's width less the brighter one of the flanks."""
    core = 2 * int(0.35 * width) + 1
    flank = int(np.ceil(0.5 * width + 1.2 + 0.5 * core))
    more = np.arange(-flank, flank + 1, dtype=np.float32)
    wide = np.concatenate([rows[0] + more[:flank], rows, rows[-1] + more[flank + 1 :]])
    middle, across = columns.astype(np.float32), normal.astype(np.float32)
    u = middle[:, 0] + wide[:, None] * across[:, 0]
    v = middle[:, 1] + wide[:, None] * across[:, 1]
    strip = _sampled(image, u, v)
    mean = np.asarray(cv2.blur(strip if bright else -strip, (3, core), borderType=cv2.BORDER_REPLICATE))
    inner = mean[flank:-flank]
    return inner - np.maximum(mean[: len(inner)], mean[2 * flank :])


def _sampled(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(R, K) float32 the picture between its pixels, beyond its border as at the border."""
    height, width = image.shape
    left, top = (int(np.clip(each.min(), 0, most - 1)) for each, most in ((u, width), (v, height)))
    right, bottom = (int(np.clip(each.max() + 2, 1, most)) for each, most in ((u, width), (v, height)))
    # of whole numbers OpenCV would give whole numbers, and their rounding moves what is learned of the line's height
    part = image[top:bottom, left:right].astype(np.float32)
    return np.asarray(cv2.remap(part, u - left, v - top, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _worth(ridge: np.ndarray) -> np.ndarray:
    """(R, K) how convincing each place is: levels off at a few times what the band shows everywhere."""
    rest = smooth.median(np.abs(ridge)) * 2.0 + 1e-6
    over = np.maximum(ridge, 0.0)
    return over / (over + 3.0 * rest)


def _followed(
    worth: np.ndarray, rows: np.ndarray, share: np.ndarray, scales: tuple[float, ...], pieces: int
) -> tuple[np.ndarray, float]:
    """(K,) a smooth curve through every column's best place, and the worth of a typical one."""
    best = worth.argmax(axis=0)
    at = np.arange(worth.shape[1])
    peak = worth[best, at]
    inner = np.clip(best, 1, len(rows) - 2)
    left, middle, right = (worth[inner + k, at] for k in (-1, 0, 1))
    bend = left - 2.0 * middle + right
    part = np.where((best == inner) & (bend < -1e-6), 0.5 * (left - right) / np.minimum(bend, -1e-6), 0.0)
    scale = smooth.quantile(peak, 0.75)
    weights = np.where((best > 0) & (best < len(rows) - 1), peak**2, 0.0) + 1e-6
    curve = smooth.fit(share, rows[best] + np.clip(part, -0.5, 0.5), weights, scales, pieces, 0.3)
    return curve.values, scale
