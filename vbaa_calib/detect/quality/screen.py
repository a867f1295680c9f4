"""Selection of the views that are good enough to calibrate from, with the reasons for the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vbaa_calib.core.robust import finite_median
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import ViewQuality

from .settings import QualitySettings


def screen_views(
    views: Sequence[BoardView], min_corners: int = QualitySettings.least_corners
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
    """Standard deviation, px, of the view's median corner (of its distance from the true one); NaN where unknown."""
    if view.covariance_px2 is None or not len(view.covariance_px2):
        return float("nan")
    return float(np.sqrt(np.median(np.trace(view.covariance_px2, axis1=1, axis2=2))))


def too_few(view: BoardView, min_corners: int) -> str:
    """Reason why a view has too few corners; empty where it has enough."""
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
    """Reason why a view is too poor; empty for a good one. typical : the set's medians: blur px, contrast in grey
    levels, standard deviation of a corner px."""
    blur, (usual_blur, usual_contrast, usual_std) = quality.mean_blur_px, typical
    blurred = f"blurred by {blur:.1f} px ({quality.blur_in_words})"
    if blur > QualitySettings.most_blur_per_gap * quality.gap_px:
        return f"{blurred}, so that markers {quality.gap_px:.1f} px from the corners reach into them"
    if quality.saturated > QualitySettings.clipped and quality.edge_level > QualitySettings.grown:
        return f"overexposed: {100 * quality.saturated:.0f} % of the white is clipped and has grown over the edges"
    if not std_px > max(QualitySettings.noisier * usual_std, QualitySettings.noisy_px):
        return ""
    cause = "noisy"
    if blur > QualitySettings.blurred * usual_blur:
        cause = blurred
    elif quality.contrast < QualitySettings.pale_share * usual_contrast:
        cause = f"pale, black and white differ by {quality.contrast:.0f} grey levels"
    return f"{cause}: its corners are uncertain by {std_px:.2f} px, the median view's by {usual_std:.2f} px"
