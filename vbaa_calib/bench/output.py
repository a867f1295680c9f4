"""What a subject leaves in a folder: tables, figures and a record of what they were made with; all of them or none."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError, SolveError
from ..files import refuse_overwrite, replacing, write_json
from .rows import as_json, write_csv
from .subject import Findings, Options
from .subjects import Subject
from .timing import Machine


@dataclass(frozen=True, eq=False)
class Measured:
    """One subject with what it found, where and in how many seconds."""

    subject: Subject
    options: Options
    machine: Machine
    found: Findings
    seconds: float

    @property
    def text(self) -> str:
        """The tables for people, below what they were made with."""
        asked = f"{self.options.draws} {self.subject.draw}, seed {self.options.seed}"
        return f"{self.machine}, {asked}{', quick' if self.options.quick else ''}\n{self.found.text}"

    @property
    def record(self) -> dict[str, Any]:
        """Everything that is needed to get the same numbers again."""
        options = self.options
        flags = [f"--draws {options.draws}", f"--seed {options.seed}", *(["--quick"] if options.quick else [])]
        flags += [f"--jobs {options.jobs}"] if options.jobs > 1 else []
        return {
            "subject": self.subject.name,
            "headline": self.found.headline,
            "command": " ".join(["vbaa", "bench", self.subject.name, *flags]),
            "draw": self.subject.draw,
            "draws": options.draws,
            "seed": options.seed,
            "quick": options.quick,
            "jobs": options.jobs,
            "machine": as_json(self.machine),
            "files": list(self.subject.files),
            "seconds": round(self.seconds, 1),
        }


def refuse_folder(folder: Path, subjects: Iterable[Subject], force: bool) -> None:
    """Raises InputError when what the subjects leave cannot go into this folder; to be called before the work."""
    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "no such folder"
        raise InputError(what, where=folder, remedy="create it first")
    for subject in subjects:
        for name in (*subject.files, subject.record):
            refuse_overwrite(folder / name, force)


def write(folder: Path, measured: Measured, force: bool) -> list[Path]:
    """All files of one subject: a table or figure that fails leaves none of them.

    Raises SolveError for a table without rows, and where the files are not those that the subject is known for.
    """
    found, subject = measured.found, measured.subject
    if {*found.tables, *found.figures} != set(subject.files):
        raise SolveError(f"{subject.name} has {sorted({*found.tables, *found.figures})}, not {sorted(subject.files)}")
    empty = [name for name, rows in found.tables.items() if not rows]
    if empty:
        raise SolveError(f"{subject.name} found nothing for {', '.join(empty)}: nothing is written")
    with ExitStack() as stack:
        ready = {
            name: stack.enter_context(replacing(folder / name, force)) for name in (*subject.files, subject.record)
        }
        for name, rows in found.tables.items():
            write_csv(ready[name], rows, force=True)
        for name, draw in found.figures.items():
            draw(ready[name], True)
        write_json(ready[subject.record], measured.record)
    return [folder / name for name in ready]
