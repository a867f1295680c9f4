"""The plane of a colour picture on which an antenna stands out from what lies on either side of it, place by place."""

from __future__ import annotations

import cv2
import numpy as np

from vbaa_calib.core.polyline import normals, resample
from vbaa_calib.native import core

OWN, FLANK_PX, ALIKE = np.array([-0.2, 0.0, 0.2]), np.array([1.5, 2.5]), 15
"""Where an antenna's own colour is compared, parts of its width, and those next to it, px beyond its edges; so many
places along it, twice, are averaged."""
FAINT_CONTRAST, REACH_PX = 2.5, 10.0
"""With less contrast, grey levels in each channel, the plane is nearly grey; how far from the antenna it is weighted.
"""


def coloured(image: np.ndarray) -> bool:
    """Whether a picture (H, W[, 3]) has colours: a grey camera's may have three channels, too."""
    return image.ndim == 3 and bool(np.ptp(image[::8, ::8, :3], axis=2).any())


def contrast_plane(image: np.ndarray, path_px: np.ndarray, width_px: float) -> np.ndarray:
    """(H, W) grey levels of a colour picture (H, W, 3) in which an antenna along a path (K, 2), K ≥ 2, stands out.

    Near it the channels are weighted so that it is brighter than what lies on either side, by as much as can be at that
    place, where it has a contrast at all; farther off it is the grey picture.
    """
    points, _ = resample(path_px, 1.0)
    across, (colours, level) = normals(points), channels(image)
    own, left, right = (
        np.mean([core.search.colours_at(colours, level, points + offset * across) for offset in offsets], axis=0)
        for offsets in (OWN * width_px, -0.5 * width_px - FLANK_PX, 0.5 * width_px + FLANK_PX)
    )
    # the smaller one of two contrasts is largest along the point nearest to none on the line between them
    contrast, apart = _along_it(own - left), _along_it(left - right)
    share = -(contrast * apart).sum(axis=1) / np.maximum((apart**2).sum(axis=1), 1e-9)
    contrast += np.clip(share, 0.0, 1.0)[:, None] * apart
    contrast += FAINT_CONTRAST * np.where(contrast.sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    # of as much noise as the mean of the channels
    weights = contrast / (np.sqrt(3.0) * np.linalg.norm(contrast, axis=1)[:, None])
    plane = cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY).astype(np.float32)
    core.search.weigh_channels(colours, points, weights, int(np.ceil(width_px + REACH_PX)), plane)
    return plane


def _along_it(colours: np.ndarray) -> np.ndarray:
    """(K, 3) means of neighbouring colours."""
    return cv2.blur(cv2.blur(colours, (1, ALIKE)), (1, ALIKE))


def channels(image: np.ndarray) -> tuple[np.ndarray, float]:
    """A picture (H, W[, 3]) as (H, W, 1 or more), and how many of its levels are one of 8 bits."""
    return image if image.ndim == 3 else image[..., None], 257.0 if image.dtype == np.uint16 else 1.0
