"""Times that can be quoted: median or least after a warm-up, with the machine named."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

SLOW_S = 1.0
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What tells the numerical libraries how many threads to take."""


def median_seconds(function: Callable[[], object], repeats: int, least_s: float = 0.02) -> float:
    """Median of `repeats` timings after one warm-up call.

    Quick functions are repeated within each timing; one that takes over a second is timed once.
    """
    begun = time.perf_counter()
    function()
    warm = time.perf_counter() - begun
    calls, repeats = max(1, int(least_s / max(warm, 1e-7))), 1 if warm > SLOW_S else repeats
    return sorted(_timings(function, repeats, calls))[repeats // 2]


def least_seconds(function: Callable[[], object], repeats: int) -> float:
    """Least of `repeats` timings after one warm-up call: what the machine can do when nothing else disturbs."""
    function()
    return min(_timings(function, repeats, 1))


def _timings(function: Callable[[], object], repeats: int, calls: int) -> list[float]:
    """Seconds a call, so often, each the mean of so many calls."""
    timings = []
    for _ in range(repeats):
        begun = time.perf_counter()
        for _ in range(calls):
            function()
        timings.append((time.perf_counter() - begun) / calls)
    return timings


@dataclass(frozen=True)
class Machine:
    """What a benchmark ran on.

    Attributes
    ----------
    threads : variables of the environment that limit them, those that are set.
    versions : package → version, or "absent".
    """

    processor: str
    cores: int
    threads: Mapping[str, str]
    system: str
    python: str
    versions: Mapping[str, str]

    def __str__(self) -> str:
        """All on one line but the system."""
        limits = [f"{name}={value}" for name, value in self.threads.items()]
        named = [f"{name} {number}" for name, number in self.versions.items()]
        return ", ".join([self.processor, f"{self.cores} cores", *limits, f"Python {self.python}", *named])


def machine(packages: Sequence[str], others: Mapping[str, str] | None = None) -> Machine:
    """The machine, and the versions of the packages that are measured, ours first, and of others that are told."""
    return Machine(
        processor=_processor(),
        cores=os.cpu_count() or 1,
        threads={name: os.environ[name] for name in _THREADS if os.environ.get(name)},
        system=platform.platform(),
        python=platform.python_version(),
        versions={name: _version(name) for name in ("vbaa-calib", *packages)} | dict(others or {}),
    )


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"
