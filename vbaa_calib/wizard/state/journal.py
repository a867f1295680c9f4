"""What a wizard has been told and shown so far: answers, pictures taken, pictures left, step by step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json

from .catalogue import QUESTIONS, SOURCES, TABLES

SCHEMA = "vbaa.wizard/1"
STEPS = ("board", "lens", "plane", "noload", "loads", "sensor", "verdict")
PICTURES = {"lens": "for the lens", "plane": "for plane C", "noload": "of the free antenna", "loads": "of loads"}
"""Steps that take pictures, and of what those are."""
READINGS: Mapping[str, tuple[str, ...]] = {
    "sweep": ("pan_rad", "tilt_rad"),
    "noload": ("pan_rad", "tilt_rad", "moment_Nm"),
    "loads": ("pan_rad", "tilt_rad", "moment_Nm", "distance_m", "force_y_N", "force_z_N"),
}
"""Folder → what is read with each of its pictures."""
_REMEDY = "move wizard.json away: the wizard then begins with session.yaml and what it names, or anew; nothing is lost"
_FOLLOWING = {"measure_x_mm": "number", "measure_y_mm": "number"} | {
    f"{name}_given": "yesno" for name in ("board", "jig", "over", "gravity")
}
_KINDS = (
    {question.key: question.kind for question in (*QUESTIONS, *SOURCES)}
    | {question.key: "table" for question in TABLES}
    | _FOLLOWING
)
_CHOICES = {question.key: question.choices for question in QUESTIONS if question.choices}


@dataclass(frozen=True)
class Taken:
    """A picture that was accepted.

    Attributes
    ----------
    file : where it is, relative to the session. source : its name where it came from.
    readings : what was read with it, SI: joint angles, moment, load.
    """

    file: str
    source: str
    sha256: str
    readings: Mapping[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """For wizard.json."""
        return {"file": self.file, "source": self.source, "sha256": self.sha256, "readings": dict(self.readings)}


@dataclass(frozen=True)
class Left:
    """A picture that was not accepted, and why."""

    source: str
    sha256: str
    why: str

    def to_dict(self) -> dict[str, Any]:
        """For wizard.json."""
        return {"source": self.source, "sha256": self.sha256, "why": self.why}


@dataclass(frozen=True)
class Record:
    """One step. `closed` says how it ended: "enough", "by hand", "all pictures seen"; empty while it is open."""

    taken: tuple[Taken, ...] = ()
    left: tuple[Left, ...] = ()
    closed: str = ""

    @property
    def judged(self) -> frozenset[str]:
        """Names, where they came from, of all pictures that were taken or left."""
        return frozenset(one.source for one in self.taken) | frozenset(one.source for one in self.left)

    def to_dict(self) -> dict[str, Any]:
        """For wizard.json."""
        return {
            "taken": [one.to_dict() for one in self.taken],
            "left": [one.to_dict() for one in self.left],
            "closed": self.closed,
        }


@dataclass(frozen=True)
class Journal:
    """Everything. Changed only by making a new one."""

    answers: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    steps: Mapping[str, Record] = field(default_factory=lambda: MappingProxyType({}))
    redone: tuple[str, ...] = ()

    def of(self, step: str) -> Record:
        """The record of a step."""
        return self.steps.get(step, Record())

    def with_answers(self, answers: Mapping[str, Any]) -> Journal:
        """With these answers, older ones to the same questions replaced."""
        return replace(self, answers={**self.answers, **answers})

    def with_step(self, step: str, record: Record) -> Journal:
        """With this record in place of the step's."""
        return replace(self, steps={**self.steps, step: record})

    def to_dict(self) -> dict[str, Any]:
        """wizard.json."""
        return {
            "schema": SCHEMA,
            "answers": dict(self.answers),
            "steps": {name: record.to_dict() for name, record in self.steps.items()},
            "redone": list(self.redone),
        }

    @staticmethod
    def read(path: Path) -> Journal:
        """wizard.json. Raises InputError naming what is wrong with it."""
        try:
            data = read_json(path)
        except InputError as error:
            raise InputError(error.what, where=error.where, remedy=_REMEDY) from None
        return Journal.from_dict(data, path)

    @staticmethod
    def from_dict(data: Mapping[str, Any], path: Path) -> Journal:
        """From wizard.json. Raises InputError naming what is wrong with it."""
        if data.get("schema") != SCHEMA:
            raise InputError(f"schema is {data.get('schema')!r}, {SCHEMA} is needed", where=path, remedy=_REMEDY)
        try:
            steps = {name: _record(record) for name, record in data["steps"].items()}
            answers = {key: _answer(key, value) for key, value in data["answers"].items()}
            redone = tuple(str(name) for name in data.get("redone", ()))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"is damaged ({error!r})", where=path, remedy=_REMEDY) from None
        unknown = [name for name in steps if name not in STEPS]
        if unknown:
            raise InputError(f"names a step {unknown[0]!r}", where=path, remedy=_REMEDY)
        return Journal(answers, steps, redone)


def _record(data: Mapping[str, Any]) -> Record:
    taken = tuple(
        Taken(
            _inside(one["file"]),
            str(one["source"]),
            str(one["sha256"]),
            {key: _finite(value) for key, value in one["readings"].items()},
        )
        for one in data["taken"]
    )
    for one in taken:
        missing = [name for name in READINGS.get(Path(one.file).parent.name, ()) if name not in one.readings]
        if missing:
            raise ValueError(f"{one.file} has no {missing[0]}")
    left = tuple(Left(str(one["source"]), str(one["sha256"]), str(one["why"])) for one in data["left"])
    return Record(taken, left, str(data["closed"]))


def _answer(key: str, value: Any) -> Any:
    """An answer as the wizard keeps it; its range was checked when it was given."""
    kind = _KINDS.get(key)
    if kind is None:
        raise ValueError(f"{key!r} is no question")
    if isinstance(value, list) and kind in ("numbers", "table"):
        return [_finite(one) for one in value] if kind == "numbers" else value
    if kind == "number":
        return _finite(value)
    if not isinstance(value, bool if kind == "yesno" else str) or value not in _CHOICES.get(key, (value,)):
        raise ValueError(f"{key} is {value!r}")
    return value


def _finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no number")
    return float(value)


def _inside(file: str) -> str:
    if not isinstance(file, str) or Path(file).is_absolute() or ".." in Path(file).parts or "\0" in file:
        raise ValueError(f"{file!r} is no file of this session")
    return file
