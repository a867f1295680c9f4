"""What a lens is truly worth on plane C, the camera's pose found again from the board in the jig with that lens."""

from __future__ import annotations

import numpy as np

from targets.charuco import corner_points

from ..calibrate.corner_stack import Observation
from ..camera import Camera
from ..geometry import Pose
from .calibration_judge import pose_by, rms_on_plane_mm
from .guided_rigs import Rig


def true_error_mm(camera: Camera, rig: Rig, board_pose: Pose | None = None) -> float:
    """Rms distance on C between points and where the lens puts their true pixels, mm; 100 mm where there is no ray.

    board_pose : of the board in the jig as it was found with this lens; without it, found from corners exactly seen.
    """
    truth, plane, told = rig.camera, rig.plane, rig.plane.points
    pixels, inside = _seen(truth, plane.T_camera_plane @ np.column_stack([told, np.zeros(len(told))]))
    true_board = plane.board_pose(rig.board)
    found = _board_pose(camera, truth, true_board, corner_points(rig.board)) if board_pose is None else board_pose
    T_camera_plane = found @ true_board.inverse() @ plane.T_camera_plane
    return rms_on_plane_mm(camera, T_camera_plane, told[inside], pixels[inside])


def _seen(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pixels, valid = camera.project(points)
    return pixels, valid & camera.in_picture(pixels)


def _board_pose(camera: Camera, truth: Camera, start: Pose, points: np.ndarray) -> Pose:
    pixels, inside = _seen(truth, start @ points)
    return pose_by(camera, start, Observation(points[inside], pixels[inside]))
