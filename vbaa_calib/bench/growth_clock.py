"""What a piece of work costs: seconds of the processor, and how far the resident set rises meanwhile."""

from __future__ import annotations

import ctypes
import gc
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

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
