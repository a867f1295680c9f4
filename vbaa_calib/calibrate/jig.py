"""Plane C by a board in a jig: its place on the antenna's base is known, so its pose in the camera is the camera's."""

from __future__ import annotations

import numpy as np

from ..geometry import Pose
from .plane import BoardPose
from .pose_estimate import PoseEstimate


def jig_estimate(
    board_pose: BoardPose, T_antenna_board: Pose, translation_std_m: float = 0.0, rotation_std_rad: float = 0.0
) -> PoseEstimate:
    """The camera's pose in the antenna frame.

    The deviations are what the jig itself is worth: how far the board's origin, and its turn about each axis, may be
    off from `T_antenna_board`.
    """
    T_camera_board = board_pose.T_camera_board
    T_antenna_camera = T_antenna_board @ T_camera_board.inverse()
    rotation = T_antenna_camera.rotation
    # Turning the board by w turns the camera by −R·w about the board, which also moves it.
    lever = cross_matrix(rotation @ T_camera_board.translation_m)
    by_board = np.block([[-rotation, np.zeros((3, 3))], [-lever @ rotation, -rotation]])
    by_jig = np.block([[np.eye(3), np.zeros((3, 3))], [lever, np.eye(3)]])
    jig = np.repeat([rotation_std_rad, translation_std_m], 3) ** 2
    return PoseEstimate(
        "jig",
        T_antenna_camera,
        by_board @ board_pose.covariance @ by_board.T + by_jig * jig @ by_jig.T,
        by_board @ board_pose.lens_sensitivity,
    )


def cross_matrix(vector: np.ndarray) -> np.ndarray:
    """(3, 3) with `cross_matrix(a) @ b == np.cross(a, b)`."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
