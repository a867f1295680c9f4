"""Values out of other programs' files, checked where they come in."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose

_COLUMNS, _ROWS = 41, 31


def held_in(camera: Camera, counts: Sequence[int], whose: str) -> list[float]:
    """The camera's coefficients at the shortest of the lengths `counts` that holds all that are not zero.

    Shorter vectors are filled with zeros, which change nothing. Raises InputError, with what leaving them out would
    cost, where none is long enough.
    """
    values = camera.distortion.tolist()
    needed = max((index + 1 for index, value in enumerate(values) if value != 0.0), default=0)
    fitting = [count for count in sorted(counts) if count >= needed]
    if fitting:
        # keep the length that the camera has, where the format has it too: read again, it is the same camera
        count = len(values) if len(values) in fitting else fitting[0]
        return values[:count] + [0.0] * (count - len(values))
    longest = max(counts)
    named = list(zip(camera.parameter_names[4:], values, strict=True))
    beyond = [f"{name} = {value:g}" for name, value in named[longest:] if value != 0.0]
    cost = _left_out_px(camera, longest)
    words = f"it would be off by up to {cost:.2g} px without them" if np.isfinite(cost) else "they matter"
    raise InputError(
        f"{whose} holds {longest} coefficients at most, this lens has {', '.join(beyond)} too: {words}",
        remedy="choose another format, or calibrate with a simpler lens (`--model`)",
    )


def _left_out_px(camera: Camera, count: int) -> float:
    """How far points of the picture move, at most, when only the first `count` coefficients are kept; NaN: unknown.

    The lens is not fitted anew: that might make up for some of it.
    """
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, _COLUMNS), np.linspace(0, height - 1, _ROWS))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    rays, seen = camera.unproject(pixels)
    short = Camera(camera.model, camera.image_size, camera.matrix, camera.distortion[:count])
    moved, there = short.project(np.where(seen[:, None], rays, [0.0, 0.0, 1.0]))
    off = np.linalg.norm(moved - pixels, axis=1)[seen & there]
    return float(off.max()) if len(off) else float("nan")


_LARGEST_SIDE_PX = 100_000
"""As in the schema of rig.json."""
_SQUARE = 1e-3


def whole(value: Any, key: str, path: Path) -> int:
    """A whole number of pixels. Raises InputError for anything else."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0 < value <= _LARGEST_SIDE_PX or value != int(value):
        raise InputError(f"{key} is {_shown(value)}", where=path, remedy="a picture's side in whole pixels is needed")
    return int(value)


def one_of(value: Any, known: Iterable[str], key: str, path: Path) -> str:
    """One of the names that are known. Raises InputError for anything else."""
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{key} is {value!r:.60}", where=path, remedy=f"one of {', '.join(known)} is needed")
    return value


def which_of(names: Sequence[str], which: str | None, path: Path) -> str:
    """The camera that is meant. Raises InputError where there is none, or it is not said which of several."""
    if not names:
        raise InputError("holds no camera", where=path, remedy="is it the file that is meant?")
    if which is None and len(names) > 1:
        raise InputError(f"holds {', '.join(names):.60}", where=path, remedy="say which with --camera")
    if which is not None and which not in names:
        raise InputError(f"holds no camera {which:.20}", where=path, remedy=f"it holds {', '.join(names):.60}")
    return which or names[0]


def numbers(values: Any, key: str, path: Path, counts: Sequence[int]) -> list[float]:
    """A flat list of finite numbers, as many as one of `counts`."""
    if not isinstance(values, list | tuple) or len(values) not in counts:
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{key} is {_shown(values)}", where=path, remedy=f"a list of {wanted} numbers is needed")
    for value in values:
        # a whole number may be too large for a float
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
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


def _shown(value: Any) -> str:
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."
