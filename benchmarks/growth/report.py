"""How the cost grows with the work: frames, points, pixels, views, contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.harness import new_figure, save

from .growth import GRAIN_MB, Grown, Power

if TYPE_CHECKING:
    from matplotlib.axes import Axes
from functools import partial

from benchmarks.harness import Findings, Options
from vbaa_calib.core.console import progress

from .growth import SERIES, follow


@dataclass(frozen=True)
class GrowthRow:
    """One size of one series.

    Attributes
    ----------
    seconds : of the processor, least of several timings.
    risen_MB, peak_MB : of the resident set; None where the system does not tell.
    time_exponent, time_exponent_std, memory_exponent, memory_exponent_std : of the series, over its upper half.
    time_allowed, memory_allowed : the largest exponents that are all right.
    """

    series: str
    unit: str
    size: int
    seconds: float
    risen_MB: float | None
    peak_MB: float | None
    time_exponent: float | None
    time_exponent_std: float | None
    time_allowed: float
    memory_exponent: float | None
    memory_exponent_std: float | None
    memory_allowed: float


def as_rows(grown: Sequence[Grown]) -> list[GrowthRow]:
    """Every size of every series."""
    return [
        GrowthRow(
            series=each.series.name,
            unit=each.series.unit,
            size=size,
            seconds=cost.seconds,
            risen_MB=_known(cost.risen_MB),
            peak_MB=_known(cost.peak_MB),
            time_exponent=_known(each.time.exponent),
            time_exponent_std=_known(each.time.std),
            time_allowed=each.series.time_exponent,
            memory_exponent=_known(each.memory.exponent),
            memory_exponent_std=_known(each.memory.std),
            memory_allowed=each.series.memory_exponent,
        )
        for each in grown
        for size, cost in zip(each.sizes, each.costs, strict=True)
    ]


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def table(grown: Sequence[Grown]) -> str:
    """A line for each series."""
    lines = [
        "cost ∝ sizeᵉ, e ± std over the upper half; seconds of the processor; MB: rise of the resident set",
        f"{'':25s} {'sizes':>22s}  {'seconds':>15s} {'e, time':>13s} {'≤':>4s} {'MB':>11s} {'e, memory':>13s}    ≤",
    ]
    for each in grown:
        series, ends = each.series, f"{each.sizes[0]} to {each.sizes[-1]} {each.series.unit}"
        seconds = f"{each.seconds[0]:.3g} to {each.seconds[-1]:.3g}"
        memory = f"{each.risen_MB[0]:.0f} to {each.risen_MB[-1]:.0f}"
        lines.append(
            f"{series.name:25s} {ends:>22s}  {seconds:>15s} {told(each.time):>13s} {series.time_exponent:4.1f} "
            f"{memory:>11s} {told(each.memory):>13s} {series.memory_exponent:4.1f}{'  WORSE' if each.worse else ''}"
        )
    return "\n".join([*lines, "", *(f"{each.series.name}: {each.series.why}" for each in grown)])


def told(power: Power) -> str:
    """An exponent with its deviation."""
    return f"{power.exponent:.2f} ± {power.std:.2f}" if np.isfinite(power.exponent) else "–"


def numbers(grown: Sequence[Grown]) -> dict[str, Any]:
    """For --json."""
    return {
        each.series.name: {
            "sizes": list(each.sizes),
            "seconds": each.seconds.tolist(),
            "risen_MB": each.risen_MB.tolist(),
            "time_exponent": each.time.exponent,
            "time_exponent_std": each.time.std,
            "memory_exponent": each.memory.exponent,
            "memory_exponent_std": each.memory.std,
            "worse": each.worse,
        }
        for each in grown
    }


TIME, MEMORY = "#0f766e", "#b45309"
ACROSS = 4


def write_figure(grown: Sequence[Grown], path: Path, force: bool) -> None:
    """All series."""
    down = -(-len(grown) // ACROSS)
    figure = new_figure(4.1 * min(ACROSS, len(grown)), 3.5 * down)
    panels = figure.subplots(down, min(ACROSS, len(grown)), squeeze=False).ravel()
    for each, panel in zip(grown, panels, strict=False):
        _panel(panel, each)
    for panel in panels[len(grown) :]:
        panel.set_axis_off()
    save(figure, path, force)


def _panel(panel: Axes, each: Grown) -> None:
    """Seconds on the left, MB on the right, where they are more than the allocator's grain."""
    series, beside = each.series, panel.twinx()
    grown_MB = np.where(each.risen_MB >= GRAIN_MB, each.risen_MB, np.nan)
    for axes, values, power, most, colour, mark, name in (
        (panel, each.seconds, each.time, series.time_exponent, TIME, "o", "time"),
        (beside, grown_MB, each.memory, series.memory_exponent, MEMORY, "s", "memory"),
    ):
        axes.loglog(each.sizes, values, mark, color=colour, ms=4.5)
        axes.tick_params(axis="y", colors=colour, which="both")
        _line(axes, each.sizes, power, colour)
        words = f"{name}: e = {told(power)}, allowed {most:g}"
        if not np.isfinite(power.exponent):
            words = f"{name}: up to {np.nanmax(each.risen_MB, initial=0.0):.0f} MB" if axes is beside else name
        panel.plot([], [], f"-{mark}", color=colour, ms=4.5, label=words)
        known = values[np.isfinite(values) & (values > 0.0)]
        if len(known):  # room for the legend
            axes.set_ylim(known.min() / 2.0, 25.0 * known.max())
    beside.yaxis.set_visible(bool(np.isfinite(grown_MB).any()))
    panel.set_title(series.name + (", worse than it should" if each.worse else ""), fontsize=10)
    panel.set_xticks([each.sizes[0], each.sizes[len(each.sizes) // 2], each.sizes[-1]])
    panel.xaxis.set_major_formatter("{x:,.0f}")
    panel.xaxis.set_minor_formatter("")
    panel.set_xlabel(series.unit)
    panel.set_ylabel("seconds of the processor", color=TIME)
    beside.set_ylabel("rise of the resident set, MB", color=MEMORY)
    panel.legend(loc="upper left", fontsize=8, frameon=False)
    panel.grid(True, which="major", color="#e5e7eb", lw=0.7)


def _line(axes: Axes, sizes: Sequence[int], power: Power, colour: str) -> None:
    if np.isfinite(power.exponent):
        ends = np.array([power.smallest, float(max(sizes))])
        axes.plot(ends, power.at(ends), "-", color=colour, lw=1.3)


def measure(options: Options) -> Findings:
    """Every series; a draw is a timing of each size, of which the least counts."""
    work = [(series, series.quick if options.quick else series.sizes) for series in SERIES]
    asked = [(series, sizes) for series, sizes in work if sizes]
    grown = [
        follow(series, sizes, options.seed, options.draws) for series, sizes in progress(asked, "growth", len(asked))
    ]
    left_out = "".join(f"\n{series.name}: not with --quick" for series, sizes in work if not sizes)
    worse = [each.series.name for each in grown if each.worse]
    said = f"{len(grown)} kinds of work, none grows faster than it should"
    return Findings(
        text=table(grown) + left_out,
        tables={"growth.csv": as_rows(grown)},
        figures={"growth.png": partial(write_figure, grown)},
        numbers=numbers(grown),
        headline=said if not worse else f"grows faster than it should: {', '.join(worse)}",
    )
