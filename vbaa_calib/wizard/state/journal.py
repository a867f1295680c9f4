"""wizard.json: answers, pictures taken and refused, step by step."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, FiniteFloat, ValidationError, model_validator

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json

from .questions import QUESTIONS, READINGS, SOURCES, STEPS, TABLES, Question

SCHEMA = "vbaa.wizard/1"
_REMEDY = "move wizard.json away: the wizard then begins with session.yaml and what it names, or anew; nothing is lost"
_TABLES = {question.key for question in TABLES}
_FOLLOWING = (
    *(Question(f"measure_{axis}_mm", "", "") for axis in "xy"),
    *(Question(f"{name}_given", "", "", kind="yesno") for name in ("board", "jig", "over", "gravity")),
)
"""What is kept with the answers and follows from them or from a session that was there."""
_QUESTIONS = {question.key: question for question in (*QUESTIONS, *SOURCES, *TABLES, *_FOLLOWING)}


def _inside(file: str) -> str:
    if Path(file).is_absolute() or ".." in Path(file).parts or "\0" in file:
        raise ValueError(f"{file!r} is no file of this session")
    return file


def _step(name: str) -> str:
    if name not in STEPS:
        raise ValueError(f"names a step {name!r}")
    return name


def _answers(answers: dict[str, Any]) -> dict[str, Any]:
    """Answers as they were given, checked again."""
    for key in answers.keys() - _QUESTIONS.keys():
        raise ValueError(f"{key!r} is no question")
    try:
        return {
            key: value if key in _TABLES and isinstance(value, list) else _QUESTIONS[key].read(value)
            for key, value in answers.items()
        }
    except InputError as error:
        raise ValueError(str(error)) from None


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True)


class AcceptedPicture(_Model):
    """A picture that was taken: its file relative to the session, its name at the source, its readings in SI."""

    file: Annotated[str, AfterValidator(_inside)]
    source: str
    sha256: str
    readings: dict[str, FiniteFloat]

    @model_validator(mode="after")
    def _is_complete(self) -> AcceptedPicture:
        for name in READINGS.get(Path(self.file).parent.name, ()):
            if name not in self.readings:
                raise ValueError(f"{self.file} has no {name}")
        return self


class RefusedPicture(_Model):
    """A picture that was not taken, and why."""

    source: str
    sha256: str
    why: str


class StepRecord(_Model):
    """One step. `closed` says how it ended: "enough", "by hand", "all pictures seen"; empty while it is open."""

    taken: tuple[AcceptedPicture, ...] = ()
    left: tuple[RefusedPicture, ...] = ()
    closed: str = ""

    @property
    def judged(self) -> frozenset[str]:
        """Names, where they came from, of all pictures that were taken or refused."""
        return frozenset({one.source for one in self.taken} | {one.source for one in self.left})


class Journal(_Model):
    """All answers and pictures. Changed only by making a new one."""

    answers: Annotated[dict[str, Any], AfterValidator(_answers)]
    steps: dict[Annotated[str, AfterValidator(_step)], StepRecord]

    def of(self, step: str) -> StepRecord:
        """The record of a step."""
        return self.steps.get(step, StepRecord())

    def with_answers(self, answers: Mapping[str, Any]) -> Journal:
        """With exactly these answers."""
        return self.model_copy(update={"answers": dict(answers)})

    def with_step(self, step: str, **changes: Any) -> Journal:
        """With these entries of the step's record changed."""
        return self.model_copy(update={"steps": {**self.steps, step: self.of(step).model_copy(update=changes)}})

    def to_dict(self) -> dict[str, Any]:
        """wizard.json."""
        return {"schema": SCHEMA, **self.model_dump(mode="json")}

    @staticmethod
    def read(path: Path) -> Journal:
        """wizard.json. Raises InputError naming what is wrong with it."""
        try:
            data = read_json(path)
        except InputError as error:
            raise InputError(error.what, where=error.where, remedy=_REMEDY) from None
        if data.get("schema") != SCHEMA:
            raise InputError(f"schema is {data.get('schema')!r}, {SCHEMA} is needed", where=path, remedy=_REMEDY)
        try:
            # as JSON, in which lists are tuples also where types are strict
            return Journal.model_validate_json(json.dumps(data))
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            what = f"is damaged ({place + ': ' if place else ''}{first['msg'].removeprefix('Value error, ')})"
            raise InputError(what, where=path, remedy=_REMEDY) from None
