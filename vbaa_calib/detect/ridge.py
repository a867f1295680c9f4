"""Where a small picture looks like a line: brighter than what lies a line's width away on either side."""

from __future__ import annotations

import cv2
import numpy as np

from .templates import STEPS

ORDINARY = 0.8
"""Quantile of the response that counts as the surroundings' own texture."""


def reduced(image: np.ndarray, factor: int) -> np.ndarray:
    """(h, w) uint8: blocks of `factor` pixels averaged; other depths than 8 bits are stretched to the full range."""
    height, width = image.shape
    size = (max(width // factor, 1), max(height // factor, 1))
    cropped = image[: size[1] * factor, : size[0] * factor] if min(size) > 1 else image
    small = cv2.resize(cropped, size, interpolation=cv2.INTER_AREA)
    if small.dtype == np.uint8:
        return small
    values = np.nan_to_num(np.asarray(small, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    low, high = float(values.min()), float(values.max())
    return cv2.convertScaleAbs(values - low, alpha=255.0 / max(high - low, 1e-6))


def responses(small: np.ndarray, reach: int, pool: int) -> np.ndarray:
    """(4 · h · w + 1,) uint8 ridge response for the four normals, pooled over `pool` pixels, flat; the last is zero.

    small (H, W) uint8, bright line; the flanks are looked at `reach` pixels away. The answer saturates where a ridge
    is clear, so that a brighter one buys no detour.
    """
    height, width = small.shape
    framed = cv2.copyMakeBorder(small, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    diagonal = int(np.ceil(reach / np.sqrt(2.0)))
    square = np.ones((2 * pool - 1, 2 * pool - 1), np.uint8)
    shape = (-(-height // pool), -(-width // pool))
    flat = np.zeros(len(STEPS) * shape[0] * shape[1] + 1, np.uint8)
    layers = flat[:-1].reshape(len(STEPS), *shape)
    for step, layer in zip(STEPS.tolist(), layers, strict=True):
        far = diagonal if step[0] and step[1] else reach
        u, v = far * step[0], far * step[1]
        flanks = [
            framed[reach + s * v : reach + s * v + height, reach + s * u : reach + s * u + width] for s in (-1, 1)
        ]
        ridge = cv2.subtract(small, cv2.max(*flanks))
        layer[:] = (cv2.dilate(ridge, square) if pool > 1 else ridge)[::pool, ::pool]
    return cv2.LUT(flat, _saturation(flat)).ravel()


def _saturation(flat: np.ndarray) -> np.ndarray:
    """(256,) the response's worth: none for what the surroundings show everywhere, and level at a few times that."""
    counts = np.bincount(flat[:: 1 + len(flat) // 20_000], minlength=256).cumsum()
    ordinary = float(np.searchsorted(counts, ORDINARY * counts[-1])) + 1.0
    over = np.maximum(np.arange(256.0) - ordinary, 0.0)
    return np.rint(250.0 * over / (over + 3.0 * ordinary)).astype(np.uint8)
