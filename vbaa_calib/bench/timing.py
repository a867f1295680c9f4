"""Times that can be quoted: medians after a warm-up, with the machine named."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

SLOW_S = 1.0


def median_seconds(function: Callable[[], object], repeats: int, least_s: float = 0.02) -> float:
    """Median of `repeats` timings after one warm-up call.

    Quick functions are repeated within each timing; one that takes over a second is timed once.
    """
    begun = time.perf_counter()
    function()
    warm = time.perf_counter() - begun
    calls, repeats = max(1, int(least_s / max(warm, 1e-7))), 1 if warm > SLOW_S else repeats
    timings = []
    for _ in range(repeats):
        begun = time.perf_counter()
        for _ in range(calls):
            function()
        timings.append((time.perf_counter() - begun) / calls)
    return sorted(timings)[len(timings) // 2]


def machine(packages: Sequence[str]) -> str:
    """One line: processor, cores, Python and the packages that were measured."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = names[0] if names else platform.processor() or platform.machine()
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    return f"{processor}, {os.cpu_count()} cores, Python {platform.python_version()}, {versions}"
