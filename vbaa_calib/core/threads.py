"""Threads for functions of the core that release the interpreter's lock."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

_PIECE = 16
"""Items that a thread takes at once."""


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_threads(work: Callable[[int, int], None], count: int, jobs: int) -> None:
    """Call `work(begin, end)` on pieces of range(count) in `jobs` threads."""
    if jobs <= 1 or count <= _PIECE:
        work(0, count)
        return
    list(_pool(jobs).map(lambda begin: work(begin, min(begin + _PIECE, count)), range(0, count, _PIECE)))


@lru_cache
def _pool(jobs: int) -> ThreadPoolExecutor:
    """A pool of `jobs` threads, kept from call to call: to start one takes longer than to fit some frames."""
    return ThreadPoolExecutor(jobs)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has no threads but its first
