"""Values out of other programs' files, checked where they come in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...camera import Camera
from ...errors import InputError
from ...geometry import Pose

LARGEST_SIDE_PX = 100_000
"""As in the schema of rig.json."""
_SQUARE = 1e-3


def whole(value: Any, key: str, path: Path) -> int:
    """A whole number of pixels. Raises InputError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= LARGEST_SIDE_PX:
        raise InputError(f"{key} is {_shown(value)}", where=path, remedy="a picture's side in whole pixels is needed")
    if value != int(value):
        raise InputError(f"{key} is {value:g}", where=path, remedy="a picture's side in whole pixels is needed")
    return int(value)


def numbers(values: Any, key: str, path: Path, counts: Sequence[int]) -> list[float]:
    """A flat list of finite numbers, as many as one of `counts`."""
    if not isinstance(values, list | tuple) or len(values) not in counts:
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{key} is {_shown(values)}", where=path, remedy=f"a list of {wanted} numbers is needed")
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
            raise InputError(f"{key} holds {_shown(value)}", where=path, remedy="finite numbers are needed")
    return [float(value) for value in values]


def camera_of(
    model: str, image_size: tuple[int, int], core: Sequence[float], coefficients: Sequence[float], path: Path
) -> Camera:
    """A camera from fx, fy, cx, cy and its coefficients. Raises InputError naming the file."""
    fx, fy, cx, cy = core
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return checked(model, image_size, matrix, coefficients, path)


def checked(
    model: str, image_size: tuple[int, int], matrix: np.ndarray, coefficients: Sequence[float], path: Path
) -> Camera:
    """A camera from its matrix (3, 3) and its coefficients. Raises InputError naming the file."""
    try:
        return Camera(model, image_size, matrix, np.array(coefficients, float))
    except InputError as error:
        raise InputError(error.what, where=path, remedy=error.remedy) from None


def pose_of(matrix: Any, key: str, path: Path) -> Pose:
    """A pose from four rows of four numbers. Raises InputError where the rotation is none."""
    if not isinstance(matrix, list | tuple) or len(matrix) != 4:
        raise InputError(f"{key} is {_shown(matrix)}", where=path, remedy="four rows of four numbers are needed")
    rows = np.array([numbers(row, key, path, (4,)) for row in matrix])
    turn = rows[:3, :3]
    off = np.abs(turn @ turn.T - np.eye(3)).max() if np.abs(turn).max() < 2 else math.inf
    if off > _SQUARE or np.linalg.det(turn) < 0 or np.abs(rows[3] - [0, 0, 0, 1]).max() > 1e-9:
        raise InputError(f"{key} is no rigid motion", where=path, remedy="a rotation, a shift, and 0 0 0 1 are needed")
    return Pose(Rotation.from_matrix(turn).as_matrix(), rows[:3, 3])


def intrinsics(camera: Camera) -> list[float]:
    """fx, fy, cx, cy."""
    return [float(camera.matrix[index]) for index in ((0, 0), (1, 1), (0, 2), (1, 2))]


def _is_finite(value: int | float) -> bool:
    # a whole number may be too large for a float
    return abs(value) < 1e300


def _shown(value: Any) -> str:
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."
