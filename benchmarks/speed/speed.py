"""`vbaa bench speed`: this tree beside an older commit in one run, on calibrated rigs with friction as by default.

Both trees get the same frames, in pairs one after the other; the limits stand beside them.
"""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.chain.judge import reading_seconds
from benchmarks.estimator.baselines import baselines, one_contact
from benchmarks.estimator.setup import Setup
from benchmarks.figures import AMBER, GREEN, GREY, INK, SHADE, VIOLET, label, legend, name_points, panels
from benchmarks.harness import Findings, Options, column, of_any, or_none, processor_seconds, rms_known, table
from estimator.table.contacts import FRICTION_RAD
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import write_json
from vbaa_calib.rig import Rig

from .frames import SIZE, Judged, as_measured, fitting_nothing, hard, photographed, population
from .trees import HERE, Tree, Worker, older

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OURS, PAPER, LINE, LOOP = "this library", "the paper's two points", "straight line", "SciPy least_squares"
CALIBRATED, EXACT, DEMO = "calibrated", "exact", "demo"
_RUNGS_AT = {CALIBRATED: 500, EXACT: 200}
"""Points of the frames that every rung is tried on."""
_SINGLE, _PICTURES, _LOOP, _ODD = 20, 30, 30, 4
"""Frames one by one, pictures, frames of the SciPy loop, and of those that fit nothing; of few frames fewer."""
_LONG_S = 10.0
"""No further pair is timed after so long."""
_NOTHING = "fits nothing"
_ONE = "the command estimate, one frame"
_IMPORTS = "python -c 'import numpy, scipy.optimize, cv2'"


@dataclass(frozen=True, kw_only=True)
class SpeedRow:
    """One method, one way of calling it. Times are in µs for a frame, a picture or a command.

    before_us, us : least processor time of all threads, of the older commit and of this tree.
    wall_before_us, wall_us : the same on the wall.
    times, typical : before over now, of the least and as the median of the pairs.
    limit_us : what no program can go below, see `limits`.
    of_bound_before, of_bound : rms error of the contact distance in standard deviations of the Cramér–Rao bound.
    answered : share of the frames with a number.
    l_apart, l_apart_most, force_apart_most : how far the two trees' distances (median, largest) and forces are apart,
        in the older one's standard deviations. statuses : of frames where they differ, before → now.
    """

    rig: str = column("rig")
    work: str = column("work")
    points: int | None = column("points", "d", default=None)
    method: str = column("method")
    family: str = column(default=OURS)
    threads: int = column("threads", "d", default=1)
    before_us: float | None = column("before µs", ",.1f", default=None)
    us: float = column("now µs", ",.1f")
    times: float | None = column("times", ".1f", default=None)
    typical: float | None = column(default=None)
    wall_before_us: float | None = column(default=None)
    wall_us: float | None = column("wall µs", ",.1f", default=None)
    limit_us: float | None = column("limit µs", ",.2f", default=None)
    of_bound_before: float | None = column("error", ".2f", default=None)
    of_bound: float | None = column("now", ".2f", default=None)
    answered: float | None = column("answered %", ".1f", 100, default=None)
    l_apart: float | None = column(default=None)
    l_apart_most: float | None = column("apart", ".1e", default=None)
    force_apart_most: float | None = column(default=None)
    statuses: tuple[str, ...] = column(default=())


@dataclass(frozen=True, eq=False)
class Job:
    """What both trees do: a way of `worker.py` with a rig, what is given (a way's arrays), model and friction."""

    rig_name: str
    work: str
    way: str
    rig: Rig
    given: Mapping[str, np.ndarray]
    model: str = "auto"
    friction: float = FRICTION_RAD
    threads: int = 1
    judged: Judged | None = None
    limit_s: float | None = None

    @property
    def points(self) -> int | None:
        """Of a frame; None of pictures."""
        return self.given["points_px"].shape[1] if "points_px" in self.given else None


def limit_s(rig: Rig, points: int, flops_per_s: float) -> float:
    """Of a fit: sums of squares and products of residuals and slopes, once, at the rate of a matrix product.

    The slopes are those by the four unknowns and by what of the rig is not exactly known.
    """
    columns = 5 + int((np.diag(rig.covariance) > 0.0).sum())
    return points * columns * (columns + 1) / flops_per_s


def measured_flops_per_s(size: int = 512) -> float:
    """Of one thread, by a product of two square matrices."""
    matrix = np.ones((size, size))
    return 2.0 * size**3 / processor_seconds(lambda: matrix @ matrix, 20)


