"""What is read with a picture: joint angles, moment, load. Typed in the units at hand, kept in SI."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.core.csv_rows import read_csv
from vbaa_calib.core.errors import InputError

from .questions import Question

_DEGREES = np.pi / 180.0
UNITS: Mapping[str, Mapping[str, float]] = {
    "pan": {"pan_rad": 1.0, "pan_deg": _DEGREES},
    "tilt": {"tilt_rad": 1.0, "tilt_deg": _DEGREES},
    "moment": {"moment_Nm": 1.0, "moment_mNm": 1e-3},
    "time": {"time_s": 1.0},
    "distance": {"distance_m": 1.0, "distance_mm": 1e-3},
    "mass": {"mass_kg": 1.0, "mass_g": 1e-3},
    "force_y": {"force_y_N": 1.0, "force_y_mN": 1e-3},
    "force_z": {"force_z_N": 1.0, "force_z_mN": 1e-3},
}
"""Quantity → names under which it may be given, and their size in SI. The first one is what is kept."""
COLUMNS = tuple(name for names in UNITS.values() for name in names)
_STEADY_PART = 0.02
"""Part of a weight's pull that may go along the antenna: a load of a session has no such component."""

_JOINTS = (
    Question("pan_deg", "", "Pan angle", unit="degrees", default=0.0, low=-360.0, high=360.0),
    Question("tilt_deg", "", "Tilt angle", unit="degrees", default=0.0, low=-360.0, high=360.0),
)
_MOMENT = Question("moment_mNm", "", "Moment sensor's reading", unit="mN·m", low=-1e5, high=1e5)
_LOAD = (
    Question("mass_g", "", "Mass on the antenna", unit="g", low=1e-6, high=1e6),
    Question("distance_mm", "", "Where it hangs, from the clamp along the antenna", unit="mm", low=0.01, high=10_000.0),
)
_ASKED = {"sweep": _JOINTS, "noload": (*_JOINTS, _MOMENT), "loads": (*_LOAD, *_JOINTS, _MOMENT)}


def asked(folder: str, last: Mapping[str, float] | None = None) -> list[Question]:
    """What has to be read with each picture of a folder. last : readings, of which joint angles are the defaults."""
    questions = _ASKED.get(folder, ())
    if last is None:
        return list(questions)
    angles = {f"{name}_deg": round(last[f"{name}_rad"] / _DEGREES, 9) for name in ("pan", "tilt") if questions}
    return [replace(one, default=angles.get(one.key, one.default)) for one in questions]


@dataclass(frozen=True)
class ReadingsTable:
    """Readings of a file: rows by the names of pictures, and rows without, for pictures as they are taken."""

    by_image: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    in_order: Sequence[Mapping[str, Any]] = ()
    where: object = None

    def of(self, name: str, taken: int) -> Mapping[str, Any] | None:
        """The row of a picture, the `taken`-th that was accepted from 0 on; None where there is none."""
        if name in self.by_image:
            return self.by_image[name]
        return self.in_order[taken] if taken < len(self.in_order) else None


def read_table(path: Path) -> ReadingsTable:
    """A CSV with a column `image` and any of `COLUMNS`. Raises InputError."""
    rows: dict[str, Mapping[str, Any]] = {}
    for row in read_csv(path, ("image",), COLUMNS):
        where, name = f"{path} line {row['line']}", Path(row["image"]).name
        if not name:
            raise InputError("image is empty", where=where, remedy="name the picture")
        cells = {key: cell for key, cell in row.items() if key in COLUMNS and cell}
        _add(rows, name, cells, where)
    return ReadingsTable(rows, (), path)


