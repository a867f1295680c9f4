"""Grey levels and colours of a picture."""

from __future__ import annotations

import numpy as np


def grey(image: np.ndarray) -> np.ndarray:
    """(H, W) grey levels of a grey (H, W) or colour (H, W, 3 or 4) picture: blue, green, red, any depth."""
    if image.ndim == 2:
        return image
    import cv2  # slow to load

    return cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY)


def coloured(image: np.ndarray) -> bool:
    """Whether a picture (H, W[, 3]) has colours: a grey camera's may have three channels, too."""
    return image.ndim == 3 and bool(np.ptp(image[::8, ::8, :3], axis=2).any())


def channels(image: np.ndarray) -> tuple[np.ndarray, float]:
    """A picture (H, W[, 3]) as (H, W, 1 or more), and the number of its grey levels that make one of 8 bits."""
    return image if image.ndim == 3 else image[..., None], 257.0 if image.dtype == np.uint16 else 1.0
