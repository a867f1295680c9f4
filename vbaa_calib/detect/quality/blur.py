"""Which way a picture of the board is blurred: from its edges and from the grey level right at its corners."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import BoardSpec
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.layout import px_per_square

_AGAIN_PX, _SMOOTHED_PX = 2.0, 0.7
_FEWEST_PIXELS, _LEAST_SLOPE = 200, 1.0
_CREST, _SHARE = 0.6, 0.2
_BINS = 4
_FEWEST_CORNERS = 4


@dataclass(frozen=True)
class Blur:
    """Standard deviations of a blur where it is widest and where it is narrowest, px, the pixel's area included.

    direction_rad : where the wide one goes, from u towards v.
    """

    long_px: float
    short_px: float
    direction_rad: float


def edge_blur(image: np.ndarray) -> Blur | None:
    """Of the strong edges of a picture (H, W) uint8, looked at in half its size; None where it has none to speak of.

    The direction is a multiple of π/4. Blurred once more by s, an edge of blur b loses the slope √(1 + s²/b²).
    """
    if min(image.shape) < 32:
        return None
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(np.float32)
    first = cv2.GaussianBlur(half, (0, 0), _SMOOTHED_PX)
    again = cv2.GaussianBlur(first, (0, 0), _AGAIN_PX)
    slope_u, slope_v, after_u, after_v = (
        cv2.Sobel(smooth, cv2.CV_32F, *axis, scale=0.125) for smooth in (first, again) for axis in ((1, 0), (0, 1))
    )
    slope, after = cv2.magnitude(slope_u, slope_v), cv2.magnitude(after_u, after_v)
    chosen = slope > _LEAST_SLOPE
    if chosen.sum() < _FEWEST_PIXELS:
        return None
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
    most = max(known, key=lambda one: known[one])
    return Blur(known[most], min(known.values()), most * np.pi / _BINS)


def blur_ellipse(image: np.ndarray, view: BoardView, spec: BoardSpec) -> Blur | None:
    """From a view with its quality and the picture (H, W) uint8; None where not both directions are seen.

    The edges tell the blur along the squares' sides, b₁ and b₂, but not along a diagonal. There the corners help: for
    correlated blur the grey level right at a corner between two black squares is off the mean by asin(ρ) / π of the
    contrast, up at every other corner and down at the rest; light and the camera's curve shift all alike.
    """
    quality = view.quality
    if quality is None or not np.isfinite([*quality.blur_px, quality.contrast]).all() or quality.contrast <= 0.0:
        return None
    if not view.marker_count or len(view.ids) < _FEWEST_CORNERS:
        return None
    axes = _axes(view, spec)
    # blur_px[0] is seen at edges that run along the board's y: it goes along x, across them
    wide, high = quality.blur_px
    both = _correlation(image, view, spec, quality.contrast) * wide * high
    values, vectors = np.linalg.eigh(axes @ np.array([[wide**2, both], [both, high**2]]) @ axes.T)
    direction = float(np.arctan2(*vectors[::-1, 1]))
    return Blur(float(np.sqrt(values[1])), float(np.sqrt(max(values[0], 1.0 / 12.0))), direction)


def _axes(view: BoardView, spec: BoardSpec) -> np.ndarray:
    """(2, 2) columns of unit length: the mean directions across the board's edges."""
    typical = np.median(px_per_square(view.marker_corners_px, spec.marker_m / spec.square_m), axis=0)
    across = np.linalg.inv(typical).T
    # the blur across edges is that along the edges' normals; back from normals to axes
    return np.linalg.inv((across / np.linalg.norm(across, axis=0)).T)


def _correlation(image: np.ndarray, view: BoardView, spec: BoardSpec, contrast: float) -> float:
    """Of the blur along the board's x with that along its y."""
    columns = spec.squares_x - 1
    # whether the square before the corner, left and above, is black
    odd = ((view.ids % columns + view.ids // columns) % 2 == 0) == spec.starts_with_marker
    where = view.corners_px.astype(np.float32).reshape(1, -1, 2)
    grey = cv2.remap(image, where, np.empty(0), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0].astype(float)
    if odd.all() or not odd.any():
        return 0.0
    # more than half of the contrast up: only noise or a covered corner makes it so
    lift = (np.median(grey[odd]) - np.median(grey[~odd])) / (2.0 * contrast)
    return float(np.sin(np.clip(np.pi * lift, -1.2, 1.2)))
