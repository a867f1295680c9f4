"""The plane of a colour picture on which an antenna stands out from what lies on either side of it, place by place."""

from __future__ import annotations

import cv2
import numpy as np

from vbaa_calib.core.polyline import normals, resample
from vbaa_calib.native import core

from .settings import SearchSettings


def grey(image: np.ndarray) -> np.ndarray:
    """(H, W) grey levels of a grey (H, W) or colour (H, W, 3 or 4) picture: blue, green, red, any depth."""
    return image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY)


def coloured(image: np.ndarray) -> bool:
    """Whether a picture (H, W[, 3]) has colours: a grey camera's may have three channels, too."""
    return image.ndim == 3 and bool(np.ptp(image[::8, ::8, :3], axis=2).any())


def contrast_plane(image: np.ndarray, path_px: np.ndarray, width_px: float) -> np.ndarray:
    """(H, W) grey levels of a colour picture (H, W, 3) in which an antenna along a path (K, 2), K ≥ 2, stands out.

    Near it the channels are weighted so that it is brighter than what lies on either side, by as much as can be at that
    place, where it has a contrast at all; farther off it is the grey picture.
    """
    points, _ = resample(path_px, 1.0)
    flank, own_half = 0.5 * width_px + np.array(SearchSettings.flanks_px), SearchSettings.own_share * width_px
    across, (colours, level) = normals(points), channels(image)
    own, left, right = (
        np.mean([core.search.colours_at(colours, level, points + offset * across) for offset in offsets], axis=0)
        for offsets in (np.array([-own_half, 0.0, own_half]), -flank, flank)
    )
    # the smaller one of two contrasts is largest along the point nearest to none on the line between them
    contrast, apart = _along_it(own - left), _along_it(left - right)
    share = -(contrast * apart).sum(axis=1) / np.maximum((apart**2).sum(axis=1), 1e-9)
    contrast += np.clip(share, 0.0, 1.0)[:, None] * apart
    contrast += SearchSettings.faint_contrast * np.where(contrast.sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    # of as much noise as the mean of the channels
    weights = contrast / (np.sqrt(3.0) * np.linalg.norm(contrast, axis=1)[:, None])
    plane = grey(image).astype(np.float32)
    core.search.weigh_channels(
        colours, points, weights, int(np.ceil(width_px + SearchSettings.contrast_reach_px)), plane
    )
    return plane


def _along_it(colours: np.ndarray) -> np.ndarray:
    """(K, 3) means of neighbouring colours."""
    size = 1, SearchSettings.alike_places
    return cv2.blur(cv2.blur(colours, size), size)


def channels(image: np.ndarray) -> tuple[np.ndarray, float]:
    """A picture (H, W[, 3]) as (H, W, 1 or more), and how many of its levels are one of 8 bits."""
    return image if image.ndim == 3 else image[..., None], 257.0 if image.dtype == np.uint16 else 1.0
