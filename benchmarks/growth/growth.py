"""`vbaa bench growth`: how the cost grows with the work: frames, points, pixels, views, contacts."""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import linregress

from benchmarks.figures import AMBER, GREEN, label, panels
from benchmarks.harness import Findings, Options, aligned, processor_seconds
from vbaa_calib.core.console import progress

from . import work

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SLOW_S = 2.0
"""Work that takes longer is timed once: what disturbs it averages out."""
_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_CAN_TELL = _STATUS.exists() and _RESET.exists()


def cost_of(function: Callable[[], object], repeats: int) -> tuple[float, float, float]:
    """Of work that is run `repeats` times, or once where it is slow.

    Seconds of the processor, all threads together, the least: what else the machine does hardly counts, nor does
    waiting for the disk. Then MB by which the resident set rose above what it was before, and to which, at most; NaN
    where the system does not tell.
    """
    costs: list[tuple[float, float, float]] = []
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if os.name == "posix" else None
    while len(costs) < max(repeats, 1) and not (costs and costs[-1][0] > _SLOW_S):
        # free what earlier work left behind, which an allocator would use again unseen, and reset the peak
        gc.collect()
        if trim is not None:
            trim(0)
        if _CAN_TELL:
            _RESET.write_text("5")
        before = resident_MB("VmRSS")
        seconds = processor_seconds(function, 0)
        peak = resident_MB("VmHWM")
        costs.append((seconds, peak - before, peak))
    every = np.array(costs)
    return float(every[:, 0].min()), *every[:, 1:].max(axis=0).tolist()


def resident_MB(which: str) -> float:
    """The resident set now (VmRSS), or its highest since that was last reset (VmHWM)."""
    if not _CAN_TELL:
        return float("nan")
    lines = _STATUS.read_text().splitlines()
    return next(float(line.split()[1]) * 1024e-6 for line in lines if line.startswith(f"{which}:"))


_LEAST = 3
"""Sizes that an exponent is fitted to, at least."""
_MARGIN = 0.15
"""An exponent is worse than expected where it exceeds that by so much and by two of its standard deviations."""


@dataclass(frozen=True)
class Power:
    """cost = at_one · size^exponent over the sizes from `smallest` on; `std` is the exponent's, by the scatter."""

    exponent: float = np.nan
    std: float = np.nan
    at_one: float = np.nan
    smallest: float = np.nan

    def worse_than(self, expected: float) -> bool:
        """Whether the cost grows faster than it should."""
        return bool(self.exponent - expected > max(_MARGIN, 2.0 * self.std))

    def __str__(self) -> str:
        return f"{self.exponent:.2f} ± {self.std:.2f}" if np.isfinite(self.exponent) else "–"


