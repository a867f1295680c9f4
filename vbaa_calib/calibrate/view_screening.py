"""Which views and corners a lens may rest on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec
from targets.charuco import corner_points

from ..detect.corners import BoardView
from ..detect.view_quality import fixes_homography
from ..detect.view_quality_screen import screen_views
from .corner_stack import Observation

LEAST_CORNERS = 4
"""Four corners fix the pose of a plane."""

_GROSS_VIEW = 5.0
_GROSS_LEAST_PX = 0.5


@dataclass(frozen=True)
class DroppedView:
    """A view that was not used, and why."""

    name: str
    reason: str


def usable_views(
    views: Sequence[BoardView], spec: BoardSpec, min_corners: int
) -> tuple[list[BoardView], list[DroppedView]]:
    """Views that fix a pose, and the others with the reason."""
    least = max(min_corners, LEAST_CORNERS)
    points = corner_points(spec)
    usable, dropped = [], []
    for view in views:
        if len(view.ids) == 0:
            reason = "the board is not found" if view.marker_count == 0 else "markers are found, corners are not"
        elif len(view.ids) < least:
            reason = f"{len(view.ids)} corners, at least {least} are needed"
        elif not fixes_homography(points[view.ids, :2]):
            reason = "its corners lie (nearly) on a line"
        else:
            usable.append(view)
            continue
        dropped.append(DroppedView(view.name, reason))
    kept, poor = screen_views(usable, least)
    return kept, dropped + [DroppedView(view.name, reason) for view, reason in poor]


def good_views(
    residuals: Sequence[np.ndarray], good: Sequence[np.ndarray], observations: Sequence[Observation], min_corners: int
) -> np.ndarray:
    """(V,) which views are worth keeping, from their residuals (N, 2) px and masks of good corners (N,).

    A view goes that is wrong as a whole: over half its corners are outliers, the rest has over 5 times the median
    view's error, or it no longer fixes a pose. All its corners are taken to fix one.
    """
    rms = np.array([_rms(residual[mask]) for residual, mask in zip(residuals, good, strict=True)])
    limit = max(_GROSS_VIEW * float(np.median(rms)), _GROSS_LEAST_PX)
    return np.array(
        [
            error <= limit
            and mask.mean() > 0.5
            and mask.sum() >= max(min_corners, LEAST_CORNERS)
            and (mask.all() or fixes_homography(view.points_m[mask, :2]))
            for error, mask, view in zip(rms, good, observations, strict=True)
        ],
        bool,
    )


def _rms(residuals: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1)))) if len(residuals) else np.inf
