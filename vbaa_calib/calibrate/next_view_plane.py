"""The plane on which the lens has to be good: where the antenna moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec

from ..geometry import Pose

_GRID = (13, 7)
_HALF_WIDTH_PER_LENGTH = 0.25


@dataclass(frozen=True, eq=False)
class WorkPlane:
    """Plane C as far as it is known, and the part of it that is used.

    Attributes
    ----------
    T_camera_plane : z = 0 is the plane, x runs along the antenna from the clamp.
    length_m, half_width_m : used are x from 0 to the length and y from minus to plus the half width.
    """

    T_camera_plane: Pose
    length_m: float
    half_width_m: float

    @staticmethod
    def about(distance_m: float, inclination_rad: float, length_m: float) -> WorkPlane:
        """Before the jig was seen: its middle on the camera's axis, turned about the picture's upright."""
        turn = Pose.from_rotvec(np.array([0.0, inclination_rad, 0.0]), np.array([0.0, 0.0, distance_m]))
        to_clamp = Pose(np.eye(3), np.array([-length_m / 2, 0.0, 0.0]))
        return WorkPlane(turn @ to_clamp, length_m, _HALF_WIDTH_PER_LENGTH * length_m)

    @property
    def points(self) -> np.ndarray:
        """(n, 2) x and y of points all over the part that is used, m."""
        x, y = np.linspace(0.0, self.length_m, _GRID[0]), np.linspace(-1.0, 1.0, _GRID[1]) * self.half_width_m
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    @property
    def distance_m(self) -> float:
        """From the camera to the middle of the part that is used."""
        return float(np.linalg.norm(self.T_camera_plane @ np.array([self.length_m / 2, 0.0, 0.0])))

    def board_pose(self, spec: BoardSpec) -> Pose:
        """T_camera_board of a board that lies on the plane in the middle of the part that is used, print up."""
        half = spec.square_m * np.array([spec.squares_x, spec.squares_y]) / 2
        away = self.T_camera_plane.rotation[:, 2] @ self.T_camera_plane.translation_m >= 0.0
        # the board's z leads away from the camera, whichever way the plane's does
        turn = np.eye(3) if away else np.diag([1.0, -1.0, -1.0])
        middle = np.array([self.length_m / 2, 0.0, 0.0])
        return self.T_camera_plane @ Pose(turn, middle - turn @ np.append(half, 0.0))
