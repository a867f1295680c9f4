"""How far noise moves a corner: the picture's noise carried through the equations that `cv2.cornerSubPix` solves.

That corner p is where f = Σ w(r) g gᵀ r = 0, over the samples at r from it in a window that moves with it; g are the
grey levels' central differences, w = exp(−|r|²/window²). Noise δI changes f by Σ w (δg gᵀ r + g δgᵀ r), a weighted sum
A δI over the pixels, and a step δp of the window changes it by A ∂I/∂p δp: δp = −J⁻¹ A δI with J = A ∂I/∂p, and the
covariance is J⁻¹ A var(I) Aᵀ J⁻ᵀ. J is near M = −Σ w g gᵀ where the window is wide for the blur, and smaller elsewhere.
"""

from __future__ import annotations

import numpy as np

from .picture_noise import PictureNoise, measure_noise

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
    pixels = _blocks(image, base, window + 1)
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


def _blocks(image: np.ndarray, base: np.ndarray, reach: int) -> np.ndarray:
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
