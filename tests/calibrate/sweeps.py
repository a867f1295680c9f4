"""Sweeps with exactly known corners, without pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import SweepPicture

from .synthetic_views import CENTRE, board_view, project_board

SIZE = (1280, 960)
LENSES = {
    "opencv4": np.array([1100.0, 1098.0, 645.0, 476.0, -0.18, 0.06, 5e-4, -6e-4]),
    "rational": np.array([600.0, 602.0, 645.0, 476.0, 0.3, 0.05, 4e-4, -6e-4, 0.002, 0.65, 0.12, 0.01]),
    "fisheye": np.array([420.0, 421.0, 641.0, 478.0, 0.05, -0.01, 0.003, -0.001]),
}
T_ANTENNA_CAMERA = Pose.from_rotvec(np.array([2.6, 0.3, -0.4]), np.array([0.03, -0.02, 0.3]))
RIG = Kinematics(
    Pose.from_rotvec(np.array([0.02, -0.3, 0.1]), np.array([0.012, 0.004, 0.006])), np.array([0.1, 0.2, 0.15])
)
FEW = [(0.0, 0.0), (0.25, 0.0), (0.0, 0.2), (-0.2, 0.0), (0.0, -0.2), (0.2, 0.2)]
GRID = [(pan, tilt) for pan in (-0.25, 0.0, 0.25) for tilt in (-0.2, 0.0, 0.2)] + [(0.12, 0.1), (-0.12, -0.1)]
Sweep = tuple[list[BoardView], list[SweepPicture]]


def camera(lens: str = "opencv4", change: np.ndarray | float = 0.0) -> Camera:
    return camera_of(LENS_MODELS[lens], LENSES[lens] + change, SIZE)


def T_world_board() -> Pose:
    """In the middle of the picture with the joints at zero, leaning."""
    turn = Pose.from_rotvec(np.array([0.45, -0.25, 0.1]), np.zeros(3)).rotation
    return RIG.T_world_antenna(0.0, 0.0) @ T_ANTENNA_CAMERA @ Pose(turn, np.array([0.0, 0.0, 0.22]) - turn @ CENTRE)


def sweep(
    rig: Kinematics = RIG,
    angles: Sequence[tuple[float, float]] = GRID,
    sigma_px: float = 0.1,
    angle_std_rad: float = 0.0,
    seed: int = 0,
    lens: str = "opencv4",
) -> Sweep:
    """The board in every picture, and the readings, which scatter about the true angles."""
    rng = np.random.default_rng(seed)
    views, pictures = [], []
    for index, (pan, tilt) in enumerate(angles):
        true = np.array([pan, tilt]) + angle_std_rad * rng.standard_normal(2)
        T_camera_board = (rig.T_world_antenna(*true) @ T_ANTENNA_CAMERA).inverse() @ T_world_board()
        pixels = project_board(LENS_MODELS[lens], LENSES[lens], T_camera_board)
        views.append(board_view(f"{index}.png", pixels, SIZE, rng, sigma_px))
        pictures.append(SweepPicture(Path(f"{index}.png"), pan, tilt))
    return views, pictures


def misread(taken: Sweep, index: int, pan_rad: float = 0.0, tilt_rad: float = 0.0) -> Sweep:
    """The same with one row wrong by so much."""
    views, pictures = taken
    row = pictures[index]
    wrong = replace(row, pan_rad=row.pan_rad + pan_rad, tilt_rad=row.tilt_rad + tilt_rad)
    return views, [*pictures[:index], wrong, *pictures[index + 1 :]]
