"""The session folder as the wizard's memory: what it says it has is on the disk before it says so.

Each picture is written whole (write, fsync, rename), then wizard.json that names it. Whatever ends the program in
between leaves a picture that nobody names, which is put aside at the next start. The tables and session.yaml follow
from wizard.json and are written anew from it.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import replacing, sha256, write_json
from vbaa_calib.core.images import SUFFIXES
from vbaa_calib.wizard.sources.offered import Offered

from .journal import Journal, Left, Record, Taken


def _locked(path: Path) -> TextIO:
    """An open file that is locked until it is closed, or the process ends, however it ends.

    Raises InputError where another process has it, or where it cannot be written.
    """
    try:
        stream = path.open("a")
    except OSError as error:
        why = f"cannot be written ({error.strerror})"
        raise InputError(why, where=path.parent, remedy="name a folder that can be written") from None
    try:
        import fcntl

        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        stream.close()
        raise InputError(
            "another wizard works on this session", where=path.parent, remedy="end that one first"
        ) from None
    except (ImportError, OSError):  # no such locks there, as on some network drives; the files are whole all the same
        pass
    return stream


NAME = "wizard.json"
ASIDE = "aside"
LOCK = ".wizard-lock"
_HALF_WRITTEN = re.compile(r"\.(wizard|session|noload|loads|sweep|board|rig|camera|check|\d{4,})-[a-z0-9_]{8}\.\w+")
FOLDERS = {"lens": "intrinsics", "noload": "noload", "loads": "loads"}
"""Step → folder of its pictures; plane C's depends on the way that was chosen."""
WAYS = {"jig": "plane", "sweep": "sweep", "over": "over"}


