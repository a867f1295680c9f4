"""Find the antenna roughly: a path of ridge response through the corridor that the antenna can reach."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

COLUMN_PX = 1.5
"""Spacing of the corridor's columns along the axis."""
STEEPEST = 3
"""Most rows that the path may climb from one column to the next: 63° against the axis."""
CLIMB_COST = 0.25
"""What a climb of one row per column costs, in noise units of ridge response."""
CLIP = 12.0
"""Response above which a ridge is no more convincing; keeps a bright edge from buying a detour."""


@dataclass(frozen=True, eq=False)
class Corridor:
    """Where the antenna can be in the picture.

    Attributes
    ----------
    axis_px : (M, 2) the free antenna from clamp to tip, pixels.
    reach_px : (M,) how far to either side it can be at each of these points.
    width_px : the antenna's width.
    """

    axis_px: np.ndarray
    reach_px: np.ndarray
    width_px: float


def resample(polyline: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (K, 2) at equal spacing along a polyline, and the arc length (K,) of each."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(polyline, axis=0).T))])
    at = np.arange(0.0, along[-1], spacing)
    return np.stack([np.interp(at, along, polyline[:, i]) for i in range(2)], axis=1), at


def normals(polyline: np.ndarray) -> np.ndarray:
    """(K, 2) unit normals of a polyline with smooth directions."""
    tangent = np.gradient(polyline, axis=0)
    tangent /= np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)


def _ridge_kernel(width_px: float) -> np.ndarray:
    """Second derivative of a Gaussian, negated, zero mean: answers to a line, not to an edge or a slope of light."""
    sigma = max(0.5 * width_px, 1.1)
    radius = int(np.ceil(4 * sigma))
    t = np.arange(-radius, radius + 1)
    kernel = (1 - (t / sigma) ** 2) * np.exp(-0.5 * (t / sigma) ** 2)
    return kernel - kernel.mean()


def _response(image: np.ndarray, columns: np.ndarray, normal: np.ndarray, rows: np.ndarray, width: float) -> np.ndarray:
    """(R, K) ridge response over the corridor, in units of its own noise."""
    where = (columns[None] + rows[:, None, None] * normal[None]).astype(np.float32)
    strip = cv2.remap(image, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    ridge = cv2.filter2D(strip, cv2.CV_32F, _ridge_kernel(width).astype(np.float32)[:, None])
    ridge = cv2.GaussianBlur(ridge, (5, 1), 1.0)
    height, width_all = image.shape
    inside = (where[..., 0] >= 0) & (where[..., 0] < width_all) & (where[..., 1] >= 0) & (where[..., 1] < height)
    noise = 1.4826 * np.median(np.abs(ridge[inside])) if inside.any() else 0.0
    return np.where(inside, ridge / max(noise, 1e-3), 0.0)


def _best_path(gain: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(K,) rows of the path of greatest summed gain (R, K) from the first column, starting with scores (R,)."""
    climbs = np.arange(-STEEPEST, STEEPEST + 1)
    rows, columns = gain.shape
    came = np.zeros((columns, rows), np.int8)
    score = start + gain[:, 0]
    padded = np.full(rows + 2 * STEEPEST, -np.inf)
    for column in range(1, columns):
        padded[STEEPEST:-STEEPEST] = score
        options = np.lib.stride_tricks.sliding_window_view(padded, len(climbs)) - CLIMB_COST * climbs**2
        choice = options.argmax(axis=1)
        came[column] = climbs[choice]
        score = options[np.arange(rows), choice] + gain[:, column]
    path = np.empty(columns, int)
    path[-1] = int(score.argmax())
    for column in range(columns - 1, 0, -1):
        path[column - 1] = path[column] + came[column, path[column]]
    return path


def trace(image: np.ndarray, corridor: Corridor, bright: bool = True) -> np.ndarray:
    """(K, 2) rough path of the antenna from clamp to tip, pixels. There is always one; `profile.measure` judges it.

    image (H, W) float32. Hidden stretches are bridged by the path that costs least.
    """
    columns, along = resample(corridor.axis_px, COLUMN_PX)
    normal = normals(columns)
    original = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corridor.axis_px, axis=0).T))])
    reach = np.interp(along, original, corridor.reach_px)
    rows = np.arange(-int(reach.max()) - 1, int(reach.max()) + 2)
    gain = _response(image if bright else -image, columns, normal, rows, corridor.width_px)
    gain = np.where(np.abs(rows)[:, None] <= reach[None] + 1, np.clip(gain, 0.0, CLIP), -CLIP)
    path = rows[_best_path(gain, -np.abs(rows).astype(float))]
    return columns + gaussian_filter1d(path.astype(float), 2.0, mode="nearest")[:, None] * normal
