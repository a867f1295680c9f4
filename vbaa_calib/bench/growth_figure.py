"""Time and memory over the size of the work, a panel for each kind, with the fitted lines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .figures import new_figure, save
from .growth_fit import Power
from .growth_follow import GRAIN_MB, Grown
from .growth_report import told

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
