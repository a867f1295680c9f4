"""Each view of a hand-eye calibration by itself: its inlying corners and the board poses that fit them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import SolveError
from vbaa_calib.core.robust import radial_std
from vbaa_calib.detect.board.corners import BoardView, require_corners
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Pose

from .board_pose import mirrored, require_size, start_poses, turn_between
from .hand_eye_fit import ViewCorners

LEAST_CORNERS = 6
_GROSS_CORNER, _GROSS_LEAST_PX = 6.4, 0.25  # one good corner in 1e9 lies further off
_SECOND_POSE, _SAME_RAD = 3.0, 1e-2


@dataclass(frozen=True, eq=False)
class SeenView:
    """A view's good corners, the one or two poses of the board that they allow, the squares (px²) that the better one
    leaves, how many corners were left out; or the reason why it is not used.
    """

    name: str
    reason: str = ""
    corners: ViewCorners | None = None
    poses: tuple[Pose, ...] = ()
    square: float = 0.0
    left_out: int = 0


def seen_view(view: BoardView, points: np.ndarray, camera: Camera) -> SeenView:
    """Raises InputError for another picture size, or corners that are none of the board's."""
    require_size(view.image_size, camera, view.name)
    ids, pixels = np.asarray(view.ids), np.asarray(view.corners_px, float)
    require_corners(ids, pixels, len(points), view.name)
    if len(ids) < LEAST_CORNERS:
        return SeenView(view.name, f"{len(ids)} corners, at least {LEAST_CORNERS} are needed")
    rays, valid = camera.unproject(pixels)
    seen = valid & (rays[:, 2] > 0.05)
    flat = np.where([True, True, False], points[ids], 0.0)
    if seen.sum() < LEAST_CORNERS or not fixes_homography(flat[seen, :2]):
        return SeenView(view.name, "its corners lie (nearly) on a line, or the lens does not see them")
    try:
        starts = start_poses(flat[seen], rays[seen, :2] / rays[seen, 2:])
    except SolveError as error:
        return SeenView(view.name, str(error))
    every = ViewCorners(points[ids[seen]], pixels[seen], _weights(view, seen))
    if len(starts) == 1:
        starts.append(mirrored(starts[0], every.points_m))
    found = [every.posed(camera, start) for start in starts]
    pose, distances = min(found, key=lambda one: float(np.minimum(one[1], 10.0 * np.median(one[1])).sum()))
    inlying = distances <= max(_GROSS_CORNER * radial_std(distances), _GROSS_LEAST_PX)
    if inlying.sum() < LEAST_CORNERS or not fixes_homography(every.points_m[inlying, :2]):
        return SeenView(view.name, "no pose of the board explains its corners")
    corners = ViewCorners(every.points_m[inlying], every.pixels[inlying], every.weights[inlying])
    best, distances = corners.posed(camera, pose)
    poses, square = [best], float((distances**2).sum())
    other, _ = max(found, key=lambda one: turn_between(one[0], best))
    second, off = corners.posed(camera, other)
    ahead = second.translation_m[2] > 0.0 and turn_between(second, best) > _SAME_RAD
    if ahead and float((off**2).sum()) < _SECOND_POSE**2 * square:
        poses.append(second)
    return SeenView(view.name, "", corners, tuple(poses), square, len(ids) - int(inlying.sum()))


def _weights(view: BoardView, seen: np.ndarray) -> np.ndarray:
    """(N,) of the corners' residuals: what is less certain than the median corner counts less."""
    if view.covariance_px2 is None:
        return np.ones(int(seen.sum()))
    variance = np.trace(view.covariance_px2[seen], axis1=1, axis2=2)
    middle = max(float(np.median(variance)), 1e-12)
    # besides the picture's noise all corners have errors of print, blur and lens
    return np.sqrt(2.0 * middle / (variance + middle))
