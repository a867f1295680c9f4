"""Pictures that show the board where another one already does: they say nothing new."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from targets.board import BoardSpec
from targets.charuco import corner_points

from ...detect.corners import BoardView
from ...detect.view_quality import fixes_homography
from ...detect.view_quality_screen import LEAST_CORNERS
from ...diagnosis import Diagnosis

MOVED_SQUARES = 0.5
"""A board that moved by less than so many of its squares stands where it stood."""
RESHAPED = 0.006
"""Change of its outline's shape, rms per extent, below which it is turned as before: about 6° of tilt."""


def same_pose(view: BoardView, earlier: Sequence[BoardView], spec: BoardSpec) -> Diagnosis | None:
    """Whether an earlier view shows the board in (nearly) the same pose: says which, the one that is nearest."""
    near = [(distance, other) for other in earlier if (distance := apart_px(view, other, spec)) is not None]
    if not near:
        return None
    distance, other = min(near, key=lambda one: one[0])
    return Diagnosis(
        "same_pose",
        f"the board stands as in {other.name}, its corners {distance:.1f} px from there",
        "turn it another way, or move it to another part of the picture",
    )


def apart_px(view: BoardView, other: BoardView, spec: BoardSpec) -> float | None:
    """Rms distance of the corners that both show, px, where the pose counts as the same; else None."""
    ids, mine, theirs = np.intersect1d(view.ids, other.ids, return_indices=True)
    if len(ids) < LEAST_CORNERS or 2 * len(ids) < max(len(view.ids), len(other.ids)):
        return None
    plane = corner_points(spec)[ids, :2]
    if view.image_size != other.image_size or not fixes_homography(plane):
        return None
    here, there = view.corners_px[mine], other.corners_px[theirs]
    moved_px = float(np.sqrt(((here - there) ** 2).sum(axis=1).mean()))
    extent_px = float(np.sqrt(((here - here.mean(axis=0)) ** 2).sum(axis=1).mean()))
    extent_m = float(np.sqrt(((plane - plane.mean(axis=0)) ** 2).sum(axis=1).mean()))
    square_px = spec.square_m * extent_px / extent_m
    same = moved_px < MOVED_SQUARES * square_px and _reshaped_px(here, there) < RESHAPED * 2.0 * extent_px
    return moved_px if same else None


def _reshaped_px(here: np.ndarray, there: np.ndarray) -> float:
    """Rms of what a shift, a turn in the picture and a change of scale leave between corners (N, 2) and (N, 2)."""
    first, second = ((points - points.mean(axis=0)) @ np.array([1.0, 1.0j]) for points in (here, there))
    factor = np.vdot(first, second) / np.vdot(first, first)
    return float(np.sqrt(np.mean(np.abs(second - factor * first) ** 2)))
