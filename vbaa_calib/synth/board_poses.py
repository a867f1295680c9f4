"""Where the board is held for the pictures of the lens: spread over the picture, near and far, tilted every way."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec

from ..geometry import Pose
from .lens import Lens, normalise
from .scene import IntrinsicsSpec

_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
_PLACES = ((0, 0), (-1, -1), (1, 1), (1, -1), (-1, 1), (-1, 0), (1, 0), (0, -1), (0, 1))
_SPILL = 0.9


def board_poses(lens: Lens, board: BoardSpec, spec: IntrinsicsSpec, rng: np.random.Generator) -> list[Pose]:
    """T_camera_board of every picture: the board stays about inside the picture and reaches its borders and corners."""
    size = board.square_m * np.array([board.squares_x, board.squares_y])
    focal = np.diag(lens.matrix)[:2]
    middle = (np.array(lens.image_size) - 1) / 2
    poses = []
    for index in range(spec.pictures):
        distance, tilt = rng.uniform(*spec.distance_m), rng.uniform(*spec.tilt_rad)
        around = index * _GOLDEN_ANGLE + rng.uniform(-0.3, 0.3)
        turn = Rotation.from_rotvec(tilt * np.array([np.cos(around), np.sin(around), 0.0]))
        rotation = (turn * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-0.5, 0.5)])).as_matrix()
        room = np.maximum(middle - _SPILL * focal * size / (2 * distance), 0.0)
        pixel = middle + room * _PLACES[index % len(_PLACES)] * rng.uniform(0.85, 1.0)
        centre = distance * np.append(normalise(lens, pixel[None])[0], 1.0)
        poses.append(Pose(rotation, centre - rotation @ np.append(size / 2, 0.0)))
    return poses
