"""An arm that carries a camera or a board, with poses that are off, without pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from targets.board import corner_points
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

from .synthetic_views import CENTRE, SPEC, board_view, pose_towards, project_board

SIZE = (1280, 960)
INTRINSICS = np.array([1100.0, 1098.0, 645.0, 476.0, -0.18, 0.06, 5e-4, -6e-4])
POINTS = corner_points(SPEC)
X = Pose.from_rotvec(np.array([0.3, -1.2, 2.1]), np.array([0.04, -0.03, 0.09]))
Z = Pose.from_rotvec(np.array([-1.4, 0.6, 0.9]), np.array([0.5, -0.2, 0.07]))


@dataclass(frozen=True)
class Arm:
    """How a set is made. robot_std : rad and m per axis. lens_std : of focal lengths, relative, and the centre, px."""

    mount: str = "hand"
    count: int = 15
    sigma_px: float = 0.15
    robot_std: tuple[float, float] = (5e-4, 3e-4)
    lens_std: tuple[float, float] = (0.0, 0.0)
    tilt_rad: float = 0.6
    one_axis: bool = False


def lens(arm: Arm, rng: np.random.Generator | None = None) -> Camera:
    """With its covariance; drawn from it, or true."""
    std = np.zeros(len(INTRINSICS))
    std[:2], std[2:4] = INTRINSICS[:2] * arm.lens_std[0], arm.lens_std[1]
    off = np.zeros(len(INTRINSICS)) if rng is None else std * rng.standard_normal(len(INTRINSICS))
    camera = camera_of(LENS_MODELS["opencv4"], INTRINSICS + off, SIZE)
    return Camera("opencv", SIZE, camera.matrix, camera.distortion, np.diag(std**2))


def views_and_poses(arm: Arm, seed: int = 0) -> tuple[list[BoardView], list[Pose]]:
    """Views, and the robot's readings, true where robot_std is nil."""
    rng = np.random.default_rng(seed)
    views, readings = [], []
    for index in range(arm.count):
        T_camera_board = pose_towards(rng, 0.22, arm.tilt_rad)
        if arm.one_axis:
            turn = Pose.from_rotvec(np.array([0.0, rng.uniform(-0.6, 0.6), 0.0]), np.zeros(3)).rotation
            middle = np.array([*rng.normal(0.0, 0.02, 2), 0.22])
            T_camera_board = Pose(turn, middle - turn @ CENTRE)
        in_hand = Z @ T_camera_board.inverse() @ X.inverse()
        true = in_hand if arm.mount == "hand" else X @ T_camera_board @ Z.inverse()
        off = np.repeat(arm.robot_std, 3) * rng.standard_normal(6)
        readings.append(true @ Pose.from_rotvec(off[:3], off[3:]))
        pixels = project_board(LENS_MODELS["opencv4"], INTRINSICS, T_camera_board)
        views.append(board_view(f"{index:02d}", pixels, SIZE, rng, arm.sigma_px))
    return views, readings
