"""What all subjects share: options and findings, tables declared once, timings, the record of the machine."""

from __future__ import annotations

import csv
import io
import os
import platform
import resource
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from timeit import Timer
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from vbaa_calib.core.files import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Arrays = TypeVar("Arrays")
Row = TypeVar("Row")
Result = TypeVar("Result")
AGAINST = "f736bd2"
"""The commit beside which this tree's speed is measured: the last one whose inner loops were compiled by numba."""


@dataclass(frozen=True)
class Options:
    """What a subject is asked for.

    draws : noise draws of each cell; what a draw is, the subject says.
    quick : less of everything, for a first look: the subject chooses where `draws` says nothing.
    against : an older commit of this repository, for comparison.
    """

    seed: int
    draws: int
    quick: bool
    against: str = AGAINST


@dataclass(frozen=True, eq=False)
class Findings:
    """What a subject found.

    text : the tables for people.
    tables : file name → rows, all instances of one dataclass.
    figures : file name → what draws it.
    numbers : what --json prints; NaN and infinity become null.
    headline : the result in at most 100 characters, for the suite's summary.
    versions : of what else was measured than the packages that the subject is known to need.
    """

    text: str
    tables: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    figures: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    headline: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)


# --- rows of arrays and their statistics


def concatenated(parts: Sequence[Arrays]) -> Arrays:
    """Dataclasses whose fields are all arrays (B, ...), one after the other as one."""
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return type(parts[0])(*(np.concatenate(column) for column in columns))


def picked(rows: Arrays, which: np.ndarray) -> Arrays:
    """The same dataclass of arrays with the rows of these indices, which may repeat, or of a mask."""
    return type(rows)(*(values[which] for values in vars(rows).values()))


def rms(values: np.ndarray) -> float:
    """Root mean square of all; NaN of nothing, and where one of them is NaN."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def mean(values: np.ndarray) -> float:
    """Of all; NaN of nothing."""
    return float(values.mean()) if len(values) else float("nan")


def median(values: np.ndarray) -> float:
    """Of all; NaN of nothing."""
    return float(np.median(values)) if len(values) else float("nan")


def largest(values: np.ndarray) -> float:
    """The greatest size of all; NaN of nothing."""
    return float(np.max(np.abs(values))) if len(values) else float("nan")


def rms_known(values: np.ndarray) -> float:
    """Root mean square of what is finite; NaN of nothing."""
    return rms(values[np.isfinite(values)])


def mean_known(values: np.ndarray) -> float:
    """Of what is finite; NaN of nothing."""
    return mean(values[np.isfinite(values)])


WITHIN, SILENT = 1.96, 5.0
"""Standard deviations within which 95 % of errors lie, and beyond which an error that nothing warns of is silent."""


def covered(errors: np.ndarray, std: np.ndarray | float = 1.0) -> float:
    """Share of 95 % intervals that contain the truth, of errors that have a standard deviation; NaN of nothing."""
    known = np.isfinite(errors) & np.isfinite(std)
    return mean((np.abs(errors) <= WITHIN * np.asarray(std))[known])


def spread(values: np.ndarray, errors: np.ndarray) -> tuple[float, float, float]:
    """Mean of values, scatter and root mean square of their errors; NaN without any."""
    return mean(values), float(np.std(errors)) if len(errors) else np.nan, rms_known(errors)


def shares(values: Sequence[Any] | np.ndarray) -> str:
    """Which values there are, most frequent first, with their shares."""
    counts = Counter(map(str, values))
    return ", ".join(f"{value} {100 * count / len(values):.1f} %" for value, count in counts.most_common())


# --- tables


def column(
    heading: str = "", spec: str = "", scale: float = 1.0, of: Callable[[Any], Any] | None = None, **default: Any
) -> Any:
    """A field of a row: in text tables below its heading, times `scale`, by `spec`; without a heading in files only.

    `of` : what works it out of what `row_of` is given.
    """
    return field(metadata={"heading": heading, "spec": spec, "scale": scale, "of": of}, **default)


def row_of(kind: type[Row], given: Any, *first: Any, **own: Any) -> Row:
    """A row: its first columns and others as they are, the rest worked out of what is given."""
    worked = {one.name: one.metadata["of"] for one in fields(cast(Any, kind)) if one.metadata.get("of")}
    return kind(*first, **own, **{name: of(given) for name, of in worked.items() if name not in own})


class Draws:
    """Many results as one: of an attribute that is an array all values in a row, of any other one number a result."""

    def __init__(self, results: Sequence[Any]) -> None:
        self._results = results

    def __len__(self) -> int:
        return len(self._results)

    def __getattr__(self, name: str) -> np.ndarray:
        values = [getattr(one, name) for one in self._results]
        return np.concatenate(values) if values and np.ndim(values[0]) else np.array(values, float)


def table(
    rows: Sequence[Any], title: str = "", once: int = 0, more: Mapping[str, Callable[[Any], str]] | None = None
) -> str:
    """Rows of one dataclass as an aligned text table below a title.

    `once` : of so many first columns a value is not repeated below itself. `more` : heading → text, columns at the end.
    """
    shown = [one for one in fields(rows[0]) if one.metadata.get("heading")] if rows else []
    lines = [[cell(getattr(row, one.name), **one.metadata) for one in shown] for row in rows]
    for row, line in zip(rows, lines, strict=True):
        line += [tell(row) for tell in (more or {}).values()]
    for line, above in reversed(list(zip(lines[1:], lines, strict=False))):
        for place in range(once):
            if line[place] != above[place]:
                break
            line[place] = ""
    left = [not one.metadata["spec"] for one in shown] + [True] * len(more or {})
    return aligned([[one.metadata["heading"] for one in shown] + list(more or {}), *lines], left, title)


def aligned(lines: Sequence[Sequence[str]], left: Sequence[bool], title: str = "") -> str:
    """Cells as columns of one width each, set to the left or right."""
    widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
    rows = [
        "  ".join(
            cell.ljust(width) if on_left else cell.rjust(width)
            for cell, width, on_left in zip(line, widths, left, strict=True)
        ).rstrip()
        for line in lines
    ]
    return "\n".join([*([title] if title else []), *rows])


def cell(value: Any, spec: str = "", scale: float = 1.0, **_: Any) -> str:
    """For people; a dash where there is no number."""
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return "–"
    return str(value) if not spec else f"{value if scale == 1.0 else scale * value:{spec}}"


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


def write_csv(path: Path, rows: Sequence[Any], force: bool) -> None:
    """One line per row (at least one dataclass instance), columns named by its fields; empty where there is no number.

    Several words in one cell are separated by semicolons.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, [one.name for one in fields(rows[0])], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        cells = as_json(row).items()
        writer.writerow({name: "; ".join(map(str, cell)) if isinstance(cell, list) else cell for name, cell in cells})
    write_text(path, text.getvalue(), force)


