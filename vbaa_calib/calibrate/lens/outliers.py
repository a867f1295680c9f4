"""Outlier corners: detected by a robust fit, judged by the spread of the other corners, taken back when they fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.detect.quality.screen import screen_views, too_few
from vbaa_calib.native import core

from .bundle import BoardCorners, Bundle, of_views, refine, residuals_px, rows
from .settings import LensSettings


@dataclass(frozen=True)
class DroppedView:
    """A view that was not used, and why."""

    name: str
    reason: str


def usable_views(
    views: Sequence[BoardView], nominal_m: np.ndarray, min_corners: int
) -> tuple[list[BoardView], list[DroppedView]]:
    """Views with corners enough to determine the pose of a board of corners (C, 3), and the other views with the
    reason."""
    least = max(min_corners, 4)
    usable, dropped = [], []
    for view in views:
        reason = too_few(view, least)
        if not reason and not fixes_homography(nominal_m[view.ids, :2]):
            reason = "its corners lie (nearly) on a line"
        if reason:
            dropped.append(DroppedView(view.name, reason))
        else:
            usable.append(view)
    kept, poor = screen_views(usable, least)
    return kept, dropped + [DroppedView(view.name, reason) for view, reason in poor]


@dataclass(frozen=True, eq=False)
class Inliers:
    """The good views: indices (V,), a mask (N,) of good corners for each, and its weight (see `BoardCorners`)."""

    views: np.ndarray
    masks: tuple[np.ndarray, ...]
    weights: np.ndarray

    def of(self, observations: Sequence[BoardCorners]) -> list[BoardCorners]:
        """The good corners of the good views."""
        every = zip(self.views.tolist(), self.masks, self.weights.tolist(), strict=True)
        return [replace(observations[index].picked(mask), weight=weight) for index, mask, weight in every]


def _outlier_limit(distances: np.ndarray) -> float:
    """Distance exceeded by one good corner in a million, from distances (N,) of which fewer than half are outliers'.

    The tail is a Weibull's through the median and the 90 % quantile of what lies within the limit. Normal noise has the
    exponent 2 and is cut at 5.3 standard deviations; noise with long tails, as real pictures have it, is cut later. The
    limit grows from below until it no longer changes: from above, gross errors would pass for a long tail.
    """
    limit = LensSettings.first_limit * float(np.median(distances))
    for _ in range(LensSettings.outlier_rounds):
        half, most = np.quantile(distances[distances <= limit], [0.5, 0.9])
        if half <= 0.0:
            return limit
        exponent = min(np.log(np.log(10.0) / np.log(2.0)) / np.log(most / half), 2.0) if most > half else 2.0
        before, limit = limit, float(half * (-np.log(LensSettings.outlier_chance) / np.log(2.0)) ** (1.0 / exponent))
        if np.isclose(limit, before, rtol=1e-3):
            break
    return limit


def _standardised(
    bundle: Bundle, observations: Sequence[BoardCorners], masks: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Per view the lengths (N,) px of the corners' residuals, corrected for leverage as if the view's pose were
    known: corners from which the pose is solved (`masks` (N,)) have smaller residuals, others larger ones."""
    residuals, _, by_pose, bounds = rows(bundle, observations)
    lengths = core.bundle.standardised(residuals, np.ascontiguousarray(by_pose), np.concatenate(masks), bounds)
    return list(of_views(lengths, bounds))


def inlier_masks(distances: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Per view the mask (N,) of good corners, from the lengths (N,) of their residuals or standardised residuals.

    A view with more noise than the median view has a larger limit.
    """
    every = np.concatenate(distances)
    limit, middle = max(_outlier_limit(every), LensSettings.outlier_px), max(float(np.median(every)), 1e-12)
    return [own <= limit * np.clip(np.median(own) / middle, 1.0, LensSettings.blurred) for own in distances]


def fit_without_outliers(
    start: Bundle, observations: Sequence[BoardCorners], min_corners: int, masks: tuple[np.ndarray, ...] | None = None
) -> tuple[Inliers, Bundle]:
    """The good views and corners, and the solution from these alone.

    Least squares over the corners within the limit of the start, and all corners of the remaining views are judged anew
    by it, until none changes sides. A view is dropped only where half its corners are wrong or the good ones fix no
    pose.

    start : a robust fit to all corners, or the solution over the corners of masks, per view (N,).
    """
    bundle, views, weights = start, np.arange(len(observations)), np.array([view.weight for view in observations])
    for _ in range(LensSettings.outlier_rounds):
        whole = [observations[index] for index in views.tolist()]
        judged_by = _nearest(residuals_px(bundle, whole)) if masks is None else masks
        lengths = _standardised(bundle, whole, judged_by)
        good = inlier_masks(lengths)
        keep = np.array([_fixes_pose(mask, view, min_corners) for mask, view in zip(good, whole, strict=True)], bool)
        if masks is not None and keep.all() and all(map(np.array_equal, good, masks)):
            break
        views, masks = views[keep], tuple(mask for mask, kept in zip(good, keep, strict=True) if kept)
        weights = _weights([length for length, kept in zip(lengths, keep, strict=True) if kept], masks)
        if not masks:
            break
        bundle = refine(replace(bundle, poses=bundle.poses[keep]), Inliers(views, masks, weights).of(observations))
    return Inliers(views, masks or (), weights), bundle


def _weights(lengths: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> np.ndarray:
    """Weights (V,) of views by their noise, from the lengths (N,) px of the standardised residuals of their good
    corners.

    1, but for views that are clearly noisier than the median view. A view of few corners is taken for a usual one.
    """
    squares = np.array([np.mean(length[mask] ** 2) for length, mask in zip(lengths, masks, strict=True)])
    counts = np.array([mask.sum() for mask in masks])
    usual = float(np.median(squares)) if len(squares) else 1.0
    noise = np.sqrt(
        (counts * squares + LensSettings.usual_corners * usual)
        / ((counts + LensSettings.usual_corners) * max(usual, 1e-24))
    )
    return np.minimum(1.0, LensSettings.noisier / noise)


def _nearest(residuals: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Per view a mask (N,) of the corners with the smallest residuals, from which a robust fit starts."""
    lengths = [np.linalg.norm(residual, axis=1) for residual in residuals]
    return [own <= LensSettings.first_limit * np.median(own) for own in lengths]


def _fixes_pose(good: np.ndarray, view: BoardCorners, min_corners: int) -> bool:
    """Whether the good corners (N,) of a view are most of its corners and determine its pose."""
    most = good.mean() > 0.5 and good.sum() >= max(min_corners, 4)
    return bool(most and (good.all() or fixes_homography(view.points_m[good, :2])))
