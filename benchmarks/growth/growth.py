"""One kind of work at growing sizes."""

from __future__ import annotations

import ctypes
import gc
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from .work import (
    batch_of_points,
    felt_object,
    joint_solve,
    lens_solve,
    one_picture,
    recording_of_frames,
    surface_of_contacts,
)

_SLOW_S = 2.0
"""Work that takes longer is timed once: what disturbs it averages out."""
_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_CAN_TELL = _STATUS.exists() and _RESET.exists()


@dataclass(frozen=True)
class Cost:
    """Of one size of work.

    Attributes
    ----------
    seconds : of the processor, all threads together, least of several timings: what else the machine does hardly
        counts, nor does waiting for the disk.
    risen_MB : how far the resident set rose above what it was before, at most; NaN where the system does not tell.
    peak_MB : the highest resident set.
    """

    seconds: float
    risen_MB: float
    peak_MB: float


def cost_of(work: Callable[[], object], repeats: int) -> Cost:
    """Run the work `repeats` times, or once where it is slow."""
    seconds, risen, peaks = [], [], []
    for _ in range(max(repeats, 1)):
        _give_back()
        _forget_peak()
        before = resident_MB("VmRSS")
        begun = time.process_time()
        work()
        seconds.append(time.process_time() - begun)
        peaks.append(resident_MB("VmHWM"))
        risen.append(peaks[-1] - before)
        if seconds[-1] > _SLOW_S:
            break
    return Cost(min(seconds), max(risen), max(peaks))


def resident_MB(which: str) -> float:
    """The resident set now (VmRSS), or its highest since that was last forgotten (VmHWM)."""
    if not _CAN_TELL:
        return float("nan")
    lines = _STATUS.read_text().splitlines()
    return next(float(line.split()[1]) * 1024e-6 for line in lines if line.startswith(f"{which}:"))


def _give_back() -> None:
    """What earlier work has left behind: an allocator that kept it would use it again, and nothing would show."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if os.name == "posix" else None
    if trim is not None:
        trim(0)


def _forget_peak() -> None:
    if _CAN_TELL:
        _RESET.write_text("5")


LEAST = 3
"""Sizes that an exponent is fitted to, at least."""
MARGIN = 0.15
"""An exponent is worse than expected where it exceeds that by so much and by two of its standard deviations."""


@dataclass(frozen=True)
class Power:
    """cost = at_one · size^exponent over the sizes from `smallest` on; `std` is the exponent's, by the scatter."""

    exponent: float
    std: float
    at_one: float
    smallest: float

    def at(self, size: np.ndarray) -> np.ndarray:
        """(...) the fitted cost."""
        return self.at_one * size**self.exponent

    def worse_than(self, expected: float) -> bool:
        """Whether the cost grows faster than it should."""
        return bool(self.exponent - expected > max(MARGIN, 2.0 * self.std))


UNKNOWN = Power(np.nan, np.nan, np.nan, np.nan)