# --- clock and machine

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that limit the numerical libraries' threads."""


def _timer(function: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> Timer:
    """As `timeit` does it, but with garbage collected as usual."""
    return Timer(function, "import gc; gc.enable()", clock)


def least_seconds(function: Callable[[], object], repeats: int) -> float:
    """Least of `repeats` timings after one warm-up call: what the machine can do when nothing else disturbs."""
    function()
    return min(_timer(function).repeat(repeats, 1))


def processor_seconds(function: Callable[[], object], repeats: int, long_s: float = 0.25) -> float:
    """Least processor time, of all threads together, of a first call and `repeats` more; one that is long counts."""
    timer = _timer(function, time.process_time)
    least = timer.timeit(1)
    return min([least, *timer.repeat(repeats, 1)]) if least <= long_s and repeats else least


def timed(function: Callable[[], Result]) -> tuple[Result, float]:
    """What a function gives, and the processor time that it took, with that of programs that it ran to their end."""

    def spent_s() -> float:
        others = resource.getrusage(resource.RUSAGE_CHILDREN)
        return time.process_time() + others.ru_utime + others.ru_stime

    begun = spent_s()
    return function(), spent_s() - begun


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV and torch on one thread meanwhile."""
    import cv2
    import torch

    threads = cv2.getNumThreads(), torch.get_num_threads()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads[0])
        torch.set_num_threads(threads[1])


def machine(packages: Sequence[str], others: Mapping[str, str]) -> dict[str, Any]:
    """What a benchmark ran on.

    threads : environment variables that limit them, those that are set. versions : of ours, of the packages that are
    measured, or "absent", and of others that are given.
    """
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "cores": os.cpu_count() or 1,
        "threads": {name: os.environ[name] for name in _THREADS if os.environ.get(name)},
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in ("vbaa-calib", *packages)} | dict(others),
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"


def in_a_line(ran_on: Mapping[str, Any]) -> str:
    """All of `machine` but the system."""
    limits = [f"{name}={value}" for name, value in ran_on["threads"].items()]
    named = [f"{name} {number}" for name, number in ran_on["versions"].items()]
    words = [ran_on["processor"], f"{ran_on['cores']} cores", *limits, f"Python {ran_on['python']}", *named]
    return ", ".join(words)


# --- tables in pages of docs/


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows])


def replace_marked(page: Path, script: str, text: str) -> None:
    """Replace what is between the marks of a script, `benchmarks/NAME.py`."""
    begin, end = f"<!-- begin: {script} -->", f"<!-- end: {script} -->"
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    _, _, after = rest.partition(end)
    write_text(page, f"{before}{begin}\n{text}\n{end}{after}", force=True)
