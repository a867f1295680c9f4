"""Who does the work: a dask cluster of this machine or one that is there, and what it is given to do."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from operator import getitem
from pathlib import Path
from typing import TYPE_CHECKING, Any

from estimator.contact.source import Indivisible
from vbaa_calib.core.compiled import cores
from vbaa_calib.core.errors import InputError, VbaaError

from . import work
from .recordings import Recording
from .results import Results
from .work import Outcome, Settings

if TYPE_CHECKING:
    from distributed import Client, Future

TIMES_AGAIN = 3
"""A task whose worker is lost is done again so many times at most."""
_QUIET = {
    "distributed.scheduler.allowed-failures": TIMES_AGAIN,
    # looks at every thread a hundred times a second
    "distributed.worker.profile.enabled": False,
    "distributed.admin.system-monitor.interval": "5s",
    # fifty and ten times a second, in each process and its guard: 5 % of a core
    "distributed.admin.tick.interval": "1s",
    "distributed.worker.memory.monitor-interval": "500ms",
}
_HEAL_S = 20.0
"""So often it is looked whether all processes are there."""
_AHEAD, _LEAST_AHEAD = 2, 64
"""Recordings, and pieces of long ones, that are given out at a time: for each thread, and at least, so that a cluster
that grows with its work sees some."""


_LOST = "the scheduler is lost; run again to do what is missing"


class Lost(VbaaError):
    """The scheduler is gone, and with it what was under way."""


@dataclass(frozen=True)
class Where:
    """Where the work is done: on `jobs` processes of this machine, or by the scheduler at an address or of a file."""

    jobs: int = 1
    memory: str = "auto"
    address: str | None = None
    file: Path | None = None

    @property
    def threads(self) -> int:
        """Threads of each process' kernels: with the processes they use the cores once."""
        return max(cores() // self.jobs, 1) if self.address is None and self.file is None else 1


@contextmanager
def client_of(where: Where) -> Iterator[Client]:
    """A client of the cluster, which ends with it where it is one of this machine.

    Raises InputError without dask, and where no scheduler answers.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
        from tornado.ioloop import PeriodicCallback
    except ImportError:
        raise InputError("dask is not installed", remedy='run: pip install "vbaa-calib[batch]"') from None
    with ExitStack() as open_ones:
        if where.address is not None or where.file is not None:
            given = where.address or str(where.file)
            if where.file is not None and not where.file.is_file():
                raise InputError("no such file", where=where.file, remedy="name the scheduler's --scheduler-file")
            try:
                at = {"address": where.address} if where.address else {"scheduler_file": str(where.file)}
                yield open_ones.enter_context(Client(**at, set_as_default=False))
            except (OSError, ValueError) as error:
                why = str(error).partition("\n")[0]
                remedy = "check the address, and that the scheduler runs"
                raise InputError(f"no scheduler answers ({why})", where=given, remedy=remedy) from None
            return
        open_ones.enter_context(dask.config.set(_QUIET))
        cluster = open_ones.enter_context(
            LocalCluster(
                n_workers=where.jobs,
                threads_per_worker=1,
                processes=True,
                memory_limit=where.memory,
                dashboard_address="127.0.0.1:0",
                silence_logs=50,
            )
        )
        # a process that could not be started anew is given up by dask, and nobody would do its work
        healing = PeriodicCallback(lambda: cluster.scale(where.jobs), 1e3 * _HEAL_S)
        cluster.loop.add_callback(healing.start)
        open_ones.callback(cluster.loop.add_callback, healing.stop)
        yield open_ones.enter_context(Client(cluster, set_as_default=False))


@dataclass
class _Underway:
    recording: Recording
    parts: int = 1
    futures: tuple[Future, ...] = ()
    """What must not be forgotten while the last task waits for it."""


def run(client: Client, recordings: Sequence[Recording], settings: Settings, results: Results) -> Iterator[Outcome]:
    """Every recording's outcome, as they come. Raises Lost with the scheduler.

    A recording whose worker was lost too often is done once more at the end, with no other beside it: a neighbour may
    have ended its workers.
    """
    from distributed import as_completed

    waiting, underway, suspects = deque(recordings), dict[Any, _Underway](), deque[Recording]()
    alone = False
    coming: Any = as_completed(loop=client.loop)
    while waiting or underway or suspects:
        if not waiting and not underway:
            waiting.append(suspects.popleft())
            alone = True
        most = max(_AHEAD * len(_workers(client)), _LEAST_AHEAD)
        while waiting and sum(each.parts for each in underway.values()) < most:
            recording = waiting.popleft()
            future = client.submit(work.do, recording, settings, results, pure=False)
            underway[future.key] = _Underway(recording)
            coming.add(future)
        future = next(coming)
        one = underway.pop(future.key)
        outcome = _outcome(future, one.recording, client, alone)
        if outcome is None:
            suspects.append(one.recording)
        elif outcome.state == "long":
            given, parts = (one.recording, settings, results, outcome.row), outcome.pieces
            index = [client.submit(work.index_of, one.recording, at, parts, pure=False) for at in range(parts)]
            opened = client.submit(work.open_long, *given, index, pure=False)
            last = client.submit(work.parts_of, opened, pure=False)
            underway[last.key] = _Underway(one.recording, 1, (opened,))
            coming.add(last)
        elif outcome.state == "whole":
            whole = replace(settings, piece=2**62)
            future = client.submit(work.do, one.recording, whole, results, pure=False)
            underway[future.key] = _Underway(one.recording)
            coming.add(future)
        elif outcome.state == "opened":
            last, kept = _in_pieces(client, one.futures[0], outcome)
            underway[last.key] = _Underway(one.recording, outcome.pieces, kept)
            coming.add(last)
        else:
            if outcome.state == "failed":
                results.forget(outcome.name)
            yield outcome


def _outcome(future: Future, recording: Recording, client: Client, alone: bool) -> Outcome | None:
    """What a recording's last task says; None: its worker was lost, but not `alone`. Raises Lost."""
    from distributed import CancelledError, KilledWorker

    try:
        found = future.result()
    except KilledWorker:
        if not alone:
            return None
        times = TIMES_AGAIN + 1
        words = f"its worker was lost {times} times: out of memory (--memory), or something crashes in {recording.path}"
        return work.failed(recording, VbaaError(words))
    except CancelledError as error:
        raise Lost(_LOST) from error
    except Indivisible:
        return Outcome(recording.name, "whole", {})
    except Exception as error:
        _workers(client)
        return work.failed(recording, error)
    assert isinstance(found, Outcome)
    return found


def _workers(client: Client) -> list[str]:
    """The cluster's, by address. Raises Lost where no scheduler answers: its loss reaches the client as any error."""
    try:
        return list(client.nthreads())
    except Exception as error:
        raise Lost(_LOST) from error


def _in_pieces(client: Client, opened: Future, outcome: Outcome) -> tuple[Future, tuple[Future, ...]]:
    """The last task of a long recording, and those before it (`estimator.contact.pieces`)."""

    def submit(function: Any, *given: Any, priority: int = 0) -> Future:
        return client.submit(function, *given, priority=priority, pure=False)

    # what others wait for comes first
    pieces = [submit(getitem, opened, index, priority=1) for index in range(outcome.pieces)]
    head = submit(work.bare, pieces[0], priority=1)
    if not outcome.learns:
        return submit(work.finish, head, [submit(work.look_and_fit, piece) for piece in pieces]), (opened, head)
    fitted, learnt = [], None
    for piece in pieces:
        looked = submit(work.look_at, piece)
        learnt = submit(work.learn_from, looked, learnt, priority=1)
        fitted.append(submit(work.fit, looked, learnt))
    return submit(work.finish, head, fitted), (opened, head)


class Pace:
    """How quickly it goes: recordings done of all, frames a second, time left."""

    def __init__(self, count: int) -> None:
        self._begun, self._count, self._done, self._worked, self._frames = time.monotonic(), count, 0, 0, 0

    def line(self, outcome: Outcome) -> str:
        """A line about one more recording."""
        self._done += 1
        seconds = time.monotonic() - self._begun
        if outcome.state == "done":
            self._worked, self._frames = self._worked + 1, self._frames + int(outcome.row["frames"])
        left = (self._count - self._done) * seconds / self._done
        rate = f", {self._frames / seconds:.0f} frames/s" if self._frames else ""
        said = f"{outcome.row['frames']} frames, {outcome.row['ok']} ok" if outcome.state != "failed" else ""
        what = {"done": said, "unchanged": f"unchanged ({said})"}.get(outcome.state, str(outcome.row.get("sentence")))
        return f"[{self._done}/{self._count}{rate}, {left:.0f} s left] {outcome.name}: {what}"