def fitted(sizes: Sequence[float], costs: Sequence[float]) -> Power:
    """The straight line through logarithms, over the upper half of the sizes, three at least.

    What every call costs, however small, hides the growth at the lower end. Costs that are not positive say nothing;
    with fewer than three left all is NaN.
    """
    size, cost = np.asarray(sizes, float), np.asarray(costs, float)
    known = np.isfinite(cost) & (cost > 0.0)
    size, cost = size[known], cost[known]
    count = max(LEAST, (len(size) + 1) // 2)
    if len(size) < LEAST:
        return UNKNOWN
    order = np.argsort(size)[-count:]
    x, y = np.log(size[order]), np.log(cost[order])
    away = x - x.mean()
    spread = float(away @ away)
    exponent = float(away @ y) / spread
    left = y - y.mean() - exponent * away
    std = float(np.sqrt(left @ left / (count - 2) / spread))
    return Power(exponent, std, float(np.exp(y.mean() - exponent * x.mean())), float(np.exp(x.min())))


Work = Callable[[], object]


@dataclass(frozen=True)
class Series:
    """One kind of work.

    Attributes
    ----------
    name, unit : what grows. sizes, quick : how far it is followed; none: not with --quick.
    prepare : size and seed → what is timed; what comes before is not.
    time_exponent, memory_exponent : the largest that is all right. why : why so.
    """

    name: str
    unit: str
    sizes: tuple[int, ...]
    quick: tuple[int, ...]
    prepare: Callable[[int, int], Work]
    time_exponent: float
    memory_exponent: float
    why: str


SERIES = (
    Series(
        "frames, streamed",
        "frames",
        (100, 300, 1_000, 3_000, 10_000, 100_000),
        (40, 80, 160, 320, 640),
        recording_of_frames,
        1.0,
        1.0,
        "files in, table out; kept are each frame's row of recording.csv and its place in centrelines.csv, 0.5 kB",
    ),
    Series(
        "points per frame",
        "points",
        (10, 30, 100, 300, 1_000, 3_000, 10_000),
        (10, 30, 100, 300, 1_000),
        batch_of_points,
        1.0,
        1.0,
        "64 frames in a batch; each point is a row of the fit, the unknowns stay as many",
    ),
    Series(
        "picture size",
        "kpx",
        (100, 300, 1_000, 3_000, 8_000, 20_000),
        (100, 200, 400, 800),
        one_picture,
        1.0,
        1.0,
        "one picture from the file to the contact; every pixel is decoded and the antenna grows with the picture",
    ),
    Series(
        "views, lens",
        "views",
        (5, 10, 20, 50, 100, 200),
        (5, 10, 20),
        lens_solve,
        1.0,
        1.0,
        "a view's pose meets the others' only through the lens, which has nine numbers",
    ),
    Series(
        "stills, joint solve",
        "stills",
        (15, 30, 60, 120),
        (8, 12, 18),
        joint_solve,
        1.0,
        1.0,
        "stills share some twenty unknowns",
    ),
    Series(
        "contacts, surface",
        "contacts",
        (60, 90, 130, 190, 270, 380, 500),
        (40, 60, 90, 130),
        surface_of_contacts,
        3.0,
        2.0,
        "one Gaussian process over all touches, factored whole; that is why more than 500 are thinned",
    ),
    Series(
        "contacts, everything felt",
        "contacts",
        (100, 300, 1_000, 3_000, 10_000, 30_000),
        (),
        felt_object,
        1.0,
        1.0,
        "each contact once: common errors, track, events; the surface takes 500 of them",
    ),
)


GRAIN_MB = 8.0
"""Rises below this say more of the allocator than of the work."""


@dataclass(frozen=True, eq=False)
class Grown:
    """A series as it was measured: at `sizes` (K,) the `costs`."""

    series: Series
    sizes: Sequence[int]
    costs: Sequence[Cost]

    @cached_property
    def seconds(self) -> np.ndarray:
        """(K,) of each size."""
        return np.array([cost.seconds for cost in self.costs])

    @cached_property
    def risen_MB(self) -> np.ndarray:
        """(K,) what the resident set rose by."""
        return np.array([cost.risen_MB for cost in self.costs])

    @cached_property
    def time(self) -> Power:
        """Fitted to the seconds."""
        return fitted(self.sizes, self.seconds.tolist())

    @cached_property
    def memory(self) -> Power:
        """Fitted to the memory, where it is more than the allocator's grain."""
        return fitted(self.sizes, np.where(self.risen_MB >= GRAIN_MB, self.risen_MB, np.nan).tolist())

    @property
    def worse(self) -> bool:
        """Whether either grows faster than it should."""
        series = self.series
        return self.time.worse_than(series.time_exponent) or self.memory.worse_than(series.memory_exponent)


def follow(series: Series, sizes: Sequence[int], seed: int, repeats: int) -> Grown:
    """The smallest size runs once before the first: what is loaded and kept for ever does not count."""
    series.prepare(sizes[0], seed)()
    return Grown(series, sizes, [cost_of(series.prepare(size, seed), repeats) for size in sizes])