def jobs(calibrated: Rig, frames: int, seed: int) -> Iterator[Job]:
    """Calibrated rigs first, friction as by default; then a rig that is exactly known, without friction."""
    flops, few = measured_flops_per_s(), max(1, min(_SINGLE, frames // 4))
    for name, rig, friction in ((CALIBRATED, calibrated, FRICTION_RAD), (EXACT, Setup().rig(), 0.0)):
        for points in (500, 200):
            judged = population(rig, frames, seed, friction, points)
            first = Judged(judged.scenes.picked(np.arange(few)), judged.bound_m[:few])
            limit = limit_s(rig, points, flops)
            job = partial(Job, name, rig=rig, friction=friction, limit_s=limit)
            # the lowest rung knows no weight: on a real antenna nothing fits
            models = RUNGS[name == CALIBRATED :] if points == _RUNGS_AT[name] else ()
            for model in ("auto", *models):
                batch = partial(job, "batch", "batch", given=judged.given, judged=judged, model=model)
                yield batch()
                if model == "auto" or name == EXACT:
                    yield job("one frame", "single", given=first.given, judged=first, model=model)
                if model == "auto" and name == CALIBRATED:
                    yield batch(threads=2)
        if name == CALIBRATED:
            odd = hard(rig, frames, seed, friction)
            yield Job(name, "hard frames", "batch", rig, odd.given)
            few = max(1, min(_ODD, frames // 10))
            fits = {name: rows[:few] for name, rows in population(rig, frames, seed, friction, 500).given.items()}
            for work, those in fitting_nothing(rig, fits, seed).items():
                yield Job(name, f"{_NOTHING}: {work}", "batch", rig, those)
            photographs, given = photographed(min(_PICTURES, max(frames // 10, 2)), seed)
            read_s = reading_seconds(SIZE, 3)
            for work, way in (("picture alone", "alone"), ("recording of pictures", "recording")):
                yield Job(name, work, way, photographs, given, limit_s=read_s)


def both(job: Job, workers: Mapping[str, Worker], pairs: int, folder: Path) -> SpeedRow:
    """A job timed in both trees, in turn, and what they answer."""
    rig, frames = folder / "rig.json", folder / "frames.npz"
    write_json(rig, job.rig.to_dict(), force=True)
    np.savez(frames, allow_pickle=False, **job.given)
    found: dict[str, dict[str, np.ndarray]] = {}
    for name, worker in workers.items():
        answers = folder / f"{len(found)}.npz"
        worker.ask(
            way=job.way,
            rig=str(rig),
            frames=str(frames),
            answers=str(answers),
            **{word: getattr(job, word) for word in ("model", "friction", "threads")},
        )
        found[name] = dict(np.load(answers))
    timings: list[dict[str, dict[str, float]]] = []
    begun = time.perf_counter()
    while not timings or (len(timings) < pairs and time.perf_counter() - begun < _LONG_S):
        timings.append({name: worker.ask() for name, worker in workers.items()})
    row = _row(job.rig_name, job.work, timings, points=job.points, method=job.model, threads=job.threads)
    now = next(iter(found.values()))
    extra: dict[str, Any] = {"limit_us": None if job.limit_s is None else 1e6 * job.limit_s}
    extra["answered"] = float(np.isfinite(now["distance_m"]).mean())
    for name, words in zip(found, ("of_bound", "of_bound_before"), strict=False):
        if job.judged is not None:
            extra[words] = or_none(rms_known(job.judged.errors(found[name]["distance_m"])))
    return replace(row, **extra, **(_apart(*found.values()) if len(found) > 1 else {}))


def _row(
    rig: str, work: str, timings: Sequence[Mapping[str, Mapping[str, float]]], **more: int | str | None
) -> SpeedRow:
    """Least times, and the ratios, of pairs: name of the tree, this one first, → times."""
    names = list(timings[0])
    cpu, wall = (1e6 * np.array([[one[name][key] for name in names] for one in timings]) for key in ("cpu_s", "wall_s"))
    least, on_wall = cpu.min(axis=0), wall.min(axis=0)
    there = len(names) > 1
    return SpeedRow(
        rig=rig,
        work=work,
        us=float(least[0]),
        wall_us=float(on_wall[0]),
        before_us=float(least[1]) if there else None,
        wall_before_us=float(on_wall[1]) if there else None,
        times=float(least[1] / least[0]) if there else None,
        typical=float(np.median(cpu[:, 1] / cpu[:, 0])) if there else None,
        **more,  # type: ignore[arg-type]
    )


def _apart(now: Mapping[str, np.ndarray], before: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The last columns of a row."""
    off = np.abs(now["distance_m"] - before["distance_m"]) / before["distance_std_m"]
    force = (np.abs(now["force_N"] - before["force_N"]) / before["force_std_N"])[:, 1:]
    located, pairs = np.isfinite(off), zip(before["status"], now["status"], strict=True)
    differ = Counter(f"{one} → {other}" for one, other in pairs if one != other)
    return {
        "l_apart": of_any(np.median, off[located]),
        "l_apart_most": of_any(np.max, off[located]),
        "force_apart_most": of_any(np.max, force[located]),
        "statuses": tuple(f"{words}: {count}" for words, count in differ.most_common()),
    }


def others(calibrated: Rig, frames: int, seed: int) -> Iterator[SpeedRow]:
    """SciPy's least_squares frame by frame, on every population; the paper's formulas on the exact, upright rig."""
    for name, rig, friction in ((CALIBRATED, calibrated, FRICTION_RAD), (EXACT, Setup().rig(), 0.0)):
        for points in (500, 200):
            judged = population(rig, frames, seed, friction, points)
            found, spent = _loop(judged, max(1, min(_LOOP, frames // 4)))
            yield _other(name, LOOP, "least_squares", spent, judged, found)
        if name == EXACT:
            every = np.arange(len(judged.scenes))
            for method, solve in baselines(judged.scenes, np.random.default_rng((seed, 1))).items():
                family = LINE if method == LINE else PAPER
                for which in (every[:1], every):
                    each = processor_seconds(partial(solve, which), 5) / len(which)
                    yield _other(name, family, method, each, judged, solve(every), len(which))


def _loop(judged: Judged, frames: int) -> tuple[np.ndarray, float]:
    """Distances (B,) of the first frames, and the median of the times; each is timed once."""
    found: list[np.ndarray] = []
    works = [lambda own=index: found.append(one_contact(judged.scenes, own)) for index in range(frames)]
    spent = [processor_seconds(work, 0) for work in works]
    return np.array(found)[:, 0], float(np.median(spent))


def _other(
    rig: str, family: str, method: str, seconds: float, judged: Judged, distance_m: np.ndarray, together: int = 1
) -> SpeedRow:
    return SpeedRow(
        rig=rig,
        work="one frame" if together == 1 else "batch",
        points=judged.scenes.points_px.shape[1],
        method=method,
        family=family,
        us=1e6 * seconds,
        of_bound=or_none(rms_known(judged.errors(distance_m))),
        answered=float(np.isfinite(distance_m).mean()),
    )


def commands(trees: Sequence[Tree], pairs: int, folder: Path) -> list[SpeedRow]:
    """Of a user's command lines, the demo's simulation and calibration and one frame; `folder` keeps what this tree
    made, session/ and rig.json."""
    session, rig, one = folder / "session", folder / "rig.json", folder / "one"
    rows = []

    def row(work: str, *words: str, repeats: int = pairs) -> None:
        HERE.run(*words)  # what is compiled is kept
        # this tree comes last: what lies there afterwards is its own
        timings = [{tree.name: tree.run(*words) for tree in reversed(trees)} for _ in range(repeats)]
        ordered = [{tree.name: one[tree.name] for tree in trees} for one in timings]
        rows.append(_row(DEMO, work, ordered, method="command"))

    vbaa = ("-c", "import sys; from vbaa_calib.cli.main import main; sys.exit(main())")
    row("the command simulate", *vbaa, "simulate", "demo", "-o", str(session), "--force", repeats=1)
    row("the command calibrate", *vbaa, "calibrate", str(session), "-o", str(rig), "--force")
    shutil.copytree(session, one)
    lines = (one / "recording/recording.csv").read_text().splitlines()
    (one / "recording/recording.csv").write_text(f"{lines[0]}\n{lines[len(lines) // 4]}\n")
    report = ("--rig", str(rig), "-o", str(folder / "contacts.csv"), "--no-report", "--force")
    row(_ONE, *vbaa, "estimate", str(one), *report)
    row(_IMPORTS, "-c", "import numpy, scipy.optimize, cv2")
    return rows


def run(frames: int, seed: int, against: Tree | None, quick: bool = False) -> list[SpeedRow]:
    """So many frames of each kind. `quick` : a made-up rig instead of the demo's, which has to be calibrated first."""
    trees = [HERE] if against is None else [HERE, against]
    with TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        ran = [] if quick else commands(trees, 3, folder)
        made_up = Setup(tilt_rad=np.radians(30.0), real=True, exact=False)
        rig = as_measured(made_up.rig() if quick else Rig.load(folder / "rig.json"))
        workers = {tree.name: stack.enter_context(Worker(tree)) for tree in trees}
        pairs = 1 if quick else 5
        rows = [both(job, workers, pairs, folder) for job in progress(jobs(rig, frames, seed), "jobs")]
    return [*rows, *others(rig, frames, seed), *ran]


_TITLE = """\
µs of processor time for a frame, a picture or a command, least of alternating pairs; before: {before}; times: before
over now; limit: of a fit its normal equations once at the rate of a matrix product, of a picture reading it once from
memory; error: rms of the contact distance in standard deviations of the Cramér–Rao bound, before and now; apart: the
largest difference of the two in standard deviations of the first; calibrated: {rig}, friction
as by default; exact: an upright camera, no friction"""


def _as_text(rows: Sequence[SpeedRow], before: str, quick: bool) -> str:
    rig = "a made-up rig, as well known as by a calibration" if quick else "the demo's rig, after vbaa calibrate"
    order = sorted(rows, key=lambda row: (CALIBRATED, EXACT, DEMO).index(row.rig))
    return "\n".join([table(order, _TITLE.format(before=before, rig=rig), once=2), *_said(rows)])


def _said(rows: Sequence[SpeedRow]) -> Iterator[str]:
    """Ratios of this tree's own rows, of 500 points and a calibrated rig."""

    def of(work: str, method: str = "auto", threads: int = 1) -> SpeedRow:
        return next(r for r in rows if (r.rig, r.work, r.method, r.threads) == (CALIBRATED, work, method, threads))

    batch = of("batch")
    yield f"two threads: {(batch.wall_us or 0.0) / (of('batch', threads=2).wall_us or 1.0):.2f} times one, on the wall"
    for row in rows:
        if row.work.startswith(_NOTHING):
            yield f"{row.work}: {row.us / batch.us:.1f} times a sound frame"
    linear, elastica, rod = (of("batch", model).us for model in RUNGS[1:])
    yield f"a batch by auto: {batch.us / elastica:.2f} of elastica's time; by linear: {linear / rod:.2f} of rod's"
    ours = {row.work: row.us for row in rows if row.method == "command"}
    if ours:
        yield f"{_ONE}: {ours[_ONE] / ours[_IMPORTS]:.1f} times {_IMPORTS}"
    for row in rows:
        if row.statuses:
            frames = f"{row.rig}, {row.work}, {row.points or 'no'} points, {row.method}"
            yield f"other statuses: {frames}: {'; '.join(row.statuses)}"


_STYLES = {OURS: (GREEN, "s"), LOOP: (GREY, "D"), PAPER: (AMBER, "o"), LINE: (VIOLET, "^")}


def _figure(rows: Sequence[SpeedRow]) -> Figure:
    """Time over error; a line leads from the older commit's time, hollow, to this tree's."""
    shown = [row for row in rows if row.of_bound is not None and row.threads == 1]
    drawn, every = panels(2, 2, (6, 6), sharex=True, sharey=True)
    for panel, rig in zip(every, (CALIBRATED, EXACT), strict=True):
        own = [row for row in shown if row.rig == rig and row.points == _RUNGS_AT[rig]]
        panel.axvspan(0.5, 1.0, color=SHADE, lw=0)
        panel.axvline(1.0, color=INK, lw=1.2)
        for row in own:
            colour, mark = _STYLES[row.family]
            panel.loglog(row.of_bound, row.us, mark, color=colour, markersize=6)
            if row.before_us is not None:
                panel.loglog([row.of_bound_before, row.of_bound], [row.before_us, row.us], color=colour, lw=0.7)
                panel.loglog(row.of_bound_before, row.before_us, mark, color=colour, markerfacecolor="white")
        names = [
            (r.method if r.work == "batch" else f"{r.method}, one", r.of_bound or 0.0, r.us, _STYLES[r.family][0])
            for r in own
        ]
        name_points(panel, names, character=0.015)
        label(panel, f"rig {rig}", "rms error of the contact distance over the Cramér–Rao bound")
    every[0].set_xlim(0.4, 4.0 * max([row.of_bound or 0.0 for row in shown], default=1.0))
    every[0].set_ylabel("processor time, µs per frame")
    legend(drawn, _STYLES, "hollow: before")
    return drawn


def measure(options: Options) -> Findings:
    """The subject `speed` of `vbaa bench`; a draw is a frame."""
    against, missing = None, ""
    try:
        against = older(options.against)
    except InputError as error:
        missing = f"{error}; nothing stands beside this tree's times"
    rows = run(options.draws, options.seed, against, options.quick)
    first = rows[0]
    beside = "" if first.times is None else f", {first.times:.0f} times {options.against}"
    return Findings(
        "\n".join([*([missing] if missing else []), _as_text(rows, options.against, options.quick)]),
        {"speed.csv": rows},
        {"speed.png": lambda: _figure(rows)},
        {"rows": rows, "missing": missing},
        f"auto, a calibrated rig, 500 points: {1e6 / first.us:,.0f} frames/s in a batch{beside}",
    )
