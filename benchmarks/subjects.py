"""The subjects of `vbaa bench`, in the order in which they are run: what each needs and what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.files import refuse_overwrite, replacing, write_json

from .figures import DPI
from .harness import Findings, Machine, Options, as_json, write_csv

_NUMERIC = ("numpy", "scipy", "torch")
_PICTURES = ("numpy", "scipy", "opencv-contrib-python-headless")


@dataclass(frozen=True)
class Subject:
    """One subject, measured by `measure(options)` of the module `benchmarks.NAME.NAME`.

    Attributes
    ----------
    about : one line of help.
    draw : what a draw is, in words. draws : how many, usually and with --quick. least : fewest that say anything.
    packages : those whose versions are named beside ours.
    files : tables (.csv) and figures (.png) that it leaves, all of them.
    suite : whether `vbaa bench` without a subject runs it.
    jobs : whether it can use more than one process.
    """

    name: str
    about: str
    draw: str
    draws: tuple[int, int]
    packages: tuple[str, ...]
    files: tuple[str, ...]
    least: int = 1
    suite: bool = True
    jobs: bool = False

    @property
    def record(self) -> str:
        """File that says what the others were made with."""
        return f"{self.name}.json"

    def options(self, seed: int, quick: bool, draws: int | None = None, jobs: int = 1) -> Options:
        """As asked for, the subject's own number of draws where none is given."""
        return Options(seed, draws or self.draws[quick], quick, jobs if self.jobs else 1)

    def measure(self, options: Options) -> Findings:
        """Run it."""
        run: Callable[[Options], Findings] = import_module(f"benchmarks.{self.name}.{self.name}").measure
        return run(options)


_ALL = (
    Subject(
        "metric",
        "pixels to rays by OpenCV, kornia and the metric layer",
        "random pixels of each lens",
        (1_000_000, 20_000),
        ("numpy", "opencv-contrib-python-headless", "torch", "kornia"),
        ("metric.csv", "metric.png"),
        least=200,
    ),
    Subject(
        "calibration",
        "lenses from corners, in mm on C: OpenCV, lensboy, mrcal (if VBAA_PEER_PYTHON has them), ours",
        "sets of views of each rig",
        (20, 3),
        _PICTURES,
        ("calibration.csv", "calibration.png"),
    ),
    Subject(
        "vision",
        "the antenna in good, hard and empty pictures, beside other methods",
        "pictures of each hardship",
        (40, 4),
        _PICTURES,
        ("vision.csv", "vision_methods.csv", "vision_random.csv", "vision.png"),
    ),
    Subject(
        "estimator",
        "contacts against the Cramér-Rao bound, speed against error, hard cases, random scenes",
        "noise draws of each kind of scene",
        (400, 12),
        _NUMERIC,
        (
            "estimator.csv",
            "estimator_rods.csv",
            "estimator_speed.csv",
            "estimator_hard.csv",
            "estimator_random.csv",
            "estimator.png",
            "estimator_grid.png",
        ),
        least=4,
    ),
    Subject(
        "object",
        "objects stroked by the antenna: surface, normals, friction, stiffness, first contact",
        "recordings of each kind",
        (10, 1),
        _NUMERIC,
        ("object.csv", "object_alarms.csv", "object_onsets.csv", "object.png"),
    ),
    Subject(
        "chain",
        "from picture to contact: speed against error, every method and rung",
        "pictures of each size and rig",
        (30, 4),
        (*_PICTURES, "torch"),
        ("chain.csv", "chain_stages.csv", "chain_losses.csv", "chain.png"),
    ),
    Subject(
        "growth",
        "cost as work grows: frames, points, picture size, views, contacts",
        "timings of each size",
        (3, 1),
        (*_PICTURES, "torch"),
        ("growth.csv", "growth.png"),
    ),
    Subject(
        "guided",
        "pictures for the lens at suggested and at random poses, until plane C is known",
        "sequences of pictures of each kind",
        (20, 1),
        (*_PICTURES, "torch"),
        ("guided.csv", "guided.png"),
        suite=False,
    ),
    Subject(
        "coverage",
        "whether the deviations that whole calibrations predict are those that sampling shows",
        "calibrations of each rig",
        (500, 10),
        (*_PICTURES, "torch"),
        ("coverage.csv", "coverage_rigs.csv", "coverage.png"),
        least=2,
        suite=False,
        jobs=True,
    ),
    Subject(
        "drift",
        "rigs that changed since their calibration: contacts lost, silent errors, with and without free frames",
        "rigs, each with its calibration, change and recording",
        (30, 2),
        (*_PICTURES, "torch"),
        ("drift.csv", "drift.png"),
        suite=False,
    ),
    Subject(
        "paper",
        "the paper's experiments redone (docs/experiments.md)",
        "noise draws of each setting",
        (16, 2),
        _NUMERIC,
        (
            "paper_sensing.csv",
            "paper_friction.csv",
            "paper_path.csv",
            "paper_yielding.csv",
            "paper_fig7.png",
            "paper_fig5.png",
            "paper_yielding.png",
        ),
        suite=False,
    ),
)

SUBJECTS = {subject.name: subject for subject in _ALL}
"""Name → subject, in the order in which they are run."""


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
            draw().savefig(ready[name], dpi=DPI)
        write_json(ready[subject.record], measured.record)
    return [folder / name for name in ready]
