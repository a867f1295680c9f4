"""How close a live picture is to the pose that was suggested, and what to change."""

from __future__ import annotations

import cv2
import numpy as np

from targets.board import BoardSpec
from targets.charuco import corner_points

from ..camera import Camera
from ..detect.corners import BoardView
from ..detect.view_quality import fixes_homography
from ..geometry import Pose
from .lens_models import LENS_MODELS, camera_of
from .next_view_suggest import Suggestion
from .next_view_words import Seen, lean_words, seen_as
from .next_view_worth import nominal_intrinsics

_LEAST_CORNERS = 6
_PLACE, _DISTANCE, _LEAN_RAD = 0.12, 0.2, np.radians(15.0)
_SAY = 0.6
_LONG_RAD = np.radians(40.0)


def closeness(
    suggestion: Suggestion,
    view: BoardView,
    spec: BoardSpec,
    camera: Camera | None,
    image_size: tuple[int, int],
) -> tuple[float, str]:
    """0 to 1, and what to change in words ("further left, nearer"). Above about 0.6 is as good as the pose itself.

    camera : the lens so far; without it a nominal one is taken. image_size : (width, height) px of the view.
    """
    if len(view.ids) == 0:
        return 0.0, "the board is not seen"
    points = corner_points(spec)[view.ids]
    if len(view.ids) < _LEAST_CORNERS or not fixes_homography(points[:, :2]):
        return 0.0, "too little of the board is seen"
    camera = camera or camera_of(LENS_MODELS["none"], nominal_intrinsics(image_size), image_size)
    pose = _pose(points, view.corners_px, camera)
    if pose is None:
        return 0.0, "the board is seen at too flat an angle"
    return _compared(seen_as(camera, suggestion.T_camera_board, spec), seen_as(camera, pose, spec))


def _pose(points: np.ndarray, pixels: np.ndarray, camera: Camera) -> Pose | None:
    flat, valid = camera.unproject_normalized(pixels)
    if valid.sum() < _LEAST_CORNERS or not fixes_homography(points[valid, :2]):
        return None
    ok, rotvec, shift = cv2.solvePnP(points[valid], flat[valid], np.eye(3), None)
    return Pose.from_rotvec(rotvec.ravel(), shift.ravel()) if ok and shift[2, 0] > 0.0 else None


def _compared(wanted: Seen, seen: Seen) -> tuple[float, str]:
    across, down = np.subtract(wanted.place, seen.place)
    farther = np.log(wanted.distance_m / seen.distance_m)
    lean = _lean(wanted) - _lean(seen)
    turn = (wanted.long_rad - seen.long_rad + np.pi / 2) % np.pi - np.pi / 2
    parts = [
        (abs(across) / _PLACE, "further right" if across > 0 else "further left"),
        (abs(down) / _PLACE, "lower" if down > 0 else "higher"),
        (abs(farther) / _DISTANCE, "farther away" if farther > 0 else "nearer"),
        (float(np.linalg.norm(lean)) / _LEAN_RAD, _lean_words(wanted)),
        (0.6 * max(abs(turn) / _LONG_RAD - 0.5, 0.0) * 2, "turned by a quarter" if abs(turn) > 1.0 else "less askew"),
    ]
    share = float(1.0 / (1.0 + 0.4 * sum(size**2 for size, _ in parts)))
    said = [words for size, words in sorted(parts, reverse=True) if size > _SAY][:3]
    return share, ", ".join(said) if said else "hold it there"


def _lean(seen: Seen) -> np.ndarray:
    return seen.tilt_rad * np.array([np.cos(seen.away_rad), np.sin(seen.away_rad)])


def _lean_words(wanted: Seen) -> str:
    return lean_words(wanted.tilt_rad, wanted.away_rad)
