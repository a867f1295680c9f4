"""A camera on its way from one program's file to another's, and the checks of what such files hold."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import FARTHEST_M
from vbaa_calib.core.errors import InputError, about, shown
from vbaa_calib.geometry import Pose


@dataclass(frozen=True, eq=False)
class Exchanged:
    """A camera and its pose in the file's reference frame (in ours the antenna's); None without a pose.

    beside : contents that no other format can hold, in words. notes : on how the file was read.
    """

    camera: Camera
    T_reference_camera: Pose | None = None
    beside: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Format:
    """A file format: its name on the command line and in words, and what it can hold.

    parse : path and which camera of several → the camera. write : → text. Both raise InputError.
    fits : whether a text looks like this format.
    """

    name: str
    what: str
    parse: Callable[[Path, str | None], Exchanged]
    write: Callable[[Exchanged], str]
    fits: Callable[[str], bool]
    with_pose: bool = False
    with_covariance: bool = False
    several: bool = False

    def read(self, path: Path, which: str | None = None) -> Exchanged:
        """The camera in a file; `which` of several. Raises InputError naming what is wrong."""
        if which is not None and not self.several:
            raise InputError("holds one camera", where=path, remedy="leave --camera-name out")
        return self.parse(path, which)

    def lost(self, given: Exchanged) -> list[str]:
        """What a file of this format cannot hold of a camera, in words."""
        words = list(given.beside)
        if given.T_reference_camera is not None and not self.with_pose:
            words.append("the camera's pose")
        if given.camera.covariance is not None and not self.with_covariance:
            words.append("the covariance of the lens")
        return words


_COLUMNS, _ROWS = 41, 31


def stated(camera: Camera, models: Mapping[tuple[str, int], str], whose: str) -> tuple[str, list[float]]:
    """The lens model's name in another program, and its coefficients, padded with zeros.

    models : our model and a number of coefficients → the name. That of the camera's own number is taken, else the
    shortest that holds all coefficients but zeros. Raises InputError, with the error that leaving some out would cause,
    where there is none.
    """
    values = camera.distortion.tolist()
    needed = max((index + 1 for index, value in enumerate(values) if value != 0.0), default=0)
    counts = sorted(count for model, count in models if model == camera.model)
    if not counts:
        what = f"{whose} has no equidistant fisheye lens (k1 to k4 over the angle)"
        raise InputError(what, remedy="choose another format, or calibrate with another lens model (`--lens-model`)")
    fitting = [count for count in counts if count >= needed]
    if fitting:
        count = len(values) if len(values) in fitting else fitting[0]
        return models[camera.model, count], values[:count] + [0.0] * (count - len(values))
    longest = counts[-1]
    named = list(zip(camera.parameter_names[4:], values, strict=True))
    beyond = [f"{name} = {value:g}" for name, value in named[longest:] if value != 0.0]
    cost = _left_out_px(camera, longest)
    words = f"it would be off by up to {cost:.2g} px without them" if np.isfinite(cost) else "they matter"
    raise InputError(
        f"{whose} holds {longest} coefficients at most, this lens has {', '.join(beyond)} too: {words}",
        remedy="choose another format, or calibrate with a simpler lens (`--lens-model`)",
    )


def _left_out_px(camera: Camera, count: int) -> float:
    """Largest shift of picture points if only `count` coefficients are kept, without a new fit; NaN: unknown."""
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


def size_of(sides: Sequence[tuple[str, Any]], path: Path) -> tuple[int, int]:
    """(width, height) px of two keys with their values. Raises InputError for what is no whole number."""
    for key, value in sides:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not 0 < value <= _LARGEST_SIDE_PX or value != int(value):
            remedy = "a picture's side in whole pixels is needed"
            raise InputError(f"{key} is {shown(value)}", where=path, remedy=remedy)
    (_, width), (_, height) = sides
    return int(width), int(height)


def one_of(value: Any, known: Iterable[str], key: str, path: Path) -> str:
    """A known name. Raises InputError for anything else."""
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{key} is {value!r:.60}", where=path, remedy=f"one of {', '.join(known)} is needed")
    return value


def which_of(names: Sequence[str], which: str | None, path: Path) -> str:
    """The name of the chosen camera. Raises InputError where there is none, or several and no choice."""
    if not names:
        raise InputError("holds no camera", where=path, remedy="is it the file that is meant?")
    if which is None and len(names) > 1:
        raise InputError(
            f"holds {', '.join(names):.60}",
            where=path,
            remedy="say which with --camera-name NAME",
        )
    if which is not None and which not in names:
        raise InputError(f"holds no camera {which:.20}", where=path, remedy=f"it holds {', '.join(names):.60}")
    return which or names[0]


def numbers(values: Any, key: str, path: Path, counts: Sequence[int], most: float = 1e300) -> list[float]:
    """A flat list of numbers within ±most, as many as one of `counts`."""
    if not isinstance(values, list | tuple) or len(values) not in counts:
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{key} is {shown(values)}", where=path, remedy=f"a list of {wanted} numbers is needed")
    for value in values:
        # a whole number may be too large for a float
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < most:
            raise InputError(f"{key} holds {shown(value)}", where=path, remedy=f"numbers below {most:g} are needed")
    return [float(value) for value in values]


def matrix_of(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def checked(model: str, size: tuple[int, int], matrix: np.ndarray, coefficients: ArrayLike, path: Path) -> Camera:
    """A camera from its matrix (3, 3) and its coefficients. Raises InputError naming the file."""
    with about(path):
        return Camera(model, size, matrix, np.array(coefficients, float))


def pose_of(matrix: Any, key: str, path: Path) -> Pose:
    """A pose from four rows of four numbers. Raises InputError where the rotation is none."""
    if not isinstance(matrix, list | tuple) or len(matrix) != 4:
        raise InputError(f"{key} is {shown(matrix)}", where=path, remedy="four rows of four numbers are needed")
    rows = np.array([numbers(row, key, path, (4,), FARTHEST_M) for row in matrix])
    turn = rows[:3, :3]
    off = np.abs(turn @ turn.T - np.eye(3)).max() if np.abs(turn).max() < 2 else math.inf
    if off > _SQUARE or np.linalg.det(turn) < 0 or np.abs(rows[3] - [0, 0, 0, 1]).max() > 1e-9:
        raise InputError(f"{key} is no rigid motion", where=path, remedy="a rotation, a shift, and 0 0 0 1 are needed")
    return Pose(Rotation.from_matrix(turn).as_matrix(), rows[:3, 3])


def intrinsics(camera: Camera) -> list[float]:
    """fx, fy, cx, cy."""
    return camera.parameters[:4].tolist()
