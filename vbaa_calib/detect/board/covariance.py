"""Covariance of a corner: the picture's noise propagated through the equations that `cv2.cornerSubPix` solves.

That corner p is where f = Σ w(r) g gᵀ r = 0, over the samples at r from it in a window that moves with it; g are the
grey levels' central differences, w = exp(−|r|²/window²). Noise δI changes f by Σ w (δg gᵀ r + g δgᵀ r), a weighted sum
A δI over the pixels, and a step δp of the window changes it by A ∂I/∂p δp: δp = −J⁻¹ A δI with J = A ∂I/∂p, and the
covariance is J⁻¹ A var(I) Aᵀ J⁻ᵀ. J is near M = −Σ w g gᵀ where the window is wide for the blur, and smaller elsewhere.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vbaa_calib.core.robust import chi_limit
from vbaa_calib.native import core

from .settings import DetectionSettings


def corner_covariances(
    image: np.ndarray, smooth: np.ndarray, corners_px: np.ndarray, windows: np.ndarray
) -> np.ndarray:
    """(N, 2, 2) px² covariances of corners (N, 2) px that `cv2.cornerSubPix` refined with half windows (N,).

    image : (H, W) uint8. smooth : (H, W) float32, the same smoothed by σ `smoothing_px`, in which they were refined.
    The noise is measured in the black and white squares around them. A window without a corner gives its own size.
    Noise is assumed independent between pixels: the covariance is too small where JPEG or the camera smooths. The
    detector's bias is not included: in sharp pictures up to 0.03 px, smoothed by a pixel up to 0.015 px, where it
    outweighs noise below about 1.5 grey levels.
    """
    if not len(corners_px):
        return np.zeros((0, 2, 2))
    found: np.ndarray = core.board.corner_covariances(
        np.ascontiguousarray(image),
        np.ascontiguousarray(smooth, np.float32),
        np.ascontiguousarray(corners_px, float),
        np.ascontiguousarray(windows, np.int64),
        _trimming(DetectionSettings.flat_kept),
        DetectionSettings,
    )
    return found


@lru_cache(maxsize=8)
def _trimming(share: float) -> float:
    """Variance of normal numbers over the mean of this share of their squares, the smallest."""
    limit = chi_limit(1.0 - share, 1.0)
    return share / (share - 2.0 * limit * float(np.exp(-0.5 * limit**2) / np.sqrt(2.0 * np.pi)))
