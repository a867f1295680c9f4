"""`vbaa bench scale`: recordings on one and two workers: pace, overhead, bytes moved."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from benchmarks.growth.work import write_recording
from benchmarks.harness import Findings, Options, aligned
from vbaa_calib.core.console import progress
from viz.batch import cluster
from viz.batch.cluster import Where, client_of
from viz.batch.recordings import BatchRecording
from viz.batch.results import Results
from viz.batch.work import BatchSettings, do

if TYPE_CHECKING:
    from distributed import Client

_FRAMES, _QUICK_FRAMES, _POINTS = 5000, 512, 40
_FEW = 12
"""So many recordings at most are done serially."""
_EMPTY = 200
_IDLE_S = 3.0


@dataclass(frozen=True)
class Scale:
    """One way to do the same frames.

    workers : processes; 0: in this process, without dask. wall_s : by the clock, on a machine that others may use.
    tasks_s : the processor's seconds of tasks; all_s : of all processes together. overhead : of all_s, what is not in
        tasks, for a machine without other work: what dask takes while it waits for the processor is taken off.
        each_ms : the same for a recording.
    moved_per_frame, written_per_frame : bytes between processes, and of the data set.
    """

    workers: int
    recordings: int
    frames: int
    wall_s: float
    tasks_s: float
    all_s: float
    overhead: float
    each_ms: float
    frames_per_s: float
    us_per_frame: float
    moved_per_frame: float
    written_per_frame: float


def measure(options: Options) -> Findings:
    """Recordings on one worker and two; some of them serially."""
    each = _QUICK_FRAMES if options.quick else _FRAMES
    with TemporaryDirectory() as folder:
        root = Path(folder)
        short = root / "short"
        for index in range(options.draws):
            (short / f"{index:04d}").mkdir(parents=True)
            write_recording(short / f"{index:04d}", each, _POINTS, options.seed + index)
        recordings = [BatchRecording(path.name, path, path / "rig.json") for path in sorted(short.iterdir())]
        do(recordings[0], BatchSettings(), _results(root / "warm"))  # reads compiled code
        rows = [_serially(recordings[:_FEW], root / "serial")]
        task_s, idle = 0.0, {0: 0.0}
        for workers in progress((1, 2), "workers"):
            with client_of(Where(jobs=workers)) as client:
                for address in client.scheduler_info(n_workers=-1)["workers"]:
                    warm = _results(root / f"warm{workers}")  # reads compiled code
                    client.submit(
                        do, recordings[0], BatchSettings(again=True), warm, workers=[address], pure=False
                    ).result()
                task_s, idle[workers] = _empty_task_s(client), _idle(client)
                _count(client)
                rows.append(_on(client, workers, recordings, root / f"short{workers}"))
    rows = [_with_overhead(row, idle[row.workers]) for row in rows]
    faster = rows[1].wall_s / rows[2].wall_s
    worst = max(row.overhead for row in rows[1:])
    said = (
        f"an empty task costs {1e3 * task_s:.2f} ms of all processes together, waiting {100 * idle[2]:.1f} % of a core"
    )
    text = "\n".join([_table(rows), said])
    numbers = {"faster": faster, "empty_task_s": task_s, "idle": idle, "rows": [vars(row) for row in rows]}
    headline = f"two workers {faster:.2f} times one, overhead at most {100 * worst:.1f} %"
    return Findings(text, {"scale.csv": rows}, {}, numbers, headline)


def _results(root: Path) -> Results:
    results = Results(root)
    results.prepare([])
    return results


def _serially(recordings: Sequence[BatchRecording], root: Path) -> Scale:
    results = _results(root)
    wall, begun = time.perf_counter(), time.process_time()
    rows = [do(recording, BatchSettings(), results).row for recording in recordings]
    spent = time.process_time() - begun
    return _scale(0, rows, time.perf_counter() - wall, (spent, spent), results, 0)


def _on(client: Client, workers: int, recordings: Sequence[BatchRecording], root: Path) -> Scale:
    results = _results(root)
    before, moved, tasks = _spent_s(client), _moved(client), _in_tasks(client)
    wall = time.perf_counter()
    rows = [outcome.row for outcome in cluster.run(client, recordings, BatchSettings(), results)]
    wall_s = time.perf_counter() - wall
    spent = _in_tasks(client) - tasks, _spent_s(client) - before
    return _scale(workers, rows, wall_s, spent, results, _moved(client) - moved)


def _scale(
    workers: int,
    rows: Sequence[object],
    wall_s: float,
    spent_s: tuple[float, float],
    results: Results,
    moved: int,
) -> Scale:
    done = [dict(row) for row in rows]  # type: ignore[call-overload]
    frames = sum(row["frames"] for row in done)
    written = sum(path.stat().st_size for path in results.root.glob("contacts/*/*.parquet"))
    return Scale(
        workers,
        len(done),
        frames,
        wall_s,
        *spent_s,
        0.0,
        0.0,
        frames / wall_s,
        1e6 * spent_s[0] / frames,
        moved / frames,
        written / frames,
    )


def _with_overhead(row: Scale, idle: float) -> Scale:
    waited_s = row.wall_s - row.all_s / max(row.workers, 1)
    more_s = row.all_s - row.tasks_s - idle * max(waited_s, 0.0)
    return replace(row, overhead=more_s / row.all_s, each_ms=1e3 * more_s / row.recordings)


def _spent_s(client: Client) -> float:
    """The processor's seconds so far, of the workers and of this process, in which the scheduler runs."""
    return sum(client.run(time.process_time).values()) + time.process_time()