def fitted(sizes: np.ndarray, costs: np.ndarray) -> Power:
    """The straight line through logarithms, over the upper half of the sizes, three at least.

    What every call costs, however small, hides the growth at the lower end. Costs that are not positive say nothing;
    with fewer than three left all is NaN.
    """
    known = np.isfinite(costs) & (costs > 0.0)
    if known.sum() < _LEAST:
        return Power()
    upper = np.argsort(sizes[known])[-max(_LEAST, (int(known.sum()) + 1) // 2) :]
    x, y = np.log(sizes[known][upper]), np.log(costs[known][upper])
    line = linregress(x, y)
    return Power(float(line.slope), float(line.stderr), float(np.exp(line.intercept)), float(np.exp(x.min())))


@dataclass(frozen=True)
class Series:
    """One kind of work.

    name, unit : what grows. sizes, quick : how far it is followed; none: not with --quick.
    prepare : size and seed → what is timed; what comes before is not.
    allowed : the largest exponents of time and memory that are all right; why, benchmarks/README.md says.
    """

    name: str
    unit: str
    sizes: tuple[int, ...]
    quick: tuple[int, ...]
    prepare: Callable[[int, int], work.Work]
    allowed: tuple[float, float] = (1.0, 1.0)


SERIES = (
    Series(
        "frames, streamed",
        "frames",
        (100, 300, 1_000, 3_000, 10_000, 100_000),
        (40, 80, 160, 320, 640),
        work.recording_of_frames,
    ),
    Series(
        "points per frame",
        "points",
        (10, 30, 100, 300, 1_000, 3_000, 10_000),
        (10, 30, 100, 300, 1_000),
        work.batch_of_points,
    ),
    Series("picture size", "kpx", (100, 300, 1_000, 3_000, 8_000, 20_000), (100, 200, 400, 800), work.one_picture),
    Series("views, lens", "views", (5, 10, 20, 50, 100, 200), (5, 10, 20), work.lens_solve),
    Series("stills, joint solve", "stills", (15, 30, 60, 120), (8, 12, 18), work.joint_solve),
    Series(
        "contacts, surface",
        "contacts",
        (60, 90, 130, 190, 270, 380, 500),
        (40, 60, 90, 130),
        work.surface_of_contacts,
        (3.0, 2.0),
    ),
    Series(
        "contacts, everything felt", "contacts", (100, 300, 1_000, 3_000, 10_000, 30_000), (), work.object_of_contacts
    ),
)
_GRAIN_MB = 8.0
"""Rises below this say more of the allocator than of the work."""


@dataclass(frozen=True)
class Row:
    """One size of one series: its cost, and the series' exponents with the largest that are all right."""

    series: str
    unit: str
    size: int
    seconds: float
    risen_MB: float
    peak_MB: float
    time_exponent: float
    time_exponent_std: float
    time_allowed: float
    memory_exponent: float
    memory_exponent_std: float
    memory_allowed: float


@dataclass(frozen=True, eq=False)
class Grown:
    """A series as it was measured: at `sizes` (K,) the costs (K, 3) of `cost_of`, and what is fitted to them."""

    series: Series
    sizes: np.ndarray
    costs: np.ndarray
    time: Power
    memory: Power

    @property
    def shown_MB(self) -> np.ndarray:
        """(K,) the rise where it is more than the allocator's grain, else NaN."""
        return _beyond_grain(self.costs)

    @property
    def fits(self) -> tuple[tuple[Power, float], tuple[Power, float]]:
        """Of time and memory, each with the largest exponent that is all right."""
        return (self.time, self.series.allowed[0]), (self.memory, self.series.allowed[1])

    @property
    def worse(self) -> bool:
        """Whether either grows faster than it should."""
        return any(fit.worse_than(most) for fit, most in self.fits)

    def rows(self) -> list[Row]:
        """Of growth.csv."""
        series, fits = self.series, [each for fit, most in self.fits for each in (fit.exponent, fit.std, most)]
        pairs = zip(self.sizes.tolist(), self.costs.tolist(), strict=True)
        return [Row(series.name, series.unit, size, *cost, *fits) for size, cost in pairs]


def _beyond_grain(costs: np.ndarray) -> np.ndarray:
    return np.where(costs[:, 1] >= _GRAIN_MB, costs[:, 1], np.nan)


def follow(series: Series, sizes: Sequence[int], seed: int, repeats: int) -> Grown:
    """The smallest size runs once before the first: what is loaded and kept for ever does not count."""
    series.prepare(sizes[0], seed)()
    costs, at = np.array([cost_of(series.prepare(size, seed), repeats) for size in sizes]), np.array(sizes)
    return Grown(series, at, costs, fitted(at, costs[:, 0]), fitted(at, _beyond_grain(costs)))


def as_text(grown: Sequence[Grown]) -> str:
    """A line for each series."""
    lines = [["", "sizes", "seconds", "e, time", "≤", "MB", "e, memory", "≤", ""]]
    for each in grown:
        series = each.series
        cells = [f"{each.sizes[0]} to {each.sizes[-1]} {series.unit}"]
        for values, (fit, most) in zip(each.costs.T, each.fits, strict=False):
            cells += [f"{values[0]:.3g} to {values[-1]:.3g}", str(fit), f"{most:.1f}"]
        lines.append([series.name, *cells, "WORSE" if each.worse else ""])
    title = "cost ∝ sizeᵉ, e ± std over the upper half; seconds of the processor; MB: rise of the resident set"
    return aligned(lines, [True] + [False] * 7 + [True], title)


def _figure(grown: Sequence[Grown]) -> Figure:
    drawn, every = panels(len(grown), 4, (4.1, 3.5))
    for each, panel in zip(grown, every, strict=True):
        _panel(panel, each)
    return drawn


def _panel(panel: Axes, each: Grown) -> None:
    """Seconds on the left, MB on the right, where they are more than the allocator's grain."""
    series, beside = each.series, panel.twinx()
    drawn = (panel, each.costs[:, 0], GREEN, "o", "time"), (beside, each.shown_MB, AMBER, "s", "memory")
    for (axes, values, colour, mark, name), (power, most) in zip(drawn, each.fits, strict=True):
        axes.loglog(each.sizes, values, mark, color=colour, ms=4.5)
        axes.tick_params(axis="y", colors=colour, which="both")
        words = f"{name}: up to {np.nanmax(values, initial=0.0):.3g}"
        if np.isfinite(power.exponent):
            words = f"{name}: e = {power}, allowed {most:g}"
            ends = np.array([power.smallest, each.sizes.max()])
            axes.plot(ends, power.at_one * ends**power.exponent, "-", color=colour, lw=1.3)
        panel.plot([], [], f"-{mark}", color=colour, ms=4.5, label=words)
        known = values[np.isfinite(values) & (values > 0.0)]
        if len(known):  # room for the legend
            axes.set_ylim(known.min() / 2.0, 25.0 * known.max())
    beside.yaxis.set_visible(bool(np.isfinite(each.shown_MB).any()))
    label(panel, series.name + (", worse than it should" if each.worse else ""), series.unit)
    panel.set_xticks([each.sizes[0], each.sizes[len(each.sizes) // 2], each.sizes[-1]])
    panel.xaxis.set_major_formatter("{x:,.0f}")
    panel.xaxis.set_minor_formatter("")
    panel.set_ylabel("seconds of the processor", color=GREEN)
    beside.set_ylabel("rise of the resident set, MB", color=AMBER)
    panel.legend(loc="upper left", fontsize=8, frameon=False)


def measure(options: Options) -> Findings:
    """Every series; a draw is a timing of each size, of which the least counts."""
    chosen = [(series, series.quick if options.quick else series.sizes) for series in SERIES]
    asked = [(series, sizes) for series, sizes in chosen if sizes]
    grown = [follow(*each, options.seed, options.draws) for each in progress(asked, "growth", len(asked))]
    skipped = "".join(f"\n{series.name}: not with --quick" for series, sizes in chosen if not sizes)
    worse = ", ".join(each.series.name for each in grown if each.worse)
    rows = [row for each in grown for row in each.rows()]
    return Findings(
        as_text(grown) + skipped,
        {"growth.csv": rows},
        {"growth.png": lambda: _figure(grown)},
        {"rows": rows},
        f"grows faster than it should: {worse}"
        if worse
        else f"{len(grown)} kinds of work, none grows faster than it should",
    )
