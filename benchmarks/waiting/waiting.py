"""`vbaa bench waiting`: what a user waits for, in processor time, beside an older commit and other programs."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import cv2
import numpy as np

from benchmarks import boards
from benchmarks.calibration import AUTO, PEERS, methods
from benchmarks.estimator.baselines import one_contact
from benchmarks.harness import Findings, Options, column, processor_seconds, table
from benchmarks.peers import versions
from estimator.table.contacts import FRICTION_RAD
from targets.board import BoardSpec, opencv_board
from vbaa_calib.core.console import progress, say
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.files import write_json
from vbaa_calib.core.images import read_picture
from vbaa_calib.detect.board.corners import detect_corners
from vbaa_calib.rig import Rig
from vbaa_calib.session import load_session

from .frames import photographed, population
from .recordings import write_recording
from .trees import HERE, VBAA, Tree, Worker, older

POINTS, SINGLE, PICTURES, LOOP = 500, 20, 30, 10
"""Points of a frame; frames one by one, pictures, and frames of the SciPy loop; of few frames fewer."""
ROWS, REFINED, POINTS_A_ROW = (500, 9500), 600, 40
"""Rows of recordings of centrelines whose difference is the cost of a row; rows that are refined; points of each."""
ONE, REPORT = "estimate, one picture", "estimate, 72 pictures, with report"
LIVE = "picture in memory, live, to both of its contacts"
VERBS = {
    "simulate demo": "simulate demo -o {0}/session --force",
    "calibrate": "calibrate {0}/session -o {0}/rig.json --force",
    "check": "check {0}/rig.json {0}/session",
    REPORT: "estimate {0}/session --rig {0}/rig.json -o {0}/contacts.csv --force",
    ONE: "estimate {0}/one --rig {0}/rig.json -o {0}/one.csv --no-report --force",
    "refine, 72 pictures": "refine {0}/contacts.csv --session {0}/session --rig {0}/rig.json -o {0}/r.csv --force",
    "track": "track {0}/contacts.csv --rig {0}/rig.json -o {0}/track.csv --force",
    "reconstruct": "reconstruct {0}/contacts.csv --rig {0}/rig.json -o {0}/object.vtp --force",
    "report": "report {0}/contacts.csv --rig {0}/rig.json -o {0}/page.html --force",
    "budget": "budget {0}/rig.json",
    "view, a picture": "view {0}/contacts.csv --rig {0}/rig.json --screenshot {0}/scene.png --force",
    "demo": "demo --out {0}/demo --force",
}
"""Work → the command line, of a folder."""
_IMPORT = ("-c", "import estimator, vbaa_calib.rig, vbaa_calib.session")
_FIRST = """
import sys; from pathlib import Path; import numpy
from estimator import ContactEstimator; from vbaa_calib.rig import Rig
given = numpy.load(sys.argv[2])
points, *readings = (given[name][0] for name in ("points_px", "moment_Nm", "pan_rad", "tilt_rad"))
moment, pan, tilt = map(float, readings)
ContactEstimator(Rig.load(Path(sys.argv[1]))).estimate(points, moment=moment, pan=pan, tilt=tilt)
"""
BARS = {
    REPORT: 4.0,
    ONE: 3.0,
    "batch, a frame of 500 points": 4.0,
    "one frame of 500 points": 5.0,
    "picture in memory, alone": 2.5,
    "picture in memory, in a recording": 3.0,
    "row of centrelines, file to file": 5.0,
    "refine, 600 rows": 5.0,
    "simulate demo": 3.0,
}
"""Work → how many times faster than the older commit it has to be."""
OTHERS = {"mrcal": 0.5, "cv2 CharucoDetector": 1.0}
"""Other program → its time over ours, at least."""
_NO_BAR = "SciPy least_squares", "OpenCV", "lensboy"


@dataclass(frozen=True)
class WaitRow:
    """One kind of work beside one other program, or alone; ms of processor time.

    times : the other's time over ours, which has to be `bar` at least. evaluations : of the model, of a frame.
    """

    work: str = column("work")
    ms: float = column("now ms", ",.3f")
    beside: str = column("beside", default="")
    other_ms: float | None = column("its ms", ",.3f", default=None)
    times: float | None = column("times", ".2f", default=None)
    bar: float | None = column("bar", ".1f", default=None)
    evaluations: float | None = column("evaluations", ".1f", default=None)
    other_evaluations: float | None = column("its", ".1f", default=None)


def row(work: str, ms: float, beside: str = "", other_ms: float | None = None, **more: Any) -> WaitRow:
    """With the ratio of both times, and the bar that is known for the work, or for the other program."""
    other = other_ms if other_ms is not None and np.isfinite(other_ms) else None
    bar = OTHERS.get(beside) or (None if beside in _NO_BAR else BARS.get(work))
    found = WaitRow(work, ms, beside, other, None if other is None else other / ms, bar, **more)
    say(f"{work}: {ms:,.2f} ms, {beside or 'alone'} {other or np.nan:,.2f}")
    return found


def _line(line: str, place: Path) -> list[str]:
    return ["-c", VBAA, *line.format(place).split()]


def commands(trees: Sequence[Tree], folder: Path, quick: bool) -> Iterator[WaitRow]:
    """Command lines on the demo, each tree with its own session and rig; what is compiled on the way is kept before."""
    places = {tree.name: folder / f"tree{place}" for place, tree in enumerate(trees)}
    for place in places.values():
        place.mkdir()

    def timed(work: str, words: Callable[[Path], Sequence[str]], warm: bool = True) -> dict[str, float]:
        found = {}
        for tree in trees:
            try:
                if warm:
                    tree.run(*words(places[tree.name]))
                found[tree.name] = 1e3 * tree.run(*words(places[tree.name])).cpu_s
            except SolveError as error:
                if tree is HERE:
                    raise
                say(f"{work}: {error}")
                found[tree.name] = float("nan")
        return found

    def compared(work: str, ms: Mapping[str, float]) -> WaitRow:
        ours, *other = ms.items()
        return row(work, ours[1], *(other[0] if other else ()))

    yield compared("import", timed("import", lambda _: _IMPORT))
    for work, line in VERBS.items():
        if quick and work not in (*list(VERBS)[:2], REPORT, ONE):
            continue
        if work == ONE:
            for place in places.values():
                one = place / "one"
                shutil.copytree(place / "session", one)
                lines = (one / "recording/recording.csv").read_text().splitlines()
                (one / "recording/recording.csv").write_text(f"{lines[0]}\n{lines[len(lines) // 4]}\n")
        yield compared(work, timed(work, partial(_line, line)))
    spent = {}
    for rows in (*ROWS, REFINED):
        for place in places.values():
            write_recording(place / str(rows), rows, POINTS_A_ROW, 0)
        line = f"estimate {{0}}/{rows} --rig {{0}}/{rows}/rig.json -o {{0}}/{rows}.csv --no-report --force"
        spent[rows] = timed(line, partial(_line, line), rows == ROWS[0])
    each = {name: (spent[ROWS[1]][name] - spent[ROWS[0]][name]) / (ROWS[1] - ROWS[0]) for name in places}
    yield compared("row of centrelines, file to file", each)
    line = "refine {0}/600.csv --session {0}/600 --rig {0}/600/rig.json -o {0}/600_refined.csv --force"
    yield compared("refine, 600 rows", timed("refine", partial(_line, line)))


def fits(trees: Sequence[Tree], rig: Rig, frames: int, seed: int, folder: Path) -> Iterator[WaitRow]:
    """First calls, frames and pictures within a process: the same rig and frames in every tree."""
    scenes, path = population(rig, frames, seed, FRICTION_RAD, POINTS), folder / "calibrated.json"
    every = {name: getattr(scenes, name) for name in ("points_px", "moment_Nm", "pan_rad", "tilt_rad")}
    few = {name: values[: min(SINGLE, frames)] for name, values in every.items()}
    camera, pictures = photographed(min(PICTURES, frames), seed)
    write_json(path, rig.to_dict())
    write_json(folder / "camera.json", camera.to_dict())
    for name, arrays in (("frames", every), ("few", few), ("pictures", pictures)):
        np.savez(folder / f"{name}.npz", allow_pickle=False, **arrays)
    first = ["-c", _FIRST, str(path), str(folder / "few.npz")]
    spent = [1e3 * min(tree.run(*first).cpu_s for _ in range(2)) for tree in trees]
    yield row("first frame from Python", spent[0], *((trees[1].name, spent[1]) if len(trees) > 1 else ()))
    with ExitStack() as stack:
        workers = [stack.enter_context(Worker(tree)) for tree in trees]
        jobs = (
            ("batch, a frame of 500 points", "batch", "frames", path),
            ("one frame of 500 points", "single", "few", path),
            ("picture in memory, alone", "alone", "pictures", folder / "camera.json"),
            ("picture in memory, in a recording", "recording", "pictures", folder / "camera.json"),
            (LIVE, "live", "pictures", folder / "camera.json"),
        )
        for work, way, given, own in progress(jobs, "fits", len(jobs)):
            asked = workers[:1] if work == LIVE else workers
            job = {"way": way, "rig": str(own), "frames": str(folder / f"{given}.npz")}
            counts = [worker.ask(**job)["evaluations"] for worker in asked]
            timings = [[worker.ask()["cpu_s"] for worker in asked] for _ in range(3)]
            ms = (1e3 * np.min(timings, axis=0)).tolist()
            more = {"evaluations": counts[0], "other_evaluations": counts[1] if len(asked) > 1 else None}
            yield row(work, ms[0], *((trees[1].name, ms[1]) if len(asked) > 1 else ()), **more)
            if way == "single":
                works = [partial(one_contact, scenes, index) for index in range(min(LOOP, frames))]
                loop = 1e3 * float(np.median([processor_seconds(each, 0) for each in works]))
                yield row(work, ms[0], "SciPy least_squares", loop)


def calibrations(session: Path, seed: int, quick: bool) -> Iterator[WaitRow]:
    """A board's corners in the demo's pictures, and the lens from corners, beside what others take for the same."""
    spec = load_session(session).board
    images = [read_picture(path) for path in sorted((session / "intrinsics").glob("*.png"))[:10]]
    images = [image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in images]
    detector = cv2.aruco.CharucoDetector(opencv_board(cast(BoardSpec, spec)))
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    finds: tuple[Callable[[np.ndarray], object], ...] = partial(detect_corners, spec=spec), detector.detectBoard
    ours, opencvs = (
        1e3 * processor_seconds(lambda: list(map(find, images)), 2, 60.0) / len(images)  # noqa: B023
        for find in finds
    )
    yield row("board's corners in a picture", ours, "cv2 CharucoDetector", opencvs)
    drawn = [boards.draw(boards.rigs()[0], seed + index) for index in range(1 if quick else 3)]
    spent = {
        name: 1e3 * float(np.median([one.seconds for one in solve(drawn)]))
        for name, solve in methods().items()
        if not isinstance(solve, str)
    }
    cv2.setNumThreads(threads)
    for name in ("OpenCV", "lensboy", "mrcal"):
        if name in spent:
            yield row("lens auto, 25 views", spent[AUTO], name, spent[name])


def measure(options: Options) -> Findings:
    """The subject `waiting` of `vbaa bench`; a draw is a frame of a batch."""
    trees, missing = [HERE], ""
    try:
        trees.append(older(options.against))
    except InputError as error:
        missing = f"{error}; nothing stands beside this tree's times\n"
    with TemporaryDirectory() as name:
        folder = Path(name)
        rows = list(commands(trees, folder, options.quick))
        rig = Rig.load(folder / "tree0/rig.json")
        rows += fits(trees, rig, options.draws, options.seed, folder)
        rows += calibrations(folder / "tree0/session", options.seed, options.quick)
    title = "ms of processor time, imports and all for commands; times: the other's over ours, at least `bar`"
    barred = [one for one in rows if one.bar is not None and one.times is not None]
    missed = [f"{one.work} beside {one.beside}" for one in barred if (one.times or 0.0) < (one.bar or 0.0)]
    text = f"{missing}{table(rows, title, once=2)}\nbars missed: {'; '.join(missed) or 'none'}"
    headline = f"{len(barred) - len(missed)} of {len(barred)} bars reached"
    return Findings(text, {"waiting.csv": rows}, {}, {"rows": rows}, headline, versions(tuple(PEERS)))
