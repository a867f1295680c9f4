"""Coverage of the picture and variety of the poses in a set of views; one picture against those before it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.detect.quality.screen import LEAST_CORNERS

_SAME_SHAPE = 0.01
_MOVED_SQUARES = 0.5
"""A board that moved by less than so many of its squares is in the same place."""
_RESHAPED = 0.006
"""Change of its outline's shape, rms per extent, below which it is tilted as before, to about 6°."""
_FEWEST_VIEWS = 5
_TILTED_DEG = 15.0
_LEAST_HULL, _REPEATED = 0.5, 0.5


def resolution_changed(size: tuple[int, int], first: tuple[int, int]) -> Diagnosis | None:
    """Why a picture of `size` (width, height) px differs from the first one in size; None where it does not."""
    if tuple(size) == tuple(first):
        return None
    wide, high = size[0] / first[0], size[1] / first[1]
    remedy = "set the camera to the mode of the first picture, or begin anew in this one: the lens is another for it"
    if (size[1], size[0]) == tuple(first):
        name, cause = "picture_turned", "width and height are exchanged"
        remedy = "hold the camera as before, and switch off that pictures are turned upright"
    elif abs(wide - high) < _SAME_SHAPE * high:
        name, cause = "picture_scaled", f"it is scaled by {wide:.3g}"
        remedy = "set the camera to the resolution of the first picture, and copy originals, no previews"
    elif wide <= 1.0 and high <= 1.0:
        name, cause = "picture_cropped", "it is cropped, or the camera is in another mode"
    else:
        name = "picture_cropped"
        cause = "the camera is in another mode, which may cut off a border or use other pixels"
    seen = f"the picture is {size[0]}x{size[1]} px, the first one {first[0]}x{first[1]} px"
    return Diagnosis(name, f"{seen}: {cause}", remedy, grave=True)


def same_pose(view: BoardView, earlier: Sequence[BoardView], spec: BoardSpec) -> Diagnosis | None:
    """The nearest earlier view that shows the board in (nearly) the same pose, if one does."""
    near = [(distance, other) for other in earlier if (distance := _apart_px(view, other, spec)) is not None]
    if not near:
        return None
    distance, other = min(near, key=lambda one: one[0])
    return Diagnosis(
        "same_pose",
        f"the board is as in {other.name}, its corners {distance:.1f} px from there",
        "tilt it differently, or move it to another part of the picture",
    )


def _apart_px(view: BoardView, other: BoardView, spec: BoardSpec) -> float | None:
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
    # what a shift, a turn in the picture and a change of scale leave
    first, second = ((points - points.mean(axis=0)) @ np.array([1.0, 1.0j]) for points in (here, there))
    factor = np.vdot(first, second) / np.vdot(first, first)
    reshaped_px = float(np.sqrt(np.mean(np.abs(second - factor * first) ** 2)))
    same = moved_px < _MOVED_SQUARES * square_px and reshaped_px < _RESHAPED * 2.0 * extent_px
    return moved_px if same else None


def poorly_covered(views: Sequence[BoardView]) -> Diagnosis | None:
    """Whether the corners leave out much of the picture, and which of its corners: a quarter of its width by a third.

    views : of one picture size, at least one.
    """
    size, pixels = np.array(views[0].image_size), np.concatenate([view.corners_px for view in views])
    hull = float(cv2.contourArea(cv2.convexHull(pixels.astype(np.float32)))) / size.prod() if len(pixels) > 2 else 0.0
    column, row = np.clip((pixels + 0.5) / size * (4, 3), 0, (3, 2)).astype(int).T
    places = {"upper left": (0, 0), "upper right": (3, 0), "lower left": (0, 2), "lower right": (3, 2)}
    empty = [name for name, (x, y) in places.items() if not ((column == x) & (row == y)).any()]
    if hull >= _LEAST_HULL and len(empty) < 2:
        return None
    where = f", none in the {', '.join(empty)}" if empty else ""
    return Diagnosis(
        "border_empty",
        f"the corners reach over {100 * hull:.0f} % of the picture{where}",
        f"show the board in the {empty[0] if empty else 'picture’s corners'}, also partly outside",
    )


def little_variety(views: Sequence[BoardView], solution: LensSolution, spec: BoardSpec) -> list[Diagnosis]:
    """Poses that repeat, boards that are never tilted, or about one axis only."""
    found: list[Diagnosis] = []
    kept: list[BoardView] = []
    for view in views:
        if all(_apart_px(view, other, spec) is None for other in kept):
            kept.append(view)
    if len(views) - len(kept) >= _REPEATED * len(views):
        words = f"{len(views)} pictures show the board in {len(kept)} poses only"
        remedy = "one picture of each pose is enough: turn and move the board between them"
        found.append(Diagnosis("same_poses", words, remedy))
    # boards whose normals hardly spread, or along one line only
    normals = np.array([view.T_camera_board.rotation[:, 2] for view in solution.views])
    axes = np.linalg.svd(normals)[2]
    around = np.arctan2(normals @ axes[1:].T, np.abs(normals @ axes[:1].T))
    narrow, wide = np.degrees(sorted(np.ptp(around, axis=0)))
    if wide < _TILTED_DEG:
        words = f"the board's directions differ by {wide:.0f}° at most"
        remedy = "tilt it by 30° to 45° in several pictures, each time another edge towards the camera"
        found.append(Diagnosis("never_tilted", words, remedy))
    elif narrow < _TILTED_DEG:
        words = f"the board is tilted about one axis only: by {wide:.0f}°, about the other by {narrow:.0f}°"
        remedy = "tilt it about the other axis, too: a neighbouring edge towards the camera"
        found.append(Diagnosis("tilted_one_way", words, remedy))
    return found if len(solution.views) >= _FEWEST_VIEWS else []
