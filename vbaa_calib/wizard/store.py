"""The wizard's state on disk: pictures in the session folder; answers and the list of pictures in wizard.json.

Each picture is written (write, fsync, rename) before the wizard.json that lists it. A picture that an interruption left
unlisted is moved away at the next start. session.yaml and the tables are derived from wizard.json.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import shutil
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from filelock import FileLock, Timeout
from pydantic import AfterValidator, BaseModel, FiniteFloat, ValidationError, model_validator

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_json, replacing, sha256, write_json
from vbaa_calib.core.folders import make_folder
from vbaa_calib.core.images import SUFFIXES
from vbaa_calib.session import SILENT
from vbaa_calib.sources import Picture

from .questions import OF_MATERIAL, PICTURES, QUESTIONS, READINGS, SOURCES, STEPS, TABLES, Question

NAME = "wizard.json"
ARCHIVE = "aside"
LOCK = ".wizard-lock"
_SCHEMA = "vbaa.wizard/1"
_REMEDY = "move wizard.json away: the wizard then begins with session.yaml and what it names, or anew; nothing is lost"
FOLDERS = {"lens": "intrinsics", "noload": "noload", "loads": "loads"}
"""Step → folder of its pictures; plane C's depends on the chosen way."""
WAYS = {"jig": "plane", "sweep": "sweep", "over": "over"}
# kept with the answers: what follows from them, or from a session that existed before
_QUESTIONS = {
    question.key: question
    for question in (
        *QUESTIONS,
        *SOURCES,
        *TABLES,
        *(Question(f"measure_{axis}_mm", "", "") for axis in "xy"),
        *(Question(f"{name}_given", "", "", kind="yesno") for name in ("board", "jig", "over", "gravity")),
    )
}


def _inside(file: str) -> str:
    if Path(file).is_absolute() or ".." in Path(file).parts or "\0" in file:
        raise ValueError(f"{file!r} is no file of this session")
    return file


def _step(name: str) -> str:
    if name not in STEPS:
        raise ValueError(f"names a step {name!r}")
    return name


def _answers(answers: dict[str, Any]) -> dict[str, Any]:
    for key in answers.keys() - _QUESTIONS.keys():
        raise ValueError(f"{key!r} is no question")
    try:
        return {
            key: value
            if key in {question.key for question in TABLES} and isinstance(value, list)
            else _QUESTIONS[key].read(value)
            for key, value in answers.items()
        }
    except InputError as error:
        raise ValueError(str(error)) from None


class AcceptedPicture(BaseModel, frozen=True, strict=True):
    """An accepted picture: its file relative to the session, its name at the source, its readings in SI units."""

    file: Annotated[str, AfterValidator(_inside)]
    source: str
    sha256: str
    readings: dict[str, FiniteFloat]

    @model_validator(mode="after")
    def _is_complete(self) -> AcceptedPicture:
        for name in READINGS.get(Path(self.file).parent.name, ()):
            if name not in self.readings and name not in SILENT:
                raise ValueError(f"{self.file} has no {name}")
        return self


class _RefusedPicture(BaseModel, frozen=True, strict=True):
    source: str
    sha256: str
    why: str


class _StepRecord(BaseModel, frozen=True, strict=True):
    """Record of one step. closed : how it ended ("enough", "by hand", "all pictures seen"), "" while it is open.

    past : pictures that were at the source before the step waited for its own, which do not count; None until then.
    """

    taken: tuple[AcceptedPicture, ...] = ()
    left: tuple[_RefusedPicture, ...] = ()
    closed: str = ""
    past: tuple[str, ...] | None = None

    @property
    def judged(self) -> frozenset[str]:
        """Names at the source of all accepted and refused pictures."""
        return frozenset({one.source for one in self.taken} | {one.source for one in self.left})


class _Journal(BaseModel, frozen=True, strict=True):
    """Content of wizard.json: all answers and pictures. Immutable."""

    answers: Annotated[dict[str, Any], AfterValidator(_answers)]
    steps: dict[Annotated[str, AfterValidator(_step)], _StepRecord]

    def of(self, step: str) -> _StepRecord:
        return self.steps.get(step, _StepRecord())

    def with_answers(self, answers: Mapping[str, Any]) -> _Journal:
        return self.model_copy(update={"answers": dict(answers)})

    def without_answers(self, keys: Collection[str]) -> _Journal:
        return self.with_answers(_without(self.answers, keys))

    def with_step(self, step: str, **changes: Any) -> _Journal:
        """The journal with these fields of the step's record changed."""
        return self.model_copy(update={"steps": {**self.steps, step: self.of(step).model_copy(update=changes)}})

    def to_dict(self) -> dict[str, Any]:
        return {"schema": _SCHEMA, **self.model_dump(mode="json")}

    @staticmethod
    def read(path: Path) -> _Journal:
        """The journal in a wizard.json. Raises InputError naming what is wrong with it."""
        try:
            data = read_json(path)
        except InputError as error:
            raise InputError(error.what, where=error.where, remedy=_REMEDY) from None
        if data.get("schema") != _SCHEMA:
            raise InputError(f"schema is {data.get('schema')!r}, {_SCHEMA} is needed", where=path, remedy=_REMEDY)
        try:
            # as JSON, in which lists are tuples also where types are strict
            return _Journal.model_validate_json(json.dumps(data))
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            what = f"is damaged ({place + ': ' if place else ''}{first['msg'].removeprefix('Value error, ')})"
            raise InputError(what, where=path, remedy=_REMEDY) from None


