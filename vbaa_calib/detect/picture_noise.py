"""The noise of a picture of a board, measured on its black and white squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

QUANTISATION = 1.0 / 12.0
"""Variance of rounding to whole grey levels: the least noise that a picture has, even where it shows none."""
_KEPT = 0.8
"""Share of the flat pixels that count: dirt and print grain are in the rest."""
_LIMIT = float(norm.ppf(0.5 + _KEPT / 2.0))
_TRIMMING_LOSES = _KEPT / (_KEPT - 2.0 * _LIMIT * float(norm.pdf(_LIMIT)))
_FLAT = 0.2
"""Pixels within this share of the contrast from black or white are flat."""
_LEAST_PIXELS = 60
_LARGEST_SAMPLE = 40
_DIFFERENCE_VARIANCE = 36.0


@dataclass(frozen=True)
class PictureNoise:
    """Variance of a pixel's noise, linear in its grey level between black and white, as photons have it.

    Attributes
    ----------
    black, white : mean grey levels of the squares.
    black_variance, white_variance : of the noise there, grey levels squared, rounding included.
    """

    black: float
    white: float
    black_variance: float
    white_variance: float

    def variance(self, grey: np.ndarray) -> np.ndarray:
        """Noise variance at grey levels of any shape."""
        share = np.clip((grey - self.black) / max(self.white - self.black, 1.0), 0.0, 1.0)
        return self.black_variance + share * (self.white_variance - self.black_variance)


def measure_noise(image: np.ndarray, corners_px: np.ndarray, windows: np.ndarray) -> PictureNoise:
    """The noise in windows around chessboard corners (N, 2) px of half size (N,) in a picture (H, W) uint8, N ≥ 1.

    Neighbouring pixels are differenced twice along both axes, which blurred edges and uneven light do not survive.
    """
    chosen = np.linspace(0, len(corners_px) - 1, min(len(corners_px), _LARGEST_SAMPLE)).astype(int)
    grey, rough = [], []
    for window in np.unique(windows[chosen]).tolist():
        centres = np.rint(corners_px[chosen[windows[chosen] == window]]).astype(int)
        blocks = _blocks(image, centres, int(window) + 2)
        grey.append(_box(blocks).reshape(len(blocks), -1))
        rough.append(_second_difference(blocks).reshape(len(blocks), -1))
    levels = [np.percentile(block, (8.0, 92.0), axis=1)[:, :, None] for block in grey]
    black, white = (float(np.median(np.concatenate([level[i].ravel() for level in levels]))) for i in (0, 1))
    share = np.concatenate([((g - b) / np.maximum(w - b, 1.0)).ravel() for g, (b, w) in zip(grey, levels, strict=True)])
    squares = np.concatenate([block.ravel() for block in rough]) ** 2 / _DIFFERENCE_VARIANCE
    everywhere = _trimmed(squares)
    variances = [
        max(_trimmed(flat) if len(flat) >= _LEAST_PIXELS else everywhere, QUANTISATION)
        for flat in (squares[np.abs(share) < _FLAT], squares[np.abs(share - 1.0) < _FLAT])
    ]
    return PictureNoise(black, white, variances[0], variances[1])


def _blocks(image: np.ndarray, centres: np.ndarray, reach: int) -> np.ndarray:
    span = np.arange(-reach, reach + 1)
    rows = np.clip(centres[:, 1, None] + span, 0, image.shape[0] - 1)
    columns = np.clip(centres[:, 0, None] + span, 0, image.shape[1] - 1)
    return image[rows[:, :, None], columns[:, None, :]].astype(np.float32)


def _box(blocks: np.ndarray) -> np.ndarray:
    rows = blocks[:, :-2] + blocks[:, 1:-1] + blocks[:, 2:]
    return (rows[..., :-2] + rows[..., 1:-1] + rows[..., 2:]) / 9.0


def _second_difference(blocks: np.ndarray) -> np.ndarray:
    rows = blocks[:, :-2] - 2.0 * blocks[:, 1:-1] + blocks[:, 2:]
    return rows[..., :-2] - 2.0 * rows[..., 1:-1] + rows[..., 2:]


def _trimmed(squares: np.ndarray) -> float:
    """Mean of squares (N,) of normal numbers without the largest, made up for."""
    kept = max(int(_KEPT * len(squares)), 1)
    return float(np.partition(squares, kept - 1)[:kept].mean()) * _TRIMMING_LOSES