class Store:
    """A session folder in a wizard's hands. Use as a context: one wizard at a time.

    Raises InputError where the folder cannot be made or written, where another wizard has it, or where wizard.json is
    damaged.
    """

    def __init__(self, root: Path) -> None:
        self.root = Path(root)
        self.journal = Journal()

    def __enter__(self) -> Store:
        try:
            self.root.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise InputError(f"cannot be made ({why})", where=self.root, remedy="name another folder") from None
        if not os.access(self.root, os.W_OK | os.X_OK):
            raise InputError("is read-only", where=self.root, remedy="name a folder that can be written")
        self._lock = _locked(self.root / LOCK)
        try:
            if (self.root / NAME).exists():
                self.journal = Journal.read(self.root / NAME)
            self._sweep_up()
        except BaseException:
            self._lock.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.close()

    @property
    def is_new(self) -> bool:
        """Whether no wizard was here before."""
        return not (self.root / NAME).exists()

    def folder(self, step: str) -> str:
        """Name of the folder of a step's pictures."""
        return FOLDERS.get(step) or WAYS[str(self.journal.answers.get("plane_way", "jig"))]

    def path(self, taken: Taken) -> Path:
        """Where a picture is."""
        return self.root / taken.file

    def save(self, journal: Journal) -> None:
        """Put a journal on the disk, then take it for true."""
        write_json(self.root / NAME, journal.to_dict())
        self.journal = journal

    def answer(self, answers: Mapping[str, Any], mended: bool = False) -> None:
        """Keep answers. mended : they replace others that were taken back."""
        before = self.journal.answers
        changed = [key for key, value in answers.items() if before.get(key) != value]
        if not changed:
            return
        journal = self.journal.with_answers(answers)
        if any((mended or key in before) and not key.endswith(("source", "readings")) for key in changed):
            journal = _looked_at_again(journal)
        self.save(journal)

    def forget_answers(self, keys: Collection[str]) -> None:
        """Drop answers, so that they are asked for again."""
        left = {key: value for key, value in self.journal.answers.items() if key not in keys}
        self.save(replace(self.journal, answers=left))

    def take(self, step: str, offered: Offered, readings: Mapping[str, float]) -> Taken:
        """Keep a picture, with what was read with it."""
        record = self.journal.of(step)
        folder = self.root / self.folder(step)
        folder.mkdir(exist_ok=True)
        number = 1 + max((_number(one.file) for one in record.taken), default=0)
        while any((folder / f"{number:04d}{suffix}").exists() for suffix in SUFFIXES):
            number += 1
        path = folder / f"{number:04d}{offered.suffix.lower()}"
        with replacing(path) as temporary:
            temporary.write_bytes(offered.data)
        taken = Taken(path.relative_to(self.root).as_posix(), offered.name, offered.sha256, dict(readings))
        self.save(self.journal.with_step(step, replace(record, taken=(*record.taken, taken))))
        return taken

    def leave(self, step: str, offered: Offered, why: str) -> None:
        """Remember that a picture was not taken."""
        record = self.journal.of(step)
        left = (*record.left, Left(offered.name, offered.sha256, why))
        self.save(self.journal.with_step(step, replace(record, left=left)))

    def close(self, step: str, how: str) -> None:
        """The step is done."""
        if self.journal.of(step).closed != how:
            self.save(self.journal.with_step(step, replace(self.journal.of(step), closed=how)))

    def open(self, step: str) -> None:
        """Go on with a step that was done."""
        self.close(step, "")

    def drop(self, step: str, taken: Taken) -> Path:
        """Take a picture back: it goes aside and is not offered again. Where it is now."""
        record = self.journal.of(step)
        kept = tuple(one for one in record.taken if one is not taken)
        left = (*record.left, Left(taken.source, taken.sha256, "taken back"))
        self.save(self.journal.with_step(step, replace(record, taken=kept, left=left, closed="")))
        return self._aside(self.path(taken), "dropped")

    def redo(self, step: str, forget: Collection[str] = ()) -> Path | None:
        """Start a step again, these answers forgotten.

        What it had goes aside, and where that is comes back; None where it had nothing.
        """
        record = self.journal.of(step)
        answers = {key: value for key, value in self.journal.answers.items() if key not in forget}
        again = replace(self.journal.with_step(step, Record()), answers=answers, redone=(*self.journal.redone, step))
        place = None
        if record.taken:
            place = self._new_aside(f"{step}-{again.redone.count(step)}")
            write_json(place / "was.json", record.to_dict())
        self.save(again)
        for taken in record.taken:
            if place is not None and self.path(taken).exists():
                self.path(taken).rename(place / Path(taken.file).name)
        return place

    def missing(self) -> list[Taken]:
        """Pictures that were taken and are not there any more, or have changed."""
        every = [one for record in self.journal.steps.values() for one in record.taken]
        return [one for one in every if not self.path(one).is_file() or sha256(self.path(one)) != one.sha256]

    def forget(self, lost: list[Taken]) -> None:
        """Go on without pictures that are not there any more."""
        journal = self.journal
        for step, record in self.journal.steps.items():
            kept = tuple(one for one in record.taken if one not in lost)
            if len(kept) < len(record.taken):
                journal = journal.with_step(step, replace(record, taken=kept, closed=""))
        self.save(journal)

    def strangers(self) -> list[Path]:
        """Pictures in the steps' folders that the journal does not name, and folders of ways that were not chosen.

        The calibration takes every way to plane C that it finds; those that came with a session are meant.
        """
        named = {one.file for record in self.journal.steps.values() for one in record.taken}
        folders = [self.root / self.folder(step) for step in ("lens", "plane", "noload", "loads")]
        pictures = [path for folder in folders if folder.is_dir() for path in sorted(folder.iterdir())]
        found = [path for path in pictures if path.suffix.lower() in SUFFIXES and path.is_file()]
        strange = [path for path in found if path.relative_to(self.root).as_posix() not in named]
        if "jig_given" in self.journal.answers:
            return strange
        ways = (self.root / way for way in WAYS.values() if way != self.folder("plane"))
        return strange + [folder for folder in ways if folder.is_dir()]

    def replace(self, name: str, data: bytes) -> None:
        """Write a file that is not the wizard's alone; what it held before is kept aside."""
        path = self.root / name
        if path.exists() and path.read_bytes() != data:
            shutil.copy2(path, self._new_aside("replaced") / name)
        if not path.exists() or path.read_bytes() != data:
            with replacing(path) as temporary:
                temporary.write_bytes(data)

    def put_aside(self, paths: Sequence[Path], why: str) -> Path:
        """Move files or folders out of the way, never delete them. The folder where they are now."""
        place = self._new_aside(why)
        for path in paths:
            target = place / path.relative_to(self.root)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.rename(target)
        return place

    def _aside(self, path: Path, why: str) -> Path:
        target = self._new_aside(why) / path.name
        with contextlib.suppress(FileNotFoundError):
            path.rename(target)
        return target

    def _new_aside(self, name: str) -> Path:
        base, number = self.root / ASIDE, 1
        while True:
            place = base / (name if number == 1 else f"{name}-{number}")
            try:
                place.mkdir(parents=True)
            except FileExistsError:
                number += 1
            else:
                return place

    def _sweep_up(self) -> None:
        """Remove what a wizard that was stopped while writing left half-written: nobody was told of it."""
        for folder in (self.root, *(self.root / name for name in (*FOLDERS.values(), *WAYS.values()))):
            if folder.is_dir():
                for path in folder.iterdir():
                    if _HALF_WRITTEN.fullmatch(path.name):
                        path.unlink(missing_ok=True)


def _looked_at_again(journal: Journal) -> Journal:
    """With the pictures of the antenna that were left offered again: why they were may have been a wrong answer."""
    for step in ("noload", "loads"):
        record = journal.of(step)
        if record.left:
            journal = journal.with_step(step, replace(record, left=()))
    return journal


def _number(file: str) -> int:
    stem = Path(file).stem
    return int(stem) if stem.isascii() and stem.isdigit() else 0
