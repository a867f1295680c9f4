"""A dask cluster, on this machine or an existing one, and its tasks."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from vbaa_calib.core.errors import Disconnected, InputError, VbaaError, require_extra
from vbaa_calib.core.threads import cores
from viz.batch import work
from viz.batch.recordings import BatchRecording
from viz.batch.results import Results
from viz.batch.work import BatchSettings, Outcome

if TYPE_CHECKING:
    from distributed import Client, Future, Security


@dataclass(frozen=True)
class _PoolSettings:
    """Settings that keep the processes of a batch busy."""

    heal_s: float = 20.0  # s between looks whether all processes are there
    ahead: int = 2  # recordings submitted at a time for each thread
    least_ahead: int = 64  # recordings submitted at least: a cluster that grows with its work sees some
    retries: int = 3  # of a task whose worker was lost


POOL = _PoolSettings()


def _lost() -> Disconnected:
    """The error for a scheduler that is gone, and with it the unfinished tasks."""
    return Disconnected("the scheduler is lost", remedy="run again to do what is missing")


@dataclass(frozen=True)
class Where:
    """Where the work runs: in `jobs` processes of this machine, or on the scheduler at an address.

    security : keys and certificates for that scheduler; None: as dask's configuration says.
    """

    jobs: int = 1
    memory: str = "auto"
    address: str | None = None
    security: Security | None = None

    @property
    def threads(self) -> int:
        """Threads of each process's numerical libraries, so that all processes together use each core once."""
        return max(cores() // self.jobs, 1) if self.address is None else 1


@contextmanager
def client_of(where: Where) -> Iterator[Client]:
    """A client of the cluster; a cluster on this machine ends with it.

    Other users of this machine can neither give work to its cluster nor read from it: its connections, on loopback,
    need keys that are made for it, and what its processes keep on the disk lies in a folder that is nobody else's.

    Raises InputError without dask, and where no scheduler answers.
    """
    distributed = require_extra("distributed", "batch")
    import dask
    from tornado.ioloop import PeriodicCallback

    with ExitStack() as open_ones:
        if where.address is not None:
            try:
                client = distributed.Client(where.address, security=where.security, set_as_default=False)
            except (OSError, ValueError) as error:
                why = str(error).partition("\n")[0]
                remedy = "check address and certificates, and that the scheduler runs"
                raise InputError(f"no scheduler answers ({why})", where=where.address, remedy=remedy) from None
            yield open_ones.enter_context(client)
            return
        require_extra("cryptography", "batch")
        # dask's own folder is one of all users, who could exchange what lies in it: pickles, and modules to import
        place = dask.config.get("temporary-directory")
        own = TemporaryDirectory(prefix="vbaa-batch-", dir=place, ignore_cleanup_errors=True)
        folder = open_ones.enter_context(own)
        quiet = {
            "distributed.scheduler.allowed-failures": POOL.retries,
            # looks at every thread a hundred times a second
            "distributed.worker.profile.enabled": False,
            "distributed.admin.system-monitor.interval": "5s",
            # fifty and ten times a second, in each process and its guard: 5 % of a core
            "distributed.admin.tick.interval": "1s",
            "distributed.worker.memory.monitor-interval": "500ms",
            # an HTTP server is there in each process in any case, for every user of the machine: it has nothing to tell
            "distributed.scheduler.http.routes": [],
            "distributed.worker.http.routes": [],
        }
        open_ones.enter_context(dask.config.set({**quiet, "temporary-directory": folder}))
        cluster = open_ones.enter_context(
            distributed.LocalCluster(
                n_workers=where.jobs,
                threads_per_worker=1,
                processes=True,
                memory_limit=where.memory,
                host="127.0.0.1",
                security=distributed.Security.temporary(),
                dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False},
                silence_logs=50,
            )
        )
        # a process that could not be started anew is given up by dask, and nobody would do its work
        healing = PeriodicCallback(lambda: cluster.scale(where.jobs), 1e3 * POOL.heal_s)
        cluster.loop.add_callback(healing.start)
        open_ones.callback(cluster.loop.add_callback, healing.stop)
        yield open_ones.enter_context(distributed.Client(cluster, set_as_default=False))


def run(
    client: Client, recordings: Sequence[BatchRecording], settings: BatchSettings, results: Results
) -> Iterator[Outcome]:
    """Yields every recording's outcome as it comes. Raises Disconnected with the scheduler.

    A recording that lost its worker too often is done once more at the end, with no other next to it: a neighbour may
    have ended its workers.
    """
    from distributed import as_completed

    waiting, underway, suspects = deque(recordings), dict[Any, BatchRecording](), deque[BatchRecording]()
    alone = False
    coming: Any = as_completed(loop=client.loop)
    while waiting or underway or suspects:
        if not waiting and not underway:
            waiting.append(suspects.popleft())
            alone = True
        most = max(POOL.ahead * len(_workers(client)), POOL.least_ahead)
        while waiting and len(underway) < most:
            future = client.submit(work.do, waiting[0], settings, results, pure=False)
            underway[future.key] = waiting.popleft()
            coming.add(future)
        future = next(coming)
        recording = underway.pop(future.key)
        outcome = _outcome(future, recording, client, alone)
        if outcome is None:
            suspects.append(recording)
        else:
            yield outcome


def _outcome(future: Future, recording: BatchRecording, client: Client, alone: bool) -> Outcome | None:
    """The result of a recording's task; None if its worker was lost while others ran. Raises Disconnected."""
    from distributed import CancelledError, KilledWorker

    try:
        found = future.result()
    except KilledWorker:
        if not alone:
            return None
        times = POOL.retries + 1
        words = f"its worker was lost {times} times: out of memory (--memory), or something crashes in {recording.path}"
        return work.failed(recording, VbaaError(words))
    except CancelledError as error:
        raise _lost() from error
    except Exception as error:
        _workers(client)
        return work.failed(recording, error)
    assert isinstance(found, Outcome)
    return found


def _workers(client: Client) -> list[str]:
    """The cluster's workers by address. Raises Disconnected where no scheduler answers,
    with whatever error dask reports it."""
    try:
        return list(client.nthreads())
    except Exception as error:
        raise _lost() from error
