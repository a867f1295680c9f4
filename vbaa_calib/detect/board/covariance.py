"""Covariance of a corner: the picture's noise propagated through the equations that `cv2.cornerSubPix` solves.

That corner p is where f = Σ w(r) g gᵀ r = 0, over the samples at r from it in a window that moves with it; g are the
grey levels' central differences, w = exp(−|r|²/window²). Noise δI changes f by Σ w (δg gᵀ r + g δgᵀ r), a weighted sum
A δI over the pixels, and a step δp of the window changes it by A ∂I/∂p δp: δp = −J⁻¹ A δI with J = A ∂I/∂p, and the
covariance is J⁻¹ A var(I) Aᵀ J⁻ᵀ. J is near M = −Σ w g gᵀ where the window is wide for the blur, and smaller elsewhere.
"""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.robust import chi_limit

from .settings import DetectionSettings

QUANTISATION = 1.0 / 12.0
"""Variance of rounding to whole grey levels: the least noise of any picture."""


def _measure_noise(image: np.ndarray, corners_px: np.ndarray, windows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean grey levels (2,) of black and white squares, and the variance (2,) of the noise there, rounding included.

    Measured in windows of half size (N,) around chessboard corners (N, 2) px of a picture (H, W) uint8, N ≥ 1, from
    second differences along both axes, which remove blurred edges and uneven light.
    """
    chosen = np.linspace(0, len(corners_px) - 1, min(len(corners_px), DetectionSettings.largest_sample)).astype(int)
    levels, share, rough = [], [], []
    for window in np.unique(windows[chosen]).tolist():
        centres = np.rint(corners_px[chosen[windows[chosen] == window]]).astype(int)
        blocks = _blocks(image, centres, -window - 2, window + 2)
        grey = _folded(blocks, 1.0).reshape(len(blocks), -1) / 9.0
        black, white = np.percentile(grey, (8.0, 92.0), axis=1)
        levels.append([black, white])
        share.append(((grey - black[:, None]) / np.maximum(white - black, 1.0)[:, None]).ravel())
        rough.append(_folded(blocks, -2.0).ravel())
    # second differences along both axes have 36 times the variance of a pixel
    squares, shares = np.concatenate(rough) ** 2 / 36.0, np.concatenate(share)
    everywhere, variances = _trimmed(squares), []
    for side in (0.0, 1.0):
        flat = squares[np.abs(shares - side) < DetectionSettings.flat]
        variances.append(
            max(_trimmed(flat) if len(flat) >= DetectionSettings.flat_pixels else everywhere, QUANTISATION)
        )
    return np.median(np.concatenate(levels, axis=1), axis=1), np.array(variances)


def _blocks(image: np.ndarray, centres: np.ndarray, first: int, last: int) -> np.ndarray:
    """(N, K, K) pixels from `first` to `last` around centres (N, 2); border pixels are repeated."""
    span = np.arange(first, last + 1)
    rows = np.clip(centres[:, 1, None] + span, 0, image.shape[0] - 1)
    columns = np.clip(centres[:, 0, None] + span, 0, image.shape[1] - 1)
    return image[rows[:, :, None], columns[:, None, :]].astype(np.float32)


def _folded(blocks: np.ndarray, middle: float) -> np.ndarray:
    """Blocks (N, K, K) with the kernel (1, middle, 1) along both axes, (N, K − 2, K − 2)."""
    rows = blocks[:, :-2] + middle * blocks[:, 1:-1] + blocks[:, 2:]
    return rows[..., :-2] + middle * rows[..., 1:-1] + rows[..., 2:]


def _trimmed(squares: np.ndarray) -> float:
    """Variance of normal numbers from the smallest of their squares (N,), corrected for the trimming."""
    share = DetectionSettings.flat_kept
    kept, limit = max(int(share * len(squares)), 1), chi_limit(1.0 - share, 1.0)
    trimming_loses = share / (share - 2.0 * limit * float(np.exp(-0.5 * limit**2) / np.sqrt(2.0 * np.pi)))
    return float(np.partition(squares, kept - 1)[:kept].mean()) * trimming_loses


def corner_covariances(
    image: np.ndarray,
    corners_px: np.ndarray,
    windows: np.ndarray,
    smooth: np.ndarray | None = None,
    smoothing_px: float = 0.0,
) -> np.ndarray:
    """(N, 2, 2) px² covariances of corners (N, 2) px that `cv2.cornerSubPix` refined with half windows (N,).

    image : (H, W) uint8. smooth : the same smoothed by σ `smoothing_px`, if that was refined in. A window without a
    corner gives its own size. Noise is assumed independent between pixels: the covariance is too small where JPEG or
    the camera smooths. The detector's bias is not included: in sharp pictures up to 0.03 px, smoothed by a pixel up to
    0.015 px, where it outweighs noise below about 1.5 grey levels.
    """
    found = np.zeros((len(corners_px), 2, 2))
    if not len(corners_px):
        return found
    smooth = image if smooth is None else smooth
    reach = int(np.ceil(4.0 * smoothing_px))  # OpenCV's kernel ends there
    (black, white), (in_black, in_white) = (each.tolist() for each in _measure_noise(image, corners_px, windows))
    for window in np.unique(windows).tolist():
        chosen = np.flatnonzero(windows == window)
        base = np.floor(corners_px[chosen]).astype(int)
        part = (corners_px[chosen] - base).astype(np.float32)[:, :, None, None]
        raw = _blocks(image, base, -window - 1 - reach, window + 2 + reach)
        # photons' noise: linear in the grey level
        share = np.clip((raw - black) / max(white - black, 1.0), 0.0, 1.0)
        variance = in_black + share * (in_white - in_black)
        by_pixel, by_shift, curvature = _of_one_size(_blocks(smooth, base, -window - 1, window + 2), part, window)
        if reach:
            spread = _spread(by_pixel.shape[-1], reach, smoothing_px)
            by_pixel = spread @ by_pixel @ spread.T
        scatter = _products(variance[:, None] * by_pixel, by_pixel)
        found[chosen] = _sandwich(by_shift, curvature, scatter, window)
    return found


def _spread(size: int, reach: int, smoothing_px: float) -> np.ndarray:
    """(size + 2 reach, size) weights of pixels in the smoothed ones; float32."""
    off = np.arange(-reach, reach + 1)
    bell = np.exp(-0.5 * (off / smoothing_px) ** 2)
    found = np.zeros((size + 2 * reach, size), np.float32)
    for step, weight in zip(off + reach, bell / bell.sum(), strict=True):
        found[np.arange(size) + step, np.arange(size)] = weight
    return found


def _of_one_size(pixels: np.ndarray, part: np.ndarray, window: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (N, 2, K + 3, K + 3), J and M (N, 2, 2) from pixels (N, K + 3, K + 3); part (N, 2, 1, 1) is the corners'
    sub-pixel offset."""
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
    return _gathered(by_sample, part), _products(by_sample, _slopes(pixels, part)), curvature


def _products(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N, 2, 2) sums over the pixels of products of (N, 2, K, K) and (N, 2, K, K)."""
    shape = (len(first), 2, -1)
    return (first.reshape(shape) @ second.reshape(shape).transpose(0, 2, 1)).astype(float)


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
    """(N, 2, K + 1, K + 1) weights of the pixels: transposed bilinear interpolation."""
    u, v = part[:, 0, None], part[:, 1, None]
    padded = np.pad(by_sample, ((0, 0), (0, 0), (1, 1), (1, 1)))
    across = (1 - u) * padded[..., 1:] + u * padded[..., :-1]
    return (1 - v) * across[..., 1:, :] + v * across[..., :-1, :]


def _slopes(pixels: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(N, 2, K, K) derivatives of the samples by a shift of the window along u and v."""
    u, v = part[:, 0], part[:, 1]
    along_u, along_v = np.diff(pixels, axis=2), np.diff(pixels, axis=1)
    return np.stack(
        [(1 - v) * along_u[:, :-1] + v * along_u[:, 1:], (1 - u) * along_v[:, :, :-1] + u * along_v[:, :, 1:]], axis=1
    )


def _sandwich(by_shift: np.ndarray, curvature: np.ndarray, scatter: np.ndarray, window: int) -> np.ndarray:
    """J⁻¹ S J⁻ᵀ (N, 2, 2), with J bounded below by a fraction of M in every direction, beyond which it is not
    linear."""
    size = np.trace(curvature, axis1=1, axis2=2)
    fixed = np.linalg.det(curvature) > DetectionSettings.least_fixed * np.maximum(size, 1e-3) ** 2
    whole = np.where(fixed[:, None, None], curvature, np.eye(2))
    left, share, right = np.linalg.svd(np.linalg.solve(whole, by_shift))
    inverse = np.linalg.inv(whole @ (left * np.maximum(share, DetectionSettings.least_kept)[:, None, :]) @ right)
    found = inverse @ scatter @ inverse.transpose(0, 2, 1)
    return np.where(fixed[:, None, None], found, float(window) ** 2 * np.eye(2))
