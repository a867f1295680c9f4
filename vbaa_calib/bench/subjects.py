"""The subjects of `vbaa bench`, in the order in which they are run: what each needs and what it leaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

from .subject import Findings, Options

_NUMERIC = ("numpy", "scipy", "torch")
_PICTURES = ("numpy", "scipy", "opencv-contrib-python-headless")


@dataclass(frozen=True)
class Subject:
    """One subject, measured by `measure(options)` of the module `vbaa_calib.bench.NAME`.

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
        run: Callable[[Options], Findings] = import_module(f"vbaa_calib.bench.{self.name}").measure
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
