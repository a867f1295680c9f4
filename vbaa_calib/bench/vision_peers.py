"""What others use to find a thin line in a picture: thinning, a ridge filter, the centroid of every column."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from ..detect.corridor import Corridor

Peer = Callable[[np.ndarray], np.ndarray]
"""(H, W) uint8 picture of a bright antenna → points (N, 2), px."""


def within(corridor: Corridor, size: tuple[int, int]) -> np.ndarray:
    """(H, W) uint8 mask of a corridor: peers get the same knowledge of where to look; it is no part of their time."""
    across = np.gradient(corridor.axis_px, axis=0)[:, ::-1] * [-1.0, 1.0]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    sides = [corridor.axis_px + sign * corridor.reach_px[:, None] * across for sign in (1, -1)]
    outline = np.concatenate([sides[0], sides[1][::-1]])
    mask = np.zeros(size[::-1], np.uint8)
    cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 255)
    return mask


def peers(corridor: Corridor, size: tuple[int, int]) -> dict[str, Peer]:
    """Name → method, prepared for one corridor."""
    mask = within(corridor, size)
    ridge_filter = cv2.ximgproc.RidgeDetectionFilter.create(cv2.CV_32FC1, 1, 1, 3, cv2.CV_8UC1)

    def otsu(image: np.ndarray) -> np.ndarray:
        return cv2.bitwise_and(cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[1], mask)

    def thinning(image: np.ndarray) -> np.ndarray:
        rows, columns = np.nonzero(cv2.ximgproc.thinning(otsu(image)))
        return np.stack([columns, rows], axis=1).astype(float)

    def ridges(image: np.ndarray) -> np.ndarray:
        smooth = cv2.GaussianBlur(image, (0, 0), max(0.5 * corridor.width_px, 1.0))
        return _peaks(cv2.bitwise_and(ridge_filter.getRidgeFilteredImage(255 - smooth), mask))

    def centroid(image: np.ndarray) -> np.ndarray:
        ground = cv2.mean(image, mask)[0]
        lit = np.where(otsu(image) > 0, image.astype(np.float32) - np.float32(ground), np.float32(0.0))
        total = lit.sum(axis=0)
        columns = np.flatnonzero(total > 0)
        rows = (np.arange(len(lit), dtype=np.float32) @ lit)[columns] / total[columns]
        return np.stack([columns, rows], axis=1).astype(float)

    return {"cv2.ximgproc.thinning": thinning, "RidgeDetectionFilter": ridges, "centroid per column": centroid}


def _peaks(ridge: np.ndarray) -> np.ndarray:
    """The strongest place of every column, to a part of a pixel by a parabola."""
    rows = ridge.argmax(axis=0)
    columns = np.flatnonzero((ridge.max(axis=0) > 0) & (rows > 0) & (rows < len(ridge) - 1))
    rows = rows[columns]
    low, middle, high = (ridge[rows + k, columns].astype(float) for k in (-1, 0, 1))
    bend = np.minimum(low - 2.0 * middle + high, -1e-6)
    return np.stack([columns, rows + np.clip(0.5 * (low - high) / bend, -0.5, 0.5)], axis=1)
