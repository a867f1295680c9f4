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

DEGREES = np.pi / 180.0
UNITS: Mapping[str, Mapping[str, float]] = {
    "pan": {"pan_rad": 1.0, "pan_deg": DEGREES},
    "tilt": {"tilt_rad": 1.0, "tilt_deg": DEGREES},
    "moment": {"moment_Nm": 1.0, "moment_mNm": 1e-3},
    "time": {"time_s": 1.0},
    "distance": {"distance_m": 1.0, "distance_mm": 1e-3},
    "mass": {"mass_kg": 1.0, "mass_g": 1e-3},
    "force_y": {"force_y_N": 1.0, "force_y_mN": 1e-3},
    "force_z": {"force_z_N": 1.0, "force_z_mN": 1e-3},
}
"""Quantity → names under which it may be given, and what makes SI of it. The first one is what is kept."""
COLUMNS = tuple(name for names in UNITS.values() for name in names)
STEADY_PART = 0.02
"""Part of a weight's pull that may go along the antenna: a load of a session has no such component."""

JOINTS = (
    Question("pan_deg", "", "Pan angle", unit="degrees", default=0.0, low=-360.0, high=360.0),
    Question("tilt_deg", "", "Tilt angle", unit="degrees", default=0.0, low=-360.0, high=360.0),
)
MOMENT = Question("moment_mNm", "", "Moment sensor's reading", unit="mN·m", low=-1e5, high=1e5)
LOAD = (
    Question("mass_g", "", "Mass on the antenna", unit="g", low=1e-6, high=1e6),
    Question("distance_mm", "", "Where it hangs, from the clamp along the antenna", unit="mm", low=0.01, high=10_000.0),
)


def asked(folder: str) -> tuple[Question, ...]:
    """What has to be read with each picture of a folder."""
    return {
        "sweep": JOINTS,
        "noload": (*JOINTS, MOMENT),
        "loads": (*LOAD, *JOINTS, MOMENT),
    }.get(folder, ())


def with_last(question: Question, last: Mapping[str, float]) -> Question:
    """The question with what was read last as its default, where it is of a joint: they often stay where they were."""
    if question not in JOINTS:
        return question
    names = UNITS[question.key.partition("_")[0]]
    return replace(question, default=round(last[next(iter(names))] / names[question.key], 9))


@dataclass(frozen=True)
class Given:
    """Readings that were written down beforehand.

    Attributes
    ----------
    by_image : picture's name → its row. in_order : rows without names, for pictures as they are taken.
    where : the file they stand in.
    """

    by_image: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    in_order: Sequence[Mapping[str, Any]] = ()
    where: object = None

    def of(self, name: str, taken: int) -> Mapping[str, Any] | None:
        """The row of a picture, the `taken`-th that was accepted from 0 on; None where there is none."""
        if name in self.by_image:
            return self.by_image[name]
        return self.in_order[taken] if taken < len(self.in_order) else None


def from_table(path: Path) -> Given:
    """A CSV with a column `image` and any of `COLUMNS`. Raises InputError."""
    rows: dict[str, Mapping[str, Any]] = {}
    for row in read_csv(path, ("image",), COLUMNS):
        name = Path(row["image"]).name
        if not name:
            raise InputError("image is empty", where=f"{path} line {row['line']}", remedy="name the picture")
        if name in rows:
            raise InputError(f"{name} stands twice", where=f"{path} line {row['line']}", remedy="a row per picture")
        rows[name] = {key: cell for key, cell in row.items() if key in COLUMNS and cell}
        in_si(rows[name], f"{path} line {row['line']}")
    return Given(rows, (), path)


def from_list(rows: Sequence[Any], where: object) -> Given:
    """Rows of an answers file: mappings of `COLUMNS`, with or without `image`. Raises InputError."""
    by_image: dict[str, Mapping[str, Any]] = {}
    in_order: list[Mapping[str, Any]] = []
    for number, row in enumerate(rows, 1):
        place = f"{where} row {number}"
        if not isinstance(row, Mapping):
            raise InputError("is not a mapping", where=place, remedy="give pan_rad: ..., moment_Nm: ... and so on")
        for key in row:
            if key != "image" and key not in COLUMNS:
                raise InputError(
                    f"unknown key {key!r}", where=place, remedy=f"the keys are image, {', '.join(COLUMNS)}"
                )
        numbers = {key: value for key, value in row.items() if key != "image"}
        in_si(numbers, place)
        if "image" in row:
            if not isinstance(row["image"], str) or not (name := Path(row["image"]).name):
                raise InputError(
                    "image is no name of a picture", where=place, remedy="name the picture, or leave it out"
                )
            if name in by_image:
                raise InputError(f"{name} stands twice", where=place, remedy="a row per picture")
            by_image[name] = numbers
        else:
            in_order.append(numbers)
    return Given(by_image, tuple(in_order), where)


def in_si(typed: Mapping[str, Any], where: object) -> dict[str, float]:
    """Readings in SI by their first names. Raises InputError for what is no number or is given twice."""
    found: dict[str, float] = {}
    for names in UNITS.values():
        given = [name for name in names if name in typed]
        if len(given) > 1:
            raise InputError(f"gives {given[0]} and {given[1]}", where=where, remedy="give one of them")
        for name in given:
            value = Question(name, "", name).read(typed[name], where)
            found[next(iter(names))] = value * names[name]
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
    known = in_si(typed, where)
    needed = {
        "sweep": ("pan", "tilt"),
        "noload": ("pan", "tilt", "moment"),
        "loads": ("pan", "tilt", "moment", "distance"),
    }
    for quantity in needed.get(folder, ()):
        names = tuple(UNITS[quantity])
        if names[0] not in known:
            raise InputError(f"{names[0]} is missing", where=where, remedy=f"give {' or '.join(names)}")
    for name in ("pan_rad", "tilt_rad"):
        if abs(known.get(name, 0.0)) > 2 * np.pi:
            raise InputError(f"{name} is {known[name]:g}, more than a turn", where=where, remedy="are these degrees?")
    if folder != "loads":
        return known
    if known["distance_m"] > length_m:
        what = f"distance_m is {known['distance_m']:g}, the antenna {length_m:g} m long"
        raise InputError(what, where=where, remedy="measure from the clamp along the antenna; is the unit right?")
    return known | _force(known, gravity_antenna_m_s2, where)


def _force(known: Mapping[str, float], gravity: np.ndarray, where: object) -> dict[str, float]:
    by_force = "force_y_N" in known or "force_z_N" in known
    if by_force == ("mass_kg" in known):
        what = "gives both mass and force" if by_force else "gives neither a mass nor a force"
        raise InputError(what, where=where, remedy="give mass_g, or force_y_N and force_z_N")
    if by_force:
        force = np.array([known.get("force_y_N", 0.0), known.get("force_z_N", 0.0)])
    else:
        if not gravity.any():
            raise InputError("a mass pulls nowhere without gravity", where=where, remedy="give force_y_N and force_z_N")
        if abs(gravity[0]) > STEADY_PART * np.linalg.norm(gravity):
            part = 100 * abs(gravity[0]) / np.linalg.norm(gravity)
            raise InputError(
                f"at these joint angles {part:.0f} % of the weight pull along the antenna",
                where=where,
                remedy="turn the antenna level before hanging a weight on it",
            )
        force = known["mass_kg"] * gravity[1:]
    if not force.any():
        raise InputError("the force is zero", where=where, remedy="free frames belong to the step before")
    return {"force_y_N": float(force[0]), "force_z_N": float(force[1])}
