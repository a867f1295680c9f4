"""The error of a lens, in millimetres on plane C."""

from __future__ import annotations

import numpy as np

from vbaa_calib.calibrate.lens.bundle import Bundle, Observation, refine
from vbaa_calib.calibrate.lens.models import LensModel
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose

_SIDES_M = (0.24, 0.12)
_DISTANCE_M = 0.4
_TILT_RAD = np.radians(35.0)
_GRID = (13, 7)
_NOWHERE_M = 0.1
"""What a pixel counts that has no ray, and the most that any does."""


def plane_c() -> tuple[Pose, np.ndarray]:
    """Pose of plane C in the camera frame, and (M, 2) points on it, m: 240 x 120 mm at 0.4 m, tilted by 35°."""
    x, y = (np.linspace(-0.5, 0.5, count) * side for count, side in zip(_GRID, _SIDES_M, strict=True))
    tilt = Pose.from_rotvec(np.array([0.0, _TILT_RAD, 0.0]), np.array([0.0, 0.0, _DISTANCE_M]))
    return tilt, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def error_mm(camera: Camera, truth: Camera, from_jig: bool = False) -> float:
    """Rms distance on C between points and where the camera puts their pixels, mm.

    The pose of C is the true one; with `from_jig` it is solved with this camera from the same points without noise, as
    a board in the jig gives it, which takes up much of a lens' error. Points outside the true picture do not count; a
    pixel that has no ray counts as 100 mm.
    """
    T_camera_plane, points = plane_c()
    space = np.column_stack([points, np.zeros(len(points))])
    pixels, valid = truth.project(T_camera_plane @ space)
    inside = valid & truth.in_picture(pixels)
    if from_jig:
        T_camera_plane = pose_by(camera, T_camera_plane, Observation(space[inside], pixels[inside]))
    return rms_on_plane_mm(camera, T_camera_plane, points[inside], pixels[inside])


def rms_on_plane_mm(camera: Camera, T_camera_plane: Pose, points_m: np.ndarray, pixels: np.ndarray) -> float:
    """Rms distance between points (M, 2) on a plane and where the camera puts their pixels (M, 2), 100 mm at most."""
    rays, seen = camera.unproject(pixels)
    normal, origin = T_camera_plane.rotation[:, 2], T_camera_plane.translation_m
    with np.errstate(all="ignore"):
        hits = rays * ((normal @ origin) / (rays @ normal))[:, None]
    off = np.linalg.norm((hits - origin) @ T_camera_plane.rotation[:, :2] - points_m, axis=1)
    kept = np.where(seen & np.isfinite(off), np.minimum(off, _NOWHERE_M), _NOWHERE_M)
    return 1e3 * float(np.sqrt(np.mean(kept**2)))


def pose_by(camera: Camera, start: Pose, board: Observation) -> Pose:
    """T_camera_board as this camera has it, by corners exactly seen."""
    model = LensModel("any", camera.model, len(camera.distortion), (), None)
    pose = refine(Bundle.start(model, camera.parameters, start.vector[None]).poses_only, [board]).poses[0]
    return Pose.from_rotvec(pose[:3], pose[3:])
