"""How sharp a picture is where nothing of the board is known: from its strongest edges."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

_AGAIN_PX, _SMOOTHED_PX = 2.0, 0.7
_FEWEST_PIXELS, _LEAST_SLOPE = 200, 1.0
_CREST, _SHARE = 0.6, 0.2
_BINS = 4


@dataclass(frozen=True)
class EdgeBlur:
    """Blur of a picture's strong edges, standard deviation in px of the picture, pixel's area included.

    Attributes
    ----------
    least_px, most_px : of the edges in the directions in which they are sharpest, and least sharp.
    direction_rad : where the larger blur goes, a multiple of π/4 from u towards v.
    """

    least_px: float
    most_px: float
    direction_rad: float


def edge_blur(image: np.ndarray) -> EdgeBlur | None:
    """Of a picture (H, W) uint8, looked at in half its size; None where it has no edges to speak of.

    Blurred once more by s, an edge of blur b loses the slope √(1 + s²/b²).
    """
    if min(image.shape) < 32:
        return None
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(np.float32)
    first = cv2.GaussianBlur(half, (0, 0), _SMOOTHED_PX)
    again = cv2.GaussianBlur(first, (0, 0), _AGAIN_PX)
    slope_u, slope_v = (cv2.Sobel(first, cv2.CV_32F, *axis, scale=0.125) for axis in ((1, 0), (0, 1)))
    slope = cv2.magnitude(slope_u, slope_v)
    chosen = slope > _LEAST_SLOPE
    if chosen.sum() < _FEWEST_PIXELS:
        return None
    after = cv2.magnitude(*(cv2.Sobel(again, cv2.CV_32F, *axis, scale=0.125) for axis in ((1, 0), (0, 1))))
    slopes = slope[chosen]
    spread = _AGAIN_PX / np.sqrt(np.maximum((slopes / np.maximum(after[chosen], 1e-3)) ** 2 - 1.0, 1e-2))
    own = 2.0 * np.sqrt(np.maximum(spread**2 - _SMOOTHED_PX**2, 1.0 / 48.0))
    bins = np.round(np.arctan2(slope_v[chosen], slope_u[chosen]) / (np.pi / _BINS)).astype(int) % _BINS
    known = {}
    for one in range(_BINS):
        within = bins == one
        # blur lowers an edge's slope and leaves their sum
        if slopes[within].sum() > _SHARE * slopes.sum():
            crest = slopes[within] > _CREST * np.percentile(slopes[within], 99.0)
            known[one] = float(np.median(own[within][crest]))
    least, most = min(known, key=lambda one: known[one]), max(known, key=lambda one: known[one])
    return EdgeBlur(known[least], known[most], most * np.pi / _BINS)
