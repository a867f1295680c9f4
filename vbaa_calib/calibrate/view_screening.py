"""Which views and corners a lens may rest on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec
from targets.charuco import corner_points

from ..detect.corners import BoardView
from .bundle import Bundle, Observation, free_directions, refine
from .lens_models import LensModel

LEAST_CORNERS = 4
"""Four corners fix the pose of a plane."""

_GROSS_VIEW = 5.0
_GROSS_CORNER = 20.0
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
    return usable, dropped


def fixes_homography(plane_points: np.ndarray) -> bool:
    """Whether points (N, 2) of a plane determine its homography to a picture: not all but one on a line."""
    centred = plane_points - plane_points.mean(axis=0)
    centred = centred / max(float(np.abs(centred).max()), 1e-12)
    homogeneous = np.column_stack([centred, np.ones(len(centred))])
    zeros = np.zeros_like(homogeneous)
    design = np.vstack(
        [
            np.hstack([homogeneous, zeros, -centred[:, :1] * homogeneous]),
            np.hstack([zeros, homogeneous, -centred[:, 1:] * homogeneous]),
        ]
    )
    values = np.linalg.svd(design, compute_uv=False)
    return len(plane_points) >= LEAST_CORNERS and bool(values[7] > 1e-3 * values[0])


def without_gross_errors(
    lens: LensModel, bundle: Bundle, observations: Sequence[Observation], min_corners: int, square_pixels: bool
) -> tuple[list[bool], list[Observation] | None]:
    """Which views to keep, and their observations without gross corners; None when there is nothing to leave out.

    A corner is gross when it is over 20 standard deviations off under a robust fit. A view with some gross corners
    loses those; one that is wrong as a whole (half its corners, or 5 times the median view's error) goes.
    """
    directions = free_directions(lens, square_pixels)
    robust = refine(lens, bundle.intrinsics, bundle.poses, observations, directions, robust=True)
    distances = [np.linalg.norm(residual, axis=1) for residual in robust.residuals_px]
    sigma = float(np.median(np.concatenate(distances))) / 1.1774
    inliers = [distance <= max(_GROSS_CORNER * sigma, _GROSS_LEAST_PX) for distance in distances]
    view_rms = np.array([_rms(d[good]) for d, good in zip(distances, inliers, strict=True)])
    limit = max(_GROSS_VIEW * float(np.median(view_rms)), _GROSS_LEAST_PX)
    kept = [
        bool(
            rms <= limit
            and good.mean() > 0.5
            and good.sum() >= max(min_corners, LEAST_CORNERS)
            and fixes_homography(view.points_m[good, :2])
        )
        for rms, good, view in zip(view_rms, inliers, observations, strict=True)
    ]
    if all(kept) and all(good.all() for good in inliers):
        return kept, None
    cleaned = [
        Observation(view.points_m[good], view.pixels[good])
        for view, good, keep in zip(observations, inliers, kept, strict=True)
        if keep
    ]
    return kept, cleaned


def _rms(distances: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(distances)))) if len(distances) else np.inf
