"""How far noise moves a corner: the picture's noise carried through the equations that `cv2.cornerSubPix` solves.

That corner p is where f = Σ w(r) g gᵀ r = 0, over the samples at r from it in a window that moves with it; g are the
grey levels' central differences, w = exp(−|r|²/window²). Noise δI changes f by Σ w (δg gᵀ r + g δgᵀ r), a weighted sum
A δI over the pixels, and a step δp of the window changes it by A ∂I/∂p δp: δp = −J⁻¹ A δI with J = A ∂I/∂p, and the
covariance is J⁻¹ A var(I) Aᵀ J⁻ᵀ. J is near M = −Σ w g gᵀ where the window is wide for the blur, and smaller elsewhere.
"""

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


_LEAST_FIXED = 1e-4
"""Least determinant of M over its trace squared for a window to show a corner at all."""
_LEAST_SHARE = 0.25
"""Least part of M that J is taken to keep."""


def corner_covariances(image: np.ndarray, corners_px: np.ndarray, windows: np.ndarray) -> np.ndarray:
    """(N, 2, 2) px² covariance of corners (N, 2) px that `cv2.cornerSubPix` refined with half windows (N,).

    image : (H, W) uint8. A window that shows no corner gives its own size. Noise is taken as independent from pixel to
    pixel: where JPEG or a camera's own smoothing ties neighbours together the truth is larger. The detector's bias is
    not in it: up to 0.03 px in sharp pictures, where it outweighs noise below about 3 grey levels.
    """
    found = np.zeros((len(corners_px), 2, 2))
    if not len(corners_px):
        return found
    noise = measure_noise(image, corners_px, windows)
    for window in np.unique(windows).tolist():
        chosen = np.flatnonzero(windows == window)
        found[chosen] = _of_one_size(image, corners_px[chosen], window, noise)
    return found


def _of_one_size(image: np.ndarray, corners_px: np.ndarray, window: int, noise: PictureNoise) -> np.ndarray:
    base = np.floor(corners_px).astype(int)
    part = (corners_px - base).astype(np.float32)[:, :, None, None]
    pixels = _corner_blocks(image, base, window + 1)
    samples = _bilinear(pixels, part)
    gradient = 0.5 * np.stack(
        [samples[:, 1:-1, 2:] - samples[:, 1:-1, :-2], samples[:, 2:, 1:-1] - samples[:, :-2, 1:-1]], axis=1
    )
    offset = np.arange(-window, window + 1, dtype=np.float32)
    r = np.stack(np.meshgrid(offset, offset))
    weight = np.exp(-(r**2).sum(axis=0) / window**2)
    curvature = _products(weight * gradient, gradient)
    along = (gradient * r).sum(axis=1)
    by_gradient = weight * gradient[:, :, None] * r[None, None]
    by_gradient[:, 0, 0] += weight * along
    by_gradient[:, 1, 1] += weight * along
    by_sample = _differenced(by_gradient)
    by_pixel = _gathered(by_sample, part)
    by_shift = _products(by_sample, _slopes(pixels, part))
    scatter = _products(noise.variance(pixels)[:, None] * by_pixel, by_pixel)
    return _sandwich(by_shift, curvature, scatter, window)


def _products(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N, 2, 2) sums over the pixels of products of (N, 2, K, K) and (N, 2, K, K)."""
    shape = (len(first), 2, -1)
    return (first.reshape(shape) @ second.reshape(shape).transpose(0, 2, 1)).astype(float)


def _corner_blocks(image: np.ndarray, base: np.ndarray, reach: int) -> np.ndarray:
    """(N, 2 reach + 2, 2 reach + 2) pixels around base (N, 2); beyond the border the last pixel goes on."""
    span = np.arange(-reach, reach + 2)
    rows = np.clip(base[:, 1, None] + span, 0, image.shape[0] - 1)
    columns = np.clip(base[:, 0, None] + span, 0, image.shape[1] - 1)
    return image[rows[:, :, None], columns[:, None, :]].astype(np.float32)


def _bilinear(pixels: np.ndarray, part: np.ndarray) -> np.ndarray:
    u, v = part[:, 0], part[:, 1]
    upper = (1 - u) * pixels[:, :-1, :-1] + u * pixels[:, :-1, 1:]
    return (1 - v) * upper + v * ((1 - u) * pixels[:, 1:, :-1] + u * pixels[:, 1:, 1:])


def _differenced(by_gradient: np.ndarray) -> np.ndarray:
    """(N, 2, K + 2, K + 2) weights of the samples from weights (N, 2, 2, K, K) of their central differences."""
    count, _, _, size, _ = by_gradient.shape
    by_sample = np.zeros((count, 2, size + 2, size + 2), by_gradient.dtype)
    by_sample[:, :, 1:-1, 2:] += 0.5 * by_gradient[:, :, 0]
    by_sample[:, :, 1:-1, :-2] -= 0.5 * by_gradient[:, :, 0]
    by_sample[:, :, 2:, 1:-1] += 0.5 * by_gradient[:, :, 1]
    by_sample[:, :, :-2, 1:-1] -= 0.5 * by_gradient[:, :, 1]
    return by_sample


def _gathered(by_sample: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(N, 2, K + 1, K + 1) weights of the pixels: bilinear interpolation, transposed."""
    u, v = part[:, 0, None], part[:, 1, None]
    padded = np.pad(by_sample, ((0, 0), (0, 0), (1, 1), (1, 1)))
    across = (1 - u) * padded[..., 1:] + u * padded[..., :-1]
    return (1 - v) * across[..., 1:, :] + v * across[..., :-1, :]


def _slopes(pixels: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(N, 2, K, K) how the samples change when the window moves along u and v."""
    u, v = part[:, 0], part[:, 1]
    along_u, along_v = np.diff(pixels, axis=2), np.diff(pixels, axis=1)
    return np.stack(
        [(1 - v) * along_u[:, :-1] + v * along_u[:, 1:], (1 - u) * along_v[:, :, :-1] + u * along_v[:, :, 1:]], axis=1
    )


def _sandwich(by_shift: np.ndarray, curvature: np.ndarray, scatter: np.ndarray, window: int) -> np.ndarray:
    """J⁻¹ S J⁻ᵀ (N, 2, 2), where J keeps at least a part of M in every direction: beyond it nothing is linear."""
    size = np.trace(curvature, axis1=1, axis2=2)
    fixed = np.linalg.det(curvature) > _LEAST_FIXED * np.maximum(size, 1e-3) ** 2
    whole = np.where(fixed[:, None, None], curvature, np.eye(2))
    left, share, right = np.linalg.svd(np.linalg.solve(whole, by_shift))
    inverse = np.linalg.inv(whole @ (left * np.maximum(share, _LEAST_SHARE)[:, None, :]) @ right)
    found = inverse @ scatter @ inverse.transpose(0, 2, 1)
    return np.where(fixed[:, None, None], found, float(window) ** 2 * np.eye(2))
