"""A session: one folder with everything that was measured on one rig. Read here, checked here, never written."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec

from . import schemas
from .errors import InputError
from .files import number, read_csv, read_yaml, whole_number
from .geometry import Kinematics, Pose

SCHEMA = "vbaa.session/1"


@dataclass(frozen=True)
class NominalAntenna:
    """What the user says of the antenna; stiffness and no-load shape are solved for."""

    length_m: float
    diameter_m: float
    youngs_modulus_Pa: float
    density_kg_m3: float

    @property
    def stiffness_Nm2(self) -> float:
        """E·πd⁴/64."""
        return float(self.youngs_modulus_Pa * np.pi * self.diameter_m**4 / 64)

    @property
    def mass_per_length_kg_m(self) -> float:
        """ρ·πd²/4."""
        return float(self.density_kg_m3 * np.pi * self.diameter_m**2 / 4)


@dataclass(frozen=True, eq=False)
class Session:
    """session.yaml, checked.

    Attributes
    ----------
    T_antenna_board : pose of the board's printed face in the jig, or None without a jig.
    gravity_world_m_s2 : (3,), zero when weightless.
    moment_std_Nm : the moment sensor's noise.
    """

    root: Path
    board: BoardSpec
    antenna: NominalAntenna
    T_antenna_board: Pose | None
    kinematics: Kinematics
    gravity_world_m_s2: np.ndarray
    moment_std_Nm: float

    def gravity_antenna(self, frames: Sequence[Still]) -> np.ndarray:
        """(B, 3) gravity in the antenna frame at each frame's joint angles."""
        return gravity_antenna(self.kinematics, self.gravity_world_m_s2, frames)


@dataclass(frozen=True)
class Still:
    """One picture of the antenna with the joints at rest. `moment_Nm` is the sensor's reading."""

    image: Path | None
    pan_rad: float
    tilt_rad: float
    moment_Nm: float


@dataclass(frozen=True)
class Load(Still):
    """A known load: force components (y, z), antenna frame, hung at an arc length from the clamp."""

    distance_m: float
    force_y_N: float
    force_z_N: float


@dataclass(frozen=True)
class Frame(Still):
    """One frame of a recording."""

    frame: int
    time_s: float


def gravity_antenna(kinematics: Kinematics, gravity_world_m_s2: np.ndarray, frames: Sequence[Still]) -> np.ndarray:
    """(B, 3) gravity in the antenna frame at each frame's joint angles."""
    turns = [kinematics.T_world_antenna(frame.pan_rad, frame.tilt_rad).rotation for frame in frames]
    return np.array([turn.T @ gravity_world_m_s2 for turn in turns]).reshape(-1, 3)


def load_session(root: Path) -> Session:
    """Read and check session.yaml. Raises InputError naming the key that is wrong."""
    root = Path(root)
    if not root.is_dir():
        problem = "is not a folder" if root.exists() else "no such folder"
        raise InputError(problem, where=root, remedy="name a session folder (docs/formats.md)")
    path = root / "session.yaml"
    data = read_yaml(path)
    schemas.check(data, "session", path)
    try:
        board = BoardSpec.from_dict(data["board"])
    except ValueError as error:
        raise InputError(f"board: {error}", where=path, remedy="describe the board that was printed") from None
    jig, kinematics = data.get("jig"), data.get("kinematics") or {}
    T_antenna_board = None
    if jig:
        # The jig holds the board's back; the printed face lies one thickness nearer to the viewer, along −z.
        face = Pose(np.eye(3), np.array([0.0, 0.0, -board.thickness_m]))
        T_antenna_board = read_pose(jig["T_antenna_board"], path, "jig.T_antenna_board") @ face
    mount = kinematics.get("T_actuator_antenna")
    return Session(
        root=root,
        board=board,
        antenna=NominalAntenna(**{key: float(value) for key, value in data["antenna"].items()}),
        T_antenna_board=T_antenna_board,
        kinematics=Kinematics(
            read_pose(mount, path, "kinematics.T_actuator_antenna") if mount else Pose.identity(),
            np.asarray(kinematics.get("position_world_m", (0.0, 0.0, 0.0)), float),
        ),
        gravity_world_m_s2=np.asarray(data["gravity_world"] or (0.0, 0.0, 0.0), float),
        moment_std_Nm=float(data["moment_sensor"]["std_Nm"]),
    )


def read_pose(data: Mapping[str, Any], where: object, key: str) -> Pose:
    """A pose out of a checked file. Raises InputError when the quaternion is not one."""
    length = math.hypot(*data["rotation_xyzw"])
    if not 0.99 < length < 1.01:
        raise InputError(
            f"{key}.rotation_xyzw has length {length:.3g}", where=where, remedy="a unit quaternion x, y, z, w is needed"
        )
    return Pose(Rotation.from_quat(data["rotation_xyzw"]).as_matrix(), np.asarray(data["translation_m"], float))


def _wrong(row: Mapping[str, str], path: Path, what: str, remedy: str) -> InputError:
    return InputError(what, where=f"{path} line {row['line']}", remedy=remedy)