_COUNTS = {"sent": 0.0, "tasks_s": 0.0}
"""Of this process: the bytes that it sent, and the processor's seconds that it spent in tasks."""


def _counting() -> None:
    """Count from now on: dask's own counters go by what it takes objects to be worth, and by the clock."""
    from dask._task_spec import Task
    from distributed.comm.tcp import TCP

    write, call = TCP.write, Task.__call__

    async def counted(self: TCP, *given: object, **named: object) -> int:
        sent: int = await write(self, *given, **named)
        _COUNTS["sent"] += sent
        return sent

    def timed(self: Task, *given: object, **named: object) -> object:
        begun = time.thread_time()
        try:
            return call(self, *given, **named)
        finally:
            _COUNTS["tasks_s"] += time.thread_time() - begun

    if write.__name__ != counted.__name__:
        TCP.write, Task.__call__ = counted, timed


def _count(client: Client) -> None:
    _counting()
    client.run(_counting)


def _count_of(name: str) -> float:
    return _COUNTS[name]


def _moved(client: Client) -> int:
    return int(sum(client.run(_count_of, "sent").values()) + _count_of("sent"))


def _in_tasks(client: Client) -> float:
    return float(sum(client.run(_count_of, "tasks_s").values()))


def _idle(client: Client) -> float:
    before = _spent_s(client)
    time.sleep(_IDLE_S)
    return (_spent_s(client) - before) / _IDLE_S


def _empty_task_s(client: Client) -> float:
    before = _spent_s(client)
    client.gather([client.submit(int, index, pure=False) for index in range(_EMPTY)])
    return (_spent_s(client) - before) / _EMPTY


def _table(rows: Sequence[Scale]) -> str:
    head = [
        "workers",
        "recordings",
        "frames",
        "wall s",
        "tasks s",
        "all s",
        "overhead",
        "ms each",
        "frames/s",
        "µs/frame",
        "B moved",
        "B kept",
    ]
    cells = [
        [
            str(row.workers),
            str(row.recordings),
            str(row.frames),
            f"{row.wall_s:.1f}",
            f"{row.tasks_s:.1f}",
            f"{row.all_s:.1f}",
            f"{100 * row.overhead:.1f} %",
            f"{row.each_ms:.0f}",
            f"{row.frames_per_s:.0f}",
            f"{row.us_per_frame:.0f}",
            f"{row.moved_per_frame:.0f}",
            f"{row.written_per_frame:.0f}",
        ]
        for row in rows
    ]
    return aligned([head, *cells], [False] * len(head))