def table_of(rows: Sequence[Any], where: object) -> ReadingsTable:
    """Rows of an answers file: mappings of `COLUMNS`, with or without `image`. Raises InputError."""
    by_image: dict[str, Mapping[str, Any]] = {}
    in_order: list[Mapping[str, Any]] = []
    for number, row in enumerate(rows, 1):
        place = f"{where} row {number}"
        if not isinstance(row, Mapping):
            raise InputError("is not a mapping", where=place, remedy="give pan_rad: ..., moment_Nm: ... and so on")
        unknown = [key for key in row if key not in ("image", *COLUMNS)]
        if unknown:
            remedy = f"the keys are image, {', '.join(COLUMNS)}"
            raise InputError(f"unknown key {unknown[0]!r}", where=place, remedy=remedy)
        cells = {key: value for key, value in row.items() if key != "image"}
        if "image" not in row:
            in_si(cells, place)
            in_order.append(cells)
            continue
        if not isinstance(row["image"], str) or not (name := Path(row["image"]).name):
            remedy = "name the picture, or leave it out"
            raise InputError("image is no name of a picture", where=place, remedy=remedy)
        _add(by_image, name, cells, place)
    return ReadingsTable(by_image, tuple(in_order), where)


def _add(rows: dict[str, Mapping[str, Any]], name: str, cells: Mapping[str, Any], where: str) -> None:
    if name in rows:
        raise InputError(f"{name} stands twice", where=where, remedy="a row per picture")
    in_si(cells, where)
    rows[name] = cells


def in_si(typed: Mapping[str, Any], where: object) -> dict[str, float]:
    """Readings in SI by their first names. Raises InputError for what is no number or is given twice."""
    found: dict[str, float] = {}
    for names in UNITS.values():
        given = [name for name in names if name in typed]
        if len(given) > 1:
            raise InputError(f"gives {given[0]} and {given[1]}", where=where, remedy="give one of them")
        for name in given:
            found[next(iter(names))] = Question(name, "", name).read(typed[name], where) * names[name]
    for name in ("distance_m", "mass_kg"):
        if not found.get(name, 1.0) > 0:
            raise InputError(f"{name} is {found[name]:g}", where=where, remedy="it is more than zero: measure it again")
    return found


def complete(
    folder: str, typed: Mapping[str, Any], gravity_antenna_m_s2: np.ndarray, length_m: float, where: object
) -> dict[str, float]:
    """Readings of a picture as the tables of a session want them.

    gravity_antenna_m_s2 : (3,) at these joint angles: a mass pulls along it. length_m : of the antenna, where no load
    hangs beyond. Raises InputError naming what is missing.
    """
    readings = in_si(typed, where)
    for question in _ASKED.get(folder, ()):
        names = next(tuple(each) for each in UNITS.values() if question.key in each)
        if names[0] not in readings and names[0] != "mass_kg":
            raise InputError(f"{names[0]} is missing", where=where, remedy=f"give {' or '.join(names)}")
    for name in ("pan_rad", "tilt_rad"):
        if abs(readings.get(name, 0.0)) > 2 * np.pi:
            what = f"{name} is {readings[name]:g}, more than a turn"
            raise InputError(what, where=where, remedy="are these degrees?")
    if folder != "loads":
        return readings
    if readings["distance_m"] > length_m:
        what = f"distance_m is {readings['distance_m']:g}, the antenna {length_m:g} m long"
        raise InputError(what, where=where, remedy="measure from the clamp along the antenna; is the unit right?")
    force = _force(readings, gravity_antenna_m_s2, where)
    if not force.any():
        raise InputError("the force is zero", where=where, remedy="free frames belong to the step before")
    return readings | {"force_y_N": float(force[0]), "force_z_N": float(force[1])}


def _force(readings: Mapping[str, float], gravity: np.ndarray, where: object) -> np.ndarray:
    by_force = "force_y_N" in readings or "force_z_N" in readings
    if by_force == ("mass_kg" in readings):
        what = "gives both mass and force" if by_force else "gives neither a mass nor a force"
        raise InputError(what, where=where, remedy="give mass_g, or force_y_N and force_z_N")
    if by_force:
        return np.array([readings.get("force_y_N", 0.0), readings.get("force_z_N", 0.0)])
    if not gravity.any():
        raise InputError("a mass pulls nowhere without gravity", where=where, remedy="give force_y_N and force_z_N")
    along = abs(gravity[0]) / np.linalg.norm(gravity)
    if along > _STEADY_PART:
        what = f"at these joint angles {100 * along:.0f} % of the weight pull along the antenna"
        raise InputError(what, where=where, remedy="turn the antenna level before hanging a weight on it")
    return readings["mass_kg"] * gravity[1:]