def _without(answers: Mapping[str, Any], keys: Collection[str]) -> dict[str, Any]:
    return {key: value for key, value in answers.items() if key not in keys}


class Store:
    """A session folder that one wizard works on at a time; a context manager.

    Raises InputError if the folder cannot be made or written, is in use, or has a damaged wizard.json.
    """

    def __init__(self, root: Path) -> None:
        self.root = Path(root)
        self.journal = _Journal(answers={}, steps={})
        self.begun_s = math.inf
        """When wizard.json was written last before this session began."""
        self.retracted: dict[str, Any] = {}
        """Answers that were taken back, which become the defaults of their questions."""

    def __enter__(self) -> Store:
        make_folder(self.root)
        remedy = "name a folder that can be written"
        if not os.access(self.root, os.W_OK | os.X_OK):
            raise InputError("is read-only", where=self.root, remedy=remedy)
        self._lock = FileLock(self.root / LOCK, blocking=False)
        try:
            self._lock.acquire()
        except Timeout:
            what = "another wizard works on this session"
            raise InputError(what, where=self.root, remedy="end that one first") from None
        except NotImplementedError:  # no locks there, as on some network drives; the files are whole all the same
            pass
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", where=self.root, remedy=remedy) from None
        with contextlib.ExitStack() as undo:
            undo.callback(self._lock.release)
            if not self.is_new:
                self.journal = _Journal.read(self.root / NAME)
                self.begun_s = (self.root / NAME).stat().st_mtime
            unfinished = r"\.(wizard|session|noload|loads|sweep|board|rig|camera|check|\d{4,})-[a-z0-9_]{8}\.\w+"
            for folder in (self.root, *(self.root / name for name in (*FOLDERS.values(), *WAYS.values()))):
                for path in folder.iterdir() if folder.is_dir() else ():
                    if re.fullmatch(unfinished, path.name):
                        path.unlink(missing_ok=True)
            undo.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    @property
    def is_new(self) -> bool:
        """Whether there is no wizard.json yet."""
        return not (self.root / NAME).exists()

    def folder(self, step: str) -> str:
        """The name of the folder of a step's pictures."""
        return FOLDERS.get(step) or WAYS[str(self.journal.answers.get("plane_way", "jig"))]

    def path(self, taken: AcceptedPicture) -> Path:
        return self.root / taken.file

    def save(self, journal: _Journal) -> None:
        """Write a journal to the disk, then use it."""
        write_json(self.root / NAME, journal.to_dict())
        self.journal = journal

    def _record(self, step: str, **changes: Any) -> None:
        self.save(self.journal.with_step(step, **changes))

    def answer(self, answers: Mapping[str, Any], corrected: bool = False) -> None:
        """Store answers. corrected : whether they replace others that were taken back.

        Refused pictures of jig and antenna are offered again: a wrong answer may have been the reason.
        """
        before = self.journal.answers
        changed = [key for key, value in answers.items() if before.get(key) != value]
        if not changed:
            return
        # of another material neither number is known any more
        void = OF_MATERIAL if "material" in set(changed) & before.keys() and answers["material"] != "other" else ()
        journal = self.journal.with_answers({**_without(before, void), **answers})
        if any((corrected or key in before) and not key.endswith(("source", "readings")) for key in changed):
            for step in ("plane", "noload", "loads"):
                if journal.of(step).left:
                    journal = journal.with_step(step, left=())
        self.save(journal)

    def forget_answers(self, keys: Collection[str]) -> None:
        """Drop answers, so that they are asked for again."""
        self.save(self.journal.without_answers(keys))

    def offer_no_more(self, keys: Collection[str]) -> None:
        """Stop offering as defaults the answers of these keys that were taken back."""
        self.retracted = _without(self.retracted, keys)

    def take(self, step: str, picture: Picture, readings: Mapping[str, float]) -> AcceptedPicture:
        """Store a picture with its readings."""
        before = self.journal.of(step).taken
        folder = self.root / self.folder(step)
        folder.mkdir(exist_ok=True)
        stems = [Path(one.file).stem for one in before]
        number = 1 + max((int(stem) for stem in stems if stem.isascii() and stem.isdigit()), default=0)
        while any((folder / f"{number:04d}{suffix}").exists() for suffix in SUFFIXES):
            number += 1
        path = folder / f"{number:04d}{picture.suffix.lower()}"
        with replacing(path) as temporary:
            temporary.write_bytes(picture.data)
        file = path.relative_to(self.root).as_posix()
        taken = AcceptedPicture(file=file, source=picture.name, sha256=picture.sha256, readings=dict(readings))
        self._record(step, taken=(*before, taken))
        return taken

    def correct(self, step: str, number: int, readings: Mapping[str, float]) -> None:
        """Replace the readings of a step's accepted picture, counted from 0."""
        taken = list(self.journal.of(step).taken)
        taken[number] = taken[number].model_copy(update={"readings": {**taken[number].readings, **readings}})
        self._record(step, taken=tuple(taken))

    def refuse(self, step: str, picture: Picture, why: str) -> None:
        refused = _RefusedPicture(source=picture.name, sha256=picture.sha256, why=why)
        self._record(step, left=(*self.journal.of(step).left, refused))

    def begin(self, step: str, past: Sequence[str]) -> None:
        """Begin a step; pictures that exist already (`past`) do not count."""
        self._record(step, past=tuple(past))

    def close(self, step: str, how: str) -> None:
        """Close a step; reopen it with `how` = ""."""
        if self.journal.of(step).closed != how:
            self._record(step, closed=how)

    def drop(self, step: str, taken: AcceptedPicture) -> Path:
        """Move a picture into another folder and do not offer it again. Returns its new path."""
        record = self.journal.of(step)
        kept = tuple(one for one in record.taken if one is not taken)
        refused = _RefusedPicture(source=taken.source, sha256=taken.sha256, why="taken back")
        self._record(step, taken=kept, left=(*record.left, refused), closed="")
        target = self._new_archive("dropped") / self.path(taken).name
        with contextlib.suppress(FileNotFoundError):
            self.path(taken).rename(target)
        return target

    def redo(self, step: str, forget: Collection[str] = (), past: Sequence[str] | None = None) -> Path | None:
        """Start a step again, without these answers. past : as in `_StepRecord`. Returns the new folder of its
        pictures."""
        record, place = self.journal.of(step), None
        again = self.journal.without_answers(forget)
        again = again.model_copy(
            update={"steps": {**again.steps, step: _StepRecord(past=None if past is None else tuple(past))}}
        )
        if step == "board":
            # another one may fit the pictures that it was not found in
            again = again.with_step("lens", left=())
        if record.taken:
            place = self._new_archive(step)
            write_json(place / "was.json", record.model_dump(mode="json"))
        self.save(again)
        for taken in record.taken:
            if place is not None and self.path(taken).exists():
                self.path(taken).rename(place / Path(taken.file).name)
        return place

    def forget_lost(self) -> list[AcceptedPicture]:
        """Remove from the journal the pictures that have disappeared or changed. Returns them."""
        journal, lost = self.journal, list[AcceptedPicture]()
        for step, record in self.journal.steps.items():
            kept = [one for one in record.taken if self.path(one).is_file() and sha256(self.path(one)) == one.sha256]
            if len(kept) < len(record.taken):
                lost += [one for one in record.taken if one not in kept]
                journal = journal.with_step(step, taken=tuple(kept), closed="")
        if lost:
            self.save(journal)
        return lost

    def unlisted(self) -> list[Path]:
        """Pictures in the steps' folders that the journal does not list, and the folders of alternatives that were
        not chosen.

        The calibration would use every way to plane C that it finds. In a session that was not made by the wizard all
        of them are wanted, and none is returned here.
        """
        named = {one.file for record in self.journal.steps.values() for one in record.taken}
        folders = [self.root / self.folder(step) for step in PICTURES]
        pictures = [path for folder in folders if folder.is_dir() for path in sorted(folder.iterdir())]
        found = [path for path in pictures if path.suffix.lower() in SUFFIXES and path.is_file()]
        unlisted = [path for path in found if path.relative_to(self.root).as_posix() not in named]
        if "jig_given" in self.journal.answers:
            return unlisted
        ways = (self.root / way for way in WAYS.values() if way != self.folder("plane"))
        return unlisted + [folder for folder in ways if folder.is_dir()]

    def write(self, name: str, data: bytes) -> None:
        """Write a file that the user may have edited; its previous version is kept in another folder."""
        path = self.root / name
        if path.exists():
            if path.read_bytes() == data:
                return
            shutil.copy2(path, self._new_archive("replaced") / name)
        with replacing(path) as temporary:
            temporary.write_bytes(data)

    def archive(self, paths: Sequence[Path], why: str) -> Path:
        """Move files or folders into an archive folder of the session. Returns that folder."""
        place = self._new_archive(why)
        for path in paths:
            target = place / path.relative_to(self.root)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.rename(target)
        return place

    def _new_archive(self, name: str) -> Path:
        number = 1
        while True:
            place = self.root / ARCHIVE / (name if number == 1 else f"{name}-{number}")
            try:
                place.mkdir(parents=True)
                return place
            except FileExistsError:
                number += 1
