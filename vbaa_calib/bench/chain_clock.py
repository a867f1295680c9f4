"""Times of one thread, and the wall on the side of speed: reading a picture once from memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import torch

BEYOND_CACHE_BYTES = 256 * 2**20
"""So much is read in turn that nothing of it is still in a processor's cache when its turn comes again."""
LONG_S = 0.25


@dataclass(frozen=True)
class Reading:
    """Reading every byte of one picture once.

    Attributes
    ----------
    memory_s : out of memory. cache_s : again and again, out of whatever cache holds it.
    """

    memory_s: float
    cache_s: float


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV and torch on one thread meanwhile."""
    threads = cv2.getNumThreads(), torch.get_num_threads()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads[0])
        torch.set_num_threads(threads[1])


def seconds(work: Callable[[], object], repeats: int) -> float:
    """Least processor time, of all threads together, over so many calls, after one to warm up.

    What takes longer than `LONG_S` is timed once. With one thread it is the time that passes on a machine with nothing
    else to do; what BLAS does in others, if OMP_NUM_THREADS lets it, counts too.
    """
    begun = time.process_time()
    work()
    least = time.process_time() - begun
    if least > LONG_S:
        return least
    for _ in range(repeats):
        begun = time.process_time()
        work()
        least = min(least, time.process_time() - begun)
    return least


def typical_seconds(works: Sequence[Callable[[], object]], repeats: int) -> float:
    """Median over several pieces of work of the least time of each."""
    return float(np.median([seconds(work, repeats) for work in works]))


def reading(size: tuple[int, int], repeats: int, room_bytes: int = BEYOND_CACHE_BYTES) -> Reading:
    """For 8-bit pictures of (width, height): by summing them eight bytes at a time, or by a copy, the faster way."""
    words = size[0] * size[1] // 8
    store = np.ones((max(room_bytes // (8 * words), 1), words), np.uint64)
    once = np.empty(words, np.uint64)

    def summed(pictures: np.ndarray) -> None:
        for picture in pictures:
            picture.sum()

    def copied(pictures: np.ndarray) -> None:
        for picture in pictures:
            np.copyto(once, picture)

    again = np.broadcast_to(store[:1], store.shape)
    memory, cache = (
        min(seconds(partial(way, pictures), repeats) for way in (summed, copied)) / len(store)
        for pictures in (store, again)
    )
    return Reading(memory, cache)
