"""A session's CSV tables: their rows, read and checked."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from vbaa_calib.core.arrays import PLAUSIBLE, Rows, check_angle
from vbaa_calib.core.csv_rows import MOST_WHOLE, csv_rows, header_of, number, plain_columns, read_csv, whole_number
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import SUFFIXES, picture_size

from .moment_sensor import READINGS, SILENT
from .settings import Session


@dataclass(frozen=True, slots=True)
class Still:
    """One picture with the joints at rest, of the antenna or of a board. Sensor readings such as `moment_Nm` are NaN
    where nothing was read.

    `time_s` is when it was taken, from any start, for the sensor's drift; None if not recorded.
    """

    image: Path | None
    pan_rad: float
    tilt_rad: float
    moment_Nm: float
    time_s: float | None = field(default=None, kw_only=True)
    moment_z_Nm: float = field(default=np.nan, kw_only=True)
    moment_x_Nm: float = field(default=np.nan, kw_only=True)
    sensor_force_x_N: float = field(default=np.nan, kw_only=True)
    sensor_force_y_N: float = field(default=np.nan, kw_only=True)
    sensor_force_z_N: float = field(default=np.nan, kw_only=True)

    @property
    def readings(self) -> list[float]:
        """(6,) readings in the order of `READINGS`."""
        return [getattr(self, name) for name in READINGS.values()]


@dataclass(frozen=True, slots=True)
class Load(Still):
    """A known load at an arc length from the clamp: force components (y, z), antenna frame."""

    distance_m: float
    force_y_N: float
    force_z_N: float


@dataclass(frozen=True, slots=True)
class Frame(Still):
    """One frame of a recording.

    moment_errors_Nm, joint_errors_rad : standard deviations of the readings (besides the sensor's noise) and of pan and
        tilt, by interpolation and by the clocks' offset.
    joints_read : whether pan and tilt were read; else they are the values assumed for a rig without joint readings.
    others : pictures of the same instant by further cameras, by name.
    """

    frame: int
    time_s: float = field(kw_only=True)
    moment_errors_Nm: tuple[float, ...] = field(default=(0.0,) * len(READINGS), kw_only=True)
    joint_errors_rad: tuple[float, float] = field(default=(0.0, 0.0), kw_only=True)
    joints_read: tuple[bool, bool] = field(default=(True, True), kw_only=True)
    others: Mapping[str, Path] = field(default_factory=dict, kw_only=True)


@dataclass(frozen=True, eq=False)
class _FrameColumns(Rows, Sequence[Frame]):
    """Frames of a recording without pictures, as columns (F,), which take little memory and are quick to transfer."""

    frame: np.ndarray
    time_s: np.ndarray
    pan_rad: np.ndarray
    tilt_rad: np.ndarray
    moment_Nm: np.ndarray
    moment_z_Nm: np.ndarray
    moment_x_Nm: np.ndarray
    sensor_force_x_N: np.ndarray
    sensor_force_y_N: np.ndarray
    sensor_force_z_N: np.ndarray

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return self.picked(index)
        return Frame(None, **{name: each[index].item() for name, each in vars(self).items()})

    def __iter__(self) -> Iterator[Frame]:
        names = list(vars(self))
        for values in zip(*(each.tolist() for each in vars(self).values()), strict=True):
            yield Frame(None, **dict(zip(names, values, strict=True)))


def numbers_of(frames: Sequence[Frame], column: str = "frame") -> np.ndarray:
    """(F,) values of a numeric column of the frames, by default their numbers."""
    if isinstance(frames, _FrameColumns):
        return np.asarray(getattr(frames, column))
    return np.array([getattr(each, column) for each in frames], np.int64 if column == "frame" else float)


def pictures_of(frames: Sequence[Frame]) -> list[Path]:
    """The pictures of the frames that have one."""
    if isinstance(frames, _FrameColumns):
        return []
    return [each.image for each in frames if each.image is not None] or [
        one for each in frames for one in each.others.values()
    ]


def without_moments(frames: Sequence[Frame]) -> Sequence[Frame]:
    """The frames without their moment readings, for estimates from pictures alone."""
    if isinstance(frames, _FrameColumns):
        nothing = np.full(len(frames), np.nan)
        return replace(frames, **dict.fromkeys(SILENT, nothing))
    return [replace(frame, **SILENT) for frame in frames]


def wrong(row: Mapping[str, str], path: Path, what: str, remedy: str) -> InputError:
    """An InputError that names the row's file and line."""
    return InputError(what, where=f"{path} line {row['line']}", remedy=remedy)


FOLDERS = ("intrinsics", "plane", "sweep", "over", "noload", "loads", "recording")
FILES = ("session.yaml", "board.yaml", "truth.json", "wizard.json")
TABLES = ("recording.csv", "centrelines.csv", "sweep.csv", "noload.csv", "loads.csv")


def refuse_measured(output: Path, root: Path) -> None:
    """Raises InputError where `output` is a file of measurements of the session in `root`, which even --force may
    not overwrite."""
    if not os.path.lexists(output):
        return
    place, inside = Path(os.path.realpath(output)), Path(os.path.realpath(root))
    if not place.is_relative_to(inside):
        return
    *folders, name = place.relative_to(inside).parts or ("",)
    taken = Path(name).suffix.lower() in SUFFIXES or name in TABLES
    if (not folders and name in FILES) or (folders and folders[0] in FOLDERS and taken):
        raise InputError("is an input of this command", where=output, remedy="take another name")


def check_pictures(
    pictures: Iterable[Path],
    image_size: tuple[int, int],
    reference: str,
    remedy: str = "use one camera at one resolution throughout",
) -> None:
    """Raises InputError for the first picture that is incomplete or has another size than (width, height) px.

    Quick, so that bad pictures are reported before the long work and not in the middle of it.
    """
    for path in pictures:
        width, height = picture_size(path)
        if (width, height) != tuple(image_size):
            what = f"is {width}x{height} px, {reference} {image_size[0]}x{image_size[1]} px"
            raise InputError(what, where=path, remedy=remedy)


_Row = TypeVar("_Row", Still, Load)
ANGLES = ("pan_rad", "tilt_rad")
IN_DEGREES = {"pan_rad": "pan_deg", "tilt_rad": "tilt_deg"}
"""Columns in degrees that may stand in their place."""


def read_sweep(session: Session) -> list[Still]:
    """The pictures in sweep/sweep.csv: a board fixed in the world, seen while the joints move."""
    why = "it gives the joint angles of every picture of the sweep"
    return [picture for _, picture in _pictures(session, "sweep", why, Still)]


def read_noload(session: Session) -> list[Still]:
    """The static frames in noload/noload.csv: the free antenna."""
    why = "calibration needs the free antenna"
    return [frame for _, frame in _pictures(session, "noload", why, Still)]


def read_loads(session: Session) -> list[Load]:
    """The static frames in loads/loads.csv: the antenna under known loads."""
    why, loads = "calibration needs known loads, for the stiffness", []
    values, path = ("distance_m", "force_y_N", "force_z_N"), session.root / "loads" / "loads.csv"
    for row, load in _pictures(session, "loads", why, Load, *values):
        if not 0 < load.distance_m <= session.antenna.length_m:
            what = f"distance_m is {load.distance_m:g}, the antenna {session.antenna.length_m:g} m long"
            raise wrong(row, path, what, "give metres from the clamp along the antenna")
        if load.force_y_N == load.force_z_N == 0:
            raise wrong(row, path, "the force is zero", "free frames belong into noload/")
        loads.append(load)
    return loads


def _pictures(
    session: Session, name: str, why: str, kind: type[_Row], *values: str
) -> Iterator[tuple[Mapping[str, str], _Row]]:
    """The rows of a table: picture (all different), joint angles, moment, and the columns `values`."""
    path, lines = session.root / name / f"{name}.csv", dict[Path, str]()
    _require(path, why)
    of_antenna = name != "sweep"
    values = (*session.columns, *values) if of_antenna else values
    if of_antenna and not session.sensor_stated and "moment_Nm" in header_of(path):
        what = "column moment_Nm is there, but session.yaml says nothing of a moment sensor"
        remedy = "give moment_sensor: {std_Nm: …} in session.yaml, or moment_sensor: null to leave the readings aside"
        raise InputError(what, where=path, remedy=remedy)
    image = session.image_column
    columns, optional = (image, *ANGLES, *values), ("time_s",) if of_antenna else ()
    for row in read_csv(path, columns, optional, IN_DEGREES):
        if session.cameras and not row[image]:  # taken by others of its cameras
            continue
        view = _view(row, path, image)
        if view["image"] in lines:
            what = f"the picture {row[image]} stands in line {lines[view['image']]}, too"
            raise wrong(row, path, what, "every row needs its own picture")
        lines[view["image"]] = row["line"]
        entries = view | {"moment_Nm": np.nan} | {value: number(row, value, path) for value in values}
        yield row, kind(**entries)


def read_recording(session: Session) -> Sequence[Frame]:
    """The frames in recording/recording.csv. With recording/centrelines.csv instead of pictures it needs no image
    column.

    Moments may be missing, cell by cell or as a column.
    """
    path = session.root / "recording" / "recording.csv"
    _require(path, "it names the frames of the recording")
    with_images = not (path.parent / "centrelines.csv").exists()
    return recording_of(path, with_images=with_images, cameras=session.in_turn or ("",))


def recording_of(path: Path, *, with_images: bool, cameras: Sequence[str] = ("",)) -> Sequence[Frame]:
    """The frames in any file of the form of recording.csv. Raises InputError with file, line and remedy."""
    pictures = {name: f"image_{name}" if name else "image" for name in cameras if with_images}
    columns = ("frame", "time_s", *pictures.values(), *ANGLES)
    plain = None if with_images else plain_columns(path, columns, tuple(SILENT))
    if plain is not None and "moment_Nm" in plain and _is_sound(plain):
        unread = dict.fromkeys(SILENT, np.full(len(plain["frame"]), np.nan))
        return _FrameColumns(**unread | plain | {"frame": plain["frame"].astype(np.int64)})
    rows = csv_rows(path, columns, tuple(SILENT), IN_DEGREES)
    first = next(rows)
    _refuse_misspelt(path, "moment_Nm", (*columns, *SILENT))
    frames: list[Frame] = []
    seen: set[int] = set()
    for row in chain([first], rows):
        moments: dict[str, Any] = {name: number(row, name, path) if row.get(name) else np.nan for name in SILENT}
        frame = Frame(**_views(row, path, pictures), **moments, frame=whole_number(row, "frame", path))
        if frame.frame in seen:
            raise wrong(row, path, f"frame {frame.frame} stands twice", "every frame needs its own number")
        if frames and frame.time_s < frames[-1].time_s:
            raise wrong(row, path, "the time runs backwards", "sort the rows by time_s")
        seen.add(frame.frame)
        frames.append(frame)
    return frames


def _is_sound(columns: Mapping[str, np.ndarray]) -> bool:
    """Whether frames as columns fulfil what `recording_of` requires."""
    frame, time_s = columns["frame"], columns["time_s"]
    whole = (frame >= 0) & (frame < MOST_WHOLE) & (frame == np.floor(frame))
    angles = np.abs([columns[name] for name in ANGLES]) <= PLAUSIBLE.angle_rad
    once, forward = np.diff(np.sort(frame)) > 0, np.diff(time_s) >= 0
    return bool(whole.all() and angles.all() and forward.all() and once.all())


def _views(row: Mapping[str, str], path: Path, pictures: Mapping[str, str]) -> dict[str, Any]:
    """A row's pictures by several cameras, in columns by name, of which some may be empty, with joint angles and
    time. Raises InputError."""
    taken = [name for name, column in pictures.items() if row[column]]
    first = next(iter(pictures), None)
    if len(pictures) < 2 or not taken:
        return _view(row, path, None if first is None else pictures[first])
    views = {name: _view(row, path, pictures[name]) for name in taken}
    others = {name: view["image"] for name, view in views.items() if name != first}
    return views[taken[0]] | {"image": views[first]["image"] if first in views else None, "others": others}


def _view(row: Mapping[str, str], path: Path, column: str | None = "image") -> dict[str, Any]:
    """A row's picture (relative to the table), joint angles and time. Raises InputError for impossible values."""
    seen: dict[str, Any] = {"image": path.parent / row[column] if column else None}
    if column and not row[column]:
        raise wrong(row, path, f"{column} is empty", "name the picture")
    if column and not os.path.isfile(seen["image"]):  # Path.is_file raises for a name that is too long
        raise wrong(row, path, f"the picture {row[column]} is not there", f"put it at {seen['image']}")
    for name in ANGLES:
        named = name if name in row else IN_DEGREES[name]
        angle = number(row, named, path)
        if named != name:
            angle = math.radians(angle)
        seen[name] = check_angle(angle, name, lambda what, remedy: wrong(row, path, what, remedy))
    return seen | ({"time_s": number(row, "time_s", path)} if "time_s" in row else {})


def _refuse_misspelt(path: Path, wanted: str, known: Sequence[str]) -> None:
    """Raises InputError for a misspelt optional column `wanted`: its readings would otherwise be ignored silently."""
    header = header_of(path)
    strange = {name.lower(): name for name in header if name not in known}
    close = difflib.get_close_matches(wanted.lower(), strange, n=1, cutoff=0.75)
    if close and wanted not in header:
        what = f"column {wanted} is missing, but there is {strange[close[0]]}"
        raise InputError(what, where=path, remedy=f"name it {wanted}, in SI units, or give it another name")


def _require(path: Path, why: str) -> None:
    if not os.path.lexists(path):  # whoever reads a dangling link reports it
        raise InputError("no such file", where=path, remedy=f"{why} (docs/formats.md)")
