"""Corners that are wrong: found under a robust fit, judged by the spread of the others, taken back when they fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .bundle import Bundle, refine, residuals_px
from .corner_stack import Observation
from .lens_models import LensModel
from .view_screening import good_views

_CHANCE = 1e-9
_LEAST_PX = 0.25
_ROUNDS = 8
_BLURRED = 5.0
_STEPS, _ROUGHLY = 5, 1e-4  # a robust fit only tells good corners from bad


@dataclass(frozen=True, eq=False)
class Inliers:
    """The good views, as indices (V,), and for each a mask (N,) of its good corners."""

    views: np.ndarray
    masks: tuple[np.ndarray, ...]

    def of(self, observations: Sequence[Observation]) -> list[Observation]:
        """The good corners of the good views."""
        return [observations[index].picked(mask) for index, mask in zip(self.views.tolist(), self.masks, strict=True)]


def outlier_limit_px(distances: np.ndarray) -> float:
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
    limit, middle = outlier_limit_px(every), max(float(np.median(every)), 1e-12)
    return [own <= limit * np.clip(np.median(own) / middle, 1.0, _BLURRED) for own in distances]


def refined_robustly(
    model: LensModel, start: Bundle, observations: Sequence[Observation], directions: np.ndarray
) -> Bundle:
    """A robust fit (Cauchy) to all corners, from a start and with its pull on the coefficients."""
    return refine(
        model,
        start.intrinsics,
        start.poses,
        observations,
        directions,
        robust=True,
        sagittas_m=start.sagittas_m,
        unfolding=start.unfolding,
        iterations=_STEPS,
        tolerance=_ROUGHLY,
    )


def fit_without_outliers(
    model: LensModel,
    start: Bundle,
    observations: Sequence[Observation],
    directions: np.ndarray,
    min_corners: int,
    masks: tuple[np.ndarray, ...] | None = None,
) -> tuple[Inliers, Bundle]:
    """Which views and corners are good, and the solution over the good ones alone.

    Least squares over the corners within the limit of the start, and all corners of the remaining views are judged anew
    by it, until none changes sides.

    start : a robust fit (`refined_robustly`), or the solution over the corners of masks, per view (N,).
    """
    bundle, views = start, np.arange(len(observations))
    for _ in range(_ROUNDS):
        whole = [observations[index] for index in views.tolist()]
        residuals = residuals_px(model, bundle, whole)
        good = inlier_masks(residuals)
        keep = good_views(residuals, good, whole, min_corners)
        if masks is not None and keep.all() and all(map(np.array_equal, good, masks)):
            break
        views, masks = views[keep], tuple(mask for mask, kept in zip(good, keep, strict=True) if kept)
        if not masks:
            break
        bundle = refine(
            model,
            bundle.intrinsics,
            bundle.poses[keep],
            Inliers(views, masks).of(observations),
            directions,
            sagittas_m=bundle.sagittas_m,
            unfolding=bundle.unfolding,
        )
    return Inliers(views, masks or ()), bundle
