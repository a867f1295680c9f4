"""Corners that are wrong: found under a robust fit, judged by the spread of the others, taken back when they fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.detect.quality.screen import screen_views, too_few

from .bundle import Bundle, Observation, refine, residuals_px

_LEAST_CORNERS = 4
"""Four corners fix the pose of a plane."""
_GROSS_VIEW, _GROSS_LEAST_PX = 5.0, 0.5
_CHANCE, _LEAST_PX, _ROUNDS, _BLURRED = 1e-9, 0.25, 8, 5.0


@dataclass(frozen=True)
class DroppedView:
    """A view that was not used, and why."""

    name: str
    reason: str


def usable_views(
    views: Sequence[BoardView], spec: BoardSpec, min_corners: int
) -> tuple[list[BoardView], list[DroppedView]]:
    """Views that fix a pose, and the others with the reason."""
    least, points = max(min_corners, _LEAST_CORNERS), corner_points(spec)
    usable, dropped = [], []
    for view in views:
        reason = too_few(view, least)
        if not reason and not fixes_homography(points[view.ids, :2]):
            reason = "its corners lie (nearly) on a line"
        if reason:
            dropped.append(DroppedView(view.name, reason))
        else:
            usable.append(view)
    kept, poor = screen_views(usable, least)
    return kept, dropped + [DroppedView(view.name, reason) for view, reason in poor]


def _good_views(
    residuals: Sequence[np.ndarray], good: Sequence[np.ndarray], observations: Sequence[Observation], min_corners: int
) -> np.ndarray:
    """(V,) which views are kept, from their residuals (N, 2) px and masks of good corners (N,).

    A view goes that is wrong as a whole: over half its corners are outliers, the rest has over 5 times the median
    view's error, or it no longer fixes a pose. All its corners are taken to fix one.
    """
    kept = [residual[mask] for residual, mask in zip(residuals, good, strict=True)]
    rms = np.array([np.sqrt(np.mean(np.sum(one**2, axis=1))) if len(one) else np.inf for one in kept])
    limit = max(_GROSS_VIEW * float(np.median(rms)), _GROSS_LEAST_PX)
    return np.array(
        [
            error <= limit
            and mask.mean() > 0.5
            and mask.sum() >= max(min_corners, _LEAST_CORNERS)
            and (mask.all() or fixes_homography(view.points_m[mask, :2]))
            for error, mask, view in zip(rms, good, observations, strict=True)
        ],
        bool,
    )


@dataclass(frozen=True, eq=False)
class Inliers:
    """The good views, as indices (V,), and for each a mask (N,) of its good corners."""

    views: np.ndarray
    masks: tuple[np.ndarray, ...]

    def of(self, observations: Sequence[Observation]) -> list[Observation]:
        """The good corners of the good views."""
        return [observations[index].picked(mask) for index, mask in zip(self.views.tolist(), self.masks, strict=True)]


def _outlier_limit_px(distances: np.ndarray) -> float:
    """Distance beyond which one good corner in 10⁵ lies, from distances (N,) of which some are wrong.

    The tail is a Weibull's through the median and the 90 % quantile. Normal noise has the exponent 2 and is cut at 4.8
    standard deviations; noise with long tails, as real pictures have it, is cut later.
    """
    limit = np.inf
    for _ in range(_ROUNDS):
        half, most = np.quantile(distances[distances <= limit], [0.5, 0.9])
        if half <= 0.0:
            return _LEAST_PX
        exponent = min(np.log(np.log(10.0) / np.log(2.0)) / np.log(most / half), 2.0) if most > half else 2.0
        before, limit = limit, half * (-np.log(_CHANCE) / np.log(2.0)) ** (1.0 / exponent)
        if limit >= before or np.isclose(limit, before, rtol=1e-3):
            break
    return max(float(limit), _LEAST_PX)


def inlier_masks(residuals: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Per view (N,), which corners are good. A view with more noise than the median view is given more room."""
    distances = [np.linalg.norm(residual, axis=1) for residual in residuals]
    every = np.concatenate(distances)
    limit, middle = _outlier_limit_px(every), max(float(np.median(every)), 1e-12)
    return [own <= limit * np.clip(np.median(own) / middle, 1.0, _BLURRED) for own in distances]


def fit_without_outliers(
    start: Bundle, observations: Sequence[Observation], min_corners: int, masks: tuple[np.ndarray, ...] | None = None
) -> tuple[Inliers, Bundle]:
    """Which views and corners are good, and the solution over the good ones alone.

    Least squares over the corners within the limit of the start, and all corners of the remaining views are judged anew
    by it, until none changes sides.

    start : a robust fit to all corners, or the solution over the corners of masks, per view (N,).
    """
    bundle, views = start, np.arange(len(observations))
    for _ in range(_ROUNDS):
        whole = [observations[index] for index in views.tolist()]
        residuals = residuals_px(bundle, whole)
        good = inlier_masks(residuals)
        keep = _good_views(residuals, good, whole, min_corners)
        if masks is not None and keep.all() and all(map(np.array_equal, good, masks)):
            break
        views, masks = views[keep], tuple(mask for mask, kept in zip(good, keep, strict=True) if kept)
        if not masks:
            break
        bundle = refine(replace(bundle, poses=bundle.poses[keep]), Inliers(views, masks).of(observations))
    return Inliers(views, masks or ()), bundle
