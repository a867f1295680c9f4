"""What a lens is worth, in millimetres on plane C."""

from __future__ import annotations

import numpy as np

from ..calibrate.bundle import free_directions, refine
from ..calibrate.corner_stack import Observation
from ..calibrate.lens_models import LensModel
from ..camera import Camera
from ..geometry import Pose

_SIDES_M = (0.24, 0.12)
_DISTANCE_M = 0.4
_TILT_RAD = np.radians(35.0)
_GRID = (13, 7)


def plane_c() -> tuple[Pose, np.ndarray]:
    """Pose of plane C in the camera frame, and (M, 2) points on it, m: 240 x 120 mm at 0.4 m, tilted by 35°."""
    x, y = (np.linspace(-0.5, 0.5, count) * side for count, side in zip(_GRID, _SIDES_M, strict=True))
    tilt = Pose.from_rotvec(np.array([0.0, _TILT_RAD, 0.0]), np.array([0.0, 0.0, _DISTANCE_M]))
    return tilt, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def error_mm(camera: Camera, truth: Camera, from_jig: bool = False) -> float:
    """Rms distance on C between points and where the camera puts their pixels, mm.

    The pose of C is told; with `from_jig` it is solved with this camera from the same points, exactly seen, as a board
    in the jig gives it, which takes up much of a lens' error. Points outside the true picture are left out; a pixel
    that has no ray counts as 100 mm.
    """
    told, points = plane_c()
    space = np.column_stack([points, np.zeros(len(points))])
    pixels, valid = truth.project(told @ space)
    inside = valid & np.all((pixels > -0.5) & (pixels < np.array(truth.image_size) - 0.5), axis=1)
    pose = _solved_pose(camera, told, Observation(space[inside], pixels[inside])) if from_jig else told
    rays, seen = camera.unproject(pixels[inside])
    normal, origin = pose.rotation[:, 2], pose.translation_m
    with np.errstate(all="ignore"):
        hits = rays * ((normal @ origin) / (rays @ normal))[:, None]
    off = np.linalg.norm((hits - origin) @ pose.rotation[:, :2] - points[inside], axis=1)
    return 1e3 * float(np.sqrt(np.mean(np.where(seen & np.isfinite(off), np.minimum(off, 0.1), 0.1) ** 2)))


def _solved_pose(camera: Camera, start: Pose, board: Observation) -> Pose:
    intrinsics = camera.parameters
    model = LensModel("any", camera.model, len(camera.distortion), (), None)
    fixed = free_directions(model)[:, :0]
    vector = start.vector[None]
    pose = refine(model, intrinsics, vector, [board], fixed).poses[0]
    return Pose.from_rotvec(pose[:3], pose[3:])
