"""`vbaa bench scale`: recordings on one and two workers, whole and in pieces: pace, overhead, bytes moved."""

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
from viz.batch.recordings import Recording
from viz.batch.results import Results
from viz.batch.work import Settings, do

if TYPE_CHECKING:
    from distributed import Client

_FRAMES, _QUICK_FRAMES, _POINTS = 4096, 1024, 40
_EMPTY = 200


@dataclass(frozen=True)
class Scale:
    """One way to do the same frames.

    workers : processes; 0: in this process, without dask. wall_s : by the clock, on a machine that others may use.
    parts : recordings, or pieces. work_s : the processor's seconds of what is done with frames, all_s : of all
        processes together. overhead : what they take beside the work, beyond what the serial run does, of all that it
        takes; each_ms : the same for a part. (The work itself scatters with what else the machine does.)
    moved_per_frame, written_per_frame : bytes between workers, and of the data set.
    """

    kind: str
    workers: int
    parts: int
    frames: int
    wall_s: float
    work_s: float
    all_s: float
    overhead: float
    each_ms: float
    frames_per_s: float
    work_us_per_frame: float
    moved_per_frame: float
    written_per_frame: float


def measure(options: Options) -> Findings:
    """The same frames serially, as recordings on one worker and two, and as one recording in pieces."""
    each = _QUICK_FRAMES if options.quick else _FRAMES
    with TemporaryDirectory() as folder:
        root = Path(folder)
        short, long = root / "short", root / "long"
        for index in range(options.draws):
            (short / f"{index:04d}").mkdir(parents=True)
            write_recording(short / f"{index:04d}", each, _POINTS, options.seed + index)
        long.mkdir()
        write_recording(long, each * options.draws, _POINTS, options.seed)
        recordings = [Recording(path.name, path, path / "rig.json") for path in sorted(short.iterdir())]
        one = [Recording("long", long, long / "rig.json")]
        do(recordings[0], Settings(), _results(root / "warm"))  # reads compiled code
        rows = [_serially(recordings, root / "serial")]
        task_s = 0.0
        for workers in progress((1, 2), "workers"):
            with client_of(Where(jobs=workers)) as client:
                for address in client.scheduler_info(n_workers=-1)["workers"]:
                    warm = _results(root / f"warm{workers}")  # reads compiled code
                    client.submit(do, recordings[0], Settings(again=True), warm, workers=[address], pure=False).result()
                task_s = _empty_task_s(client)
                rows.append(_on(client, workers, "recordings", recordings, root / f"short{workers}"))
                rows.append(_on(client, workers, "pieces", one, root / f"long{workers}", each))
    rows = [_beside(row, rows[0]) for row in rows]
    by = {(row.kind, row.workers): row for row in rows}
    faster = {kind: by[kind, 1].wall_s / by[kind, 2].wall_s for kind in ("recordings", "pieces")}
    worst = max(row.overhead for row in rows[1:])
    text = "\n".join([_table(rows), f"an empty task costs {1e3 * task_s:.2f} ms of all processes together"])
    numbers = {"faster": faster, "empty_task_s": task_s, "rows": [vars(row) for row in rows]}
    headline = f"two workers {faster['recordings']:.2f} x one, overhead at most {100 * worst:.1f} %"
    return Findings(text, {"scale.csv": rows}, {}, numbers, headline)


def _results(root: Path) -> Results:
    results = Results(root)
    results.prepare([])
    return results


def _serially(recordings: Sequence[Recording], root: Path) -> Scale:
    results = _results(root)
    wall, begun = time.perf_counter(), time.process_time()
    rows = [do(recording, Settings(), results).row for recording in recordings]
    spent = time.process_time() - begun, time.perf_counter() - wall
    return _scale("serial", 0, rows, spent[1], spent[0], results, 0)


def _on(
    client: Client, workers: int, kind: str, recordings: Sequence[Recording], root: Path, each: int = _FRAMES
) -> Scale:
    results = _results(root)
    settings = Settings(piece=each if kind == "pieces" else Settings().piece)
    before, moved = _spent_s(client), _moved(client)
    wall = time.perf_counter()
    rows = [outcome.row for outcome in cluster.run(client, recordings, settings, results)]
    wall_s = time.perf_counter() - wall
    return _scale(kind, workers, rows, wall_s, _spent_s(client) - before, results, _moved(client) - moved)


def _scale(
    kind: str, workers: int, rows: Sequence[object], wall_s: float, all_s: float, results: Results, moved: int
) -> Scale:
    done = [dict(row) for row in rows]  # type: ignore[call-overload]
    frames, work_s = sum(row["frames"] for row in done), sum(row["cpu_s"] for row in done)
    written = sum(path.stat().st_size for path in results.root.glob("contacts/*/*.parquet"))
    return Scale(
        kind,
        workers,
        sum(row["pieces"] for row in done),
        frames,
        wall_s,
        work_s,
        all_s,
        0.0,
        0.0,
        frames / wall_s,
        1e6 * work_s / frames,
        moved / frames,
        written / frames,
    )


def _beside(row: Scale, serial: Scale) -> Scale:
    more_s = (row.all_s - row.work_s) - (serial.all_s - serial.work_s)
    return replace(row, overhead=more_s / serial.all_s, each_ms=1e3 * more_s / row.parts)


def _spent_s(client: Client) -> float:
    """The processor's seconds so far, of the workers and of this process, in which the scheduler runs."""
    return sum(client.run(time.process_time).values()) + time.process_time()


def _moved(client: Client) -> int:
    def sent(dask_worker: object) -> int:
        return int(dask_worker.transfer_outgoing_bytes_total)  # type: ignore[attr-defined]

    return sum(client.run(sent).values())


def _empty_task_s(client: Client) -> float:
    before = _spent_s(client)
    client.gather([client.submit(int, index, pure=False) for index in range(_EMPTY)])
    return (_spent_s(client) - before) / _EMPTY


def _table(rows: Sequence[Scale]) -> str:
    head = [
        "what",
        "workers",
        "parts",
        "frames",
        "wall s",
        "work s",
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
            row.kind,
            str(row.workers),
            str(row.parts),
            str(row.frames),
            f"{row.wall_s:.1f}",
            f"{row.work_s:.1f}",
            f"{row.all_s:.1f}",
            f"{100 * row.overhead:.1f} %",
            f"{row.each_ms:.0f}",
            f"{row.frames_per_s:.0f}",
            f"{row.work_us_per_frame:.0f}",
            f"{row.moved_per_frame:.0f}",
            f"{row.written_per_frame:.0f}",
        ]
        for row in rows
    ]
    return aligned([head, *cells], [True, *[False] * (len(head) - 1)])
