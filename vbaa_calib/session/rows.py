"""What one row of a session's tables holds, and the checks that all tables share."""

from __future__ import annotations

import csv
import difflib
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.core.csv_rows import number
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_text


@dataclass(frozen=True)
class SweepPicture:
    """One picture of a board fixed in the world, with the joints at rest at these readings."""

    image: Path
    pan_rad: float
    tilt_rad: float


@dataclass(frozen=True, slots=True)
class Still:
    """One picture of the antenna with the joints at rest. `moment_Nm` is the sensor's reading.

    `time_s` is when it was taken, from any start, for the sensor's drift; None where nobody wrote it down.
    """

    image: Path | None
    pan_rad: float
    tilt_rad: float
    moment_Nm: float
    time_s: float | None = field(default=None, kw_only=True)


@dataclass(frozen=True, slots=True)
class Load(Still):
    """A known load: force components (y, z), antenna frame, hung at an arc length from the clamp."""

    distance_m: float
    force_y_N: float
    force_z_N: float


@dataclass(frozen=True, slots=True)
class Frame(Still):
    """One frame of a recording. `moment_Nm`, and `moment_z_Nm` of a second axis, are NaN where nothing was read."""

    frame: int
    time_s: float = field(kw_only=True)
    moment_z_Nm: float = field(default=np.nan, kw_only=True)


def wrong(row: Mapping[str, str], path: Path, what: str, remedy: str) -> InputError:
    """An error that names file and line of a row."""
    return InputError(what, where=f"{path} line {row['line']}", remedy=remedy)


def joints(row: Mapping[str, str], path: Path) -> dict[str, float]:
    """`pan_rad` and `tilt_rad`. Raises InputError for what can only be degrees."""
    angles = {name: number(row, name, path) for name in ("pan_rad", "tilt_rad")}
    for name, value in angles.items():
        if abs(value) > 2 * np.pi:
            raise wrong(row, path, f"{name} is {value:g}, more than a turn", "give radians")
    return angles


def still(row: Mapping[str, str], path: Path) -> dict[str, Any]:
    """What every still of the antenna has, with its moment; `time_s` where the table has that column."""
    return view(row, path) | {"moment_Nm": number(row, "moment_Nm", path)}


def view(row: Mapping[str, str], path: Path, with_image: bool = True) -> dict[str, Any]:
    """Picture and joints; `time_s` where the table has that column."""
    seen = {"image": picture(row, path) if with_image else None, **joints(row, path)}
    return seen | ({"time_s": number(row, "time_s", path)} if "time_s" in row else {})


def reading(row: Mapping[str, str], column: str, path: Path) -> float:
    """A sensor's reading; NaN where the cell is empty or the table has no such column: nothing was read."""
    return number(row, column, path) if row.get(column) else np.nan


def picture(row: Mapping[str, str], path: Path) -> Path:
    """The picture that a row names, relative to its table. Raises InputError when it is not there."""
    if not row["image"]:
        raise wrong(row, path, "image is empty", "name the picture")
    image = path.parent / row["image"]
    if not os.path.isfile(image):  # Path.is_file raises for a name that is too long
        raise wrong(row, path, f"the picture {row['image']} is not there", f"put it at {image}")
    return image


def refuse_repeated_pictures(pictures: Sequence[Path | None], rows: Sequence[Mapping[str, str]], path: Path) -> None:
    """Raises InputError for a picture that stands in two rows."""
    lines: dict[Path | None, str] = {}
    for image, row in zip(pictures, rows, strict=True):
        if image in lines:
            what = f"the picture {row['image']} stands in line {lines[image]}, too"
            raise wrong(row, path, what, "every row needs its own picture")
        lines[image] = row["line"]


def refuse_misspelt(path: Path, wanted: str, known: Sequence[str]) -> None:
    """Raises InputError for a table without the optional column `wanted`, but with one that can only be meant for it.

    Left out in silence, such a slip would cost all its readings.
    """
    lines = ([cell.strip() for cell in cells] for cells in csv.reader(io.StringIO(read_text(path))))
    header = next(cells for cells in lines if any(cells))
    strange = {name.lower(): name for name in header if name not in known}
    close = difflib.get_close_matches(wanted.lower(), strange, n=1, cutoff=0.75)
    if close and wanted not in header:
        what = f"column {wanted} is missing, but there is {strange[close[0]]}"
        raise InputError(what, where=path, remedy=f"name it {wanted}, in SI units, or give it another name")


def require(path: Path, why: str) -> None:
    """Raises InputError when a table is not there."""
    if not os.path.lexists(path):  # a link that leads nowhere is told by who reads it
        raise InputError("no such file", where=path, remedy=f"{why} (docs/formats.md)")
