"""What a lens is truly worth on plane C, the camera's pose found again from the board in the jig with that lens."""

from __future__ import annotations

import numpy as np

from targets.charuco import corner_points

from ..calibrate.bundle import free_directions, refine
from ..calibrate.corner_stack import Observation
from ..calibrate.lens_models import LensModel
from ..camera import Camera
from ..geometry import Pose
from .guided_rigs import Rig

_NOWHERE_M = 0.1


def true_error_mm(camera: Camera, rig: Rig, board_pose: Pose | None = None) -> float:
    """Rms distance on C between points and where the lens puts their true pixels, mm; 100 mm where there is no ray.

    board_pose : of the board in the jig as it was found with this lens; without it, found from corners exactly seen.
    """
    truth, plane, told = rig.camera, rig.plane, rig.plane.points
    pixels, inside = _seen(truth, plane.T_camera_plane @ np.column_stack([told, np.zeros(len(told))]))
    true_board = plane.board_pose(rig.board)
    found = _board_pose(camera, truth, true_board, corner_points(rig.board)) if board_pose is None else board_pose
    T_camera_plane = found @ true_board.inverse() @ plane.T_camera_plane
    rays, valid = camera.unproject(pixels[inside])
    normal, origin = T_camera_plane.rotation[:, 2], T_camera_plane.translation_m
    with np.errstate(all="ignore"):
        hits = rays * ((normal @ origin) / (rays @ normal))[:, None]
    off = np.linalg.norm((hits - origin) @ T_camera_plane.rotation[:, :2] - told[inside], axis=1)
    kept = np.where(valid & np.isfinite(off), np.minimum(off, _NOWHERE_M), _NOWHERE_M)
    return 1e3 * float(np.sqrt(np.mean(kept**2)))


def _seen(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pixels, valid = camera.project(points)
    return pixels, valid & np.all((pixels > -0.5) & (pixels < np.array(camera.image_size) - 0.5), axis=1)


def _board_pose(camera: Camera, truth: Camera, start: Pose, points: np.ndarray) -> Pose:
    pixels, inside = _seen(truth, start @ points)
    intrinsics = camera.parameters
    model = LensModel("any", camera.model, len(camera.distortion), (), None)
    vector = start.vector[None]
    board = Observation(points[inside], pixels[inside])
    pose = refine(model, intrinsics, vector, [board], free_directions(model)[:, :0]).poses[0]
    return Pose.from_rotvec(pose[:3], pose[3:])
