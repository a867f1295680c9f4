"""Which views of the board are good enough to calibrate from, and why the others are not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vbaa_calib.core.robust import finite_median
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import ViewQuality

LEAST_CORNERS = 6
MOST_BLUR_PER_GAP = 0.5
"""Largest blur over the gap between squares and markers. Up to 0.4 the corners' covariance holds; at 0.55 they are off
by 0.7 px where it says 0.2, as the markers blur into the corners."""
CLIPPED, GROWN = 0.5, 0.85
"""Share of clipped white pixels, and grey level at the squares' edges, above which white has grown into black: corner
errors are then more than 1.5 times those of a good exposure. Clipped whites alone are harmless."""
_NOISIER, NOISY_PX = 4.0, 0.1
"""A view is dropped if its corners' std exceeds both this multiple of the median view's and this many px."""
_BLURRED, _PALE = 1.5, 0.5


def screen_views(
    views: Sequence[BoardView], min_corners: int = LEAST_CORNERS
) -> tuple[list[BoardView], list[tuple[BoardView, str]]]:
    """Views to keep, and the others, each with the reason in words. The thresholds were measured on drawn boards.

    A view without `quality` or `covariance_px2` is judged by its corners alone.
    """
    std_px = [corner_std_px(view) for view in views]
    known = [view.quality for view in views if view.quality is not None]
    blurs, contrasts = ([getattr(quality, name) for quality in known] for name in ("mean_blur_px", "contrast"))
    typical = tuple(finite_median(np.array(values, float)) for values in (blurs, contrasts, std_px))
    kept, dropped = [], []
    for view, std in zip(views, std_px, strict=True):
        reason = too_few(view, min_corners) or (view.quality and _too_poor(view.quality, std, typical))
        if reason:
            dropped.append((view, reason))
        else:
            kept.append(view)
    return kept, dropped


def corner_std_px(view: BoardView) -> float:
    """Standard deviation of the view's median corner, px (of its distance from the truth); NaN where unknown."""
    if view.covariance_px2 is None or not len(view.covariance_px2):
        return float("nan")
    return float(np.sqrt(np.median(np.trace(view.covariance_px2, axis1=1, axis2=2))))


def too_few(view: BoardView, min_corners: int) -> str:
    """Why there are too few corners, or ""."""
    if len(view.ids) == 0:
        return (
            view.left_out or "the board is not found"
            if view.marker_count == 0
            else "markers are found, corners are not"
        )
    if len(view.ids) < min_corners:
        return f"{len(view.ids)} corners, at least {min_corners} are needed"
    if view.quality is not None and view.quality.collinear:
        return "its corners lie (nearly) on a line"
    return ""


def _too_poor(quality: ViewQuality, std_px: float, typical: tuple[float, ...]) -> str:
    """typical : the set's medians: blur px, contrast in grey levels, standard deviation of a corner px."""
    blur, (usual_blur, usual_contrast, usual_std) = quality.mean_blur_px, typical
    blurred = f"blurred by {blur:.1f} px ({quality.blur_in_words})"
    if blur > MOST_BLUR_PER_GAP * quality.gap_px:
        return f"{blurred}, and what lies {quality.gap_px:.1f} px off runs in"
    if quality.saturated > CLIPPED and quality.edge_level > GROWN:
        return f"overexposed: {100 * quality.saturated:.0f} % of the white is clipped and has grown over the edges"
    if not std_px > max(_NOISIER * usual_std, NOISY_PX):
        return ""
    cause = "noisy"
    if blur > _BLURRED * usual_blur:
        cause = blurred
    elif quality.contrast < _PALE * usual_contrast:
        cause = f"pale, black and white differ by {quality.contrast:.0f} grey levels"
    return f"{cause}: its corners are uncertain by {std_px:.2f} px, the median view's by {usual_std:.2f} px"