def _still(row: Mapping[str, str], path: Path, with_image: bool) -> dict[str, Any]:
    angles = {name: number(row, name, path) for name in ("pan_rad", "tilt_rad")}
    for name, value in angles.items():
        if abs(value) > 2 * np.pi:
            raise _wrong(row, path, f"{name} is {value:g}, more than a turn", "give radians")
    image = _picture(row, path) if with_image else None
    return {"image": image, **angles, "moment_Nm": number(row, "moment_Nm", path)}


def _picture(row: Mapping[str, str], path: Path) -> Path:
    if not row["image"]:
        raise _wrong(row, path, "image is empty", "name the picture")
    image = path.parent / row["image"]
    if not os.path.isfile(image):  # Path.is_file raises for a name that is too long
        raise _wrong(row, path, f"the picture {row['image']} is not there", f"put it at {image}")
    return image


def _refuse_repeated_pictures(stills: Sequence[Still], rows: Sequence[Mapping[str, str]], path: Path) -> None:
    lines: dict[Path | None, str] = {}
    for still, row in zip(stills, rows, strict=True):
        if still.image in lines:
            what = f"the picture {row['image']} stands in line {lines[still.image]}, too"
            raise _wrong(row, path, what, "every row needs its own picture")
        lines[still.image] = row["line"]


def _require(path: Path, why: str) -> None:
    if not path.exists():
        raise InputError("no such file", where=path, remedy=f"{why} (docs/formats.md)")


def read_noload(session: Session) -> list[Still]:
    """noload/noload.csv: the free antenna, a picture a row."""
    path = session.root / "noload" / "noload.csv"
    _require(path, "calibration needs the free antenna")
    rows = read_csv(path, ("image", "pan_rad", "tilt_rad", "moment_Nm"))
    stills = [Still(**_still(row, path, True)) for row in rows]
    _refuse_repeated_pictures(stills, rows, path)
    return stills


def read_loads(session: Session) -> list[Load]:
    """loads/loads.csv: known loads, each on the antenna, a picture a row."""
    path = session.root / "loads" / "loads.csv"
    _require(path, "calibration needs known loads, for the stiffness")
    names = ("distance_m", "force_y_N", "force_z_N")
    rows = read_csv(path, ("image", "pan_rad", "tilt_rad", "moment_Nm", *names))
    loads = [Load(**(_still(row, path, True) | {name: number(row, name, path) for name in names})) for row in rows]
    length_m = session.antenna.length_m
    for row, load in zip(rows, loads, strict=True):
        if not 0 < load.distance_m <= length_m:
            what = f"distance_m is {load.distance_m:g}, the antenna {length_m:g} m long"
            raise _wrong(row, path, what, "give metres from the clamp along the antenna")
        if load.force_y_N == load.force_z_N == 0:
            raise _wrong(row, path, "the force is zero", "free frames belong into noload/")
    _refuse_repeated_pictures(loads, rows, path)
    return loads


def read_recording(session: Session) -> list[Frame]:
    """recording/recording.csv. With recording/centrelines.csv instead of pictures it needs no image column."""
    path = session.root / "recording" / "recording.csv"
    _require(path, "it names the frames of the recording")
    with_images = not (path.parent / "centrelines.csv").exists()
    rows = read_csv(path, ("frame", "time_s", *(("image",) if with_images else ()), "pan_rad", "tilt_rad", "moment_Nm"))
    frames: list[Frame] = []
    seen: set[int] = set()
    for row in rows:
        index, time_s = whole_number(row, "frame", path), number(row, "time_s", path)
        if index in seen:
            raise _wrong(row, path, f"frame {index} stands twice", "every frame needs its own number")
        if frames and time_s < frames[-1].time_s:
            raise _wrong(row, path, "the time runs backwards", "sort the rows by time_s")
        seen.add(index)
        frames.append(Frame(**_still(row, path, with_images), frame=index, time_s=time_s))
    return frames


def read_centrelines(session: Session) -> dict[int, np.ndarray]:
    """recording/centrelines.csv: frame → (N, 3) of u_px, v_px, sigma_px (NaN where the column is missing)."""
    path = session.root / "recording" / "centrelines.csv"
    grouped: dict[int, list[tuple[float, float, float]]] = {}
    for row in read_csv(path, ("frame", "u_px", "v_px"), ("sigma_px",)):
        sigma = number(row, "sigma_px", path) if "sigma_px" in row else np.nan
        if sigma <= 0:
            raise _wrong(row, path, "sigma_px is not positive", "give a standard deviation in pixels")
        point = (number(row, "u_px", path), number(row, "v_px", path), sigma)
        grouped.setdefault(whole_number(row, "frame", path), []).append(point)
    return {frame: np.array(points) for frame, points in grouped.items()}


def check_pictures(pictures: Iterable[Path], image_size: tuple[int, int], whose: str) -> None:
    """Raises InputError for the first picture that cannot be read or has another size than (width, height) px.

    Decoding is quick: better all of it before the long work than an error in the middle of it.
    """
    from .images import read_gray

    for path in pictures:
        height, width = read_gray(path).shape
        if (width, height) != tuple(image_size):
            what = f"is {width}x{height} px, {whose} {image_size[0]}x{image_size[1]} px"
            raise InputError(what, where=path, remedy="use one camera at one resolution throughout")
