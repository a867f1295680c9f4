"""What the suite of benchmarks comes down to: one line for each subject."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vbaa_calib.core.files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure
import csv
import io
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from vbaa_calib.core.files import write_text


def rms(values: np.ndarray) -> float:
    """Root mean square of all; NaN of nothing, and where one of them is NaN."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def rms_known(values: np.ndarray) -> float:
    """Root mean square of what is finite; NaN of nothing."""
    return rms(values[np.isfinite(values)])


def or_none(value: float | np.floating) -> float | None:
    """The number; None for NaN or infinity."""
    return float(value) if np.isfinite(value) else None


DPI = 110


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty one whose panels make room for their words."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def save(figure: Figure, path: Path, force: bool) -> None:
    """To a PNG, whole or not at all."""
    with replacing(path, force) as temporary:
        figure.savefig(temporary, dpi=DPI)


def write_csv(path: Path, rows: Sequence[Any], force: bool) -> None:
    """One line per row (at least one dataclass instance), columns named by its fields; empty where there is no number.

    That is where a value is None, NaN or infinite. Several words in one cell are separated by semicolons.
    """
    lines = [{name: _joined(value) for name, value in as_json(row).items()} for row in rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    write_text(path, text.getvalue(), force)


def _joined(value: Any) -> Any:
    return "; ".join(map(str, value)) if isinstance(value, list) else value


def as_json(value: Any) -> Any:
    """Dataclasses, sequences and NumPy's numbers as what JSON knows; None for NaN and infinity."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if is_dataclass(value):
        return {field.name: as_json(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def cell(value: float | None, width: int, digits: int, scale: float = 1.0) -> str:
    """A number set to the right, times `scale`; a dash where there is none."""
    return f"{'–':>{width}}" if value is None else f"{scale * value:>{width}.{digits}f}"


@dataclass(frozen=True)
class Options:
    """What a subject is asked for.

    Attributes
    ----------
    draws : noise draws of each cell; what a draw is, is the subject's word.
    quick : less of everything, for a first look: the subject chooses where `draws` says nothing.
    jobs : processes, where a subject can use more than one.
    """

    seed: int
    draws: int
    quick: bool
    jobs: int = 1


@dataclass(frozen=True, eq=False)
class Findings:
    """What a subject found.

    Attributes
    ----------
    text : the tables for people.
    tables : file name → rows, all instances of one dataclass.
    figures : file name → what writes it, given the path and whether an older file may be replaced.
    numbers : what --json prints; NaN and infinity become null.
    headline : what it comes down to, in at most 100 characters; for the suite's summary.
    versions : of what else was measured than the packages that the subject is known to need.
    """

    text: str
    tables: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    figures: Mapping[str, Callable[[Path, bool], None]] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    headline: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)


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


@dataclass(frozen=True)
class Line:
    """One subject: its headline or why it failed, the seconds it took, the names of its files."""

    subject: str
    headline: str
    seconds: float
    files: tuple[str, ...]
    failure: str = ""


def as_text(lines: Sequence[Line]) -> str:
    """The table for people."""
    width = max(len(line.subject) for line in lines)
    told = [
        f"{line.subject:<{width}}{line.seconds:>8.0f}  {f'failed: {line.failure}' if line.failure else line.headline}"
        for line in lines
    ]
    rows = [f"{'subject':<{width}}{'s':>8}  what it comes down to"]
    for line, text in zip(lines, told, strict=True):
        rows.append(text)
        if line.files:
            rows.append(f"{'':<{width + 10}}{', '.join(line.files)}")
    total = sum(line.seconds for line in lines)
    good = sum(not line.failure for line in lines)
    rows.append(f"{'all':<{width}}{total:>8.0f}  {good} of {len(lines)} subjects measured")
    return "\n".join(rows)
