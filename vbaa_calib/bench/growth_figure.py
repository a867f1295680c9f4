"""Time and memory over the size of the work, a panel for each kind, with the fitted lines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .figures import new_figure, save
from .growth_fit import Power
from .growth_follow import Grown
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
    """Seconds on the left, MB on the right."""
    series = each.series
    beside = panel.twinx()
    for axes, values, power, most, colour, mark, name in (
        (panel, each.seconds, each.time, series.time_exponent, TIME, "o", "time"),
        (beside, each.risen_MB, each.memory, series.memory_exponent, MEMORY, "s", "memory"),
    ):
        shown = np.where(values > 0.0, values, np.nan)
        axes.loglog(each.sizes, shown, mark, color=colour, ms=4.5)
        axes.tick_params(axis="y", colors=colour, which="both")
        _line(axes, each.sizes, power, colour)
        panel.plot([], [], f"-{mark}", color=colour, ms=4.5, label=f"{name}: e = {told(power)} (≤ {most:g})")
        low, high = np.nanmin(shown, initial=np.inf), np.nanmax(shown, initial=0.0)
        if high > 0.0:  # room for the legend, and a decade at least
            axes.set_ylim(low / 2.0, max(20.0 * high, 20.0 * low))
    panel.set_title(series.name + (", worse than it should" if each.worse else ""), fontsize=10)
    panel.set_xlabel(series.unit)
    panel.set_ylabel("seconds of the processor", color=TIME)
    beside.set_ylabel("rise of the resident set, MB", color=MEMORY)
    panel.legend(loc="upper left", fontsize=8, frameon=False)
    panel.grid(True, which="major", color="#e5e7eb", lw=0.7)


def _line(axes: Axes, sizes: Sequence[int], power: Power, colour: str) -> None:
    if np.isfinite(power.exponent):
        ends = np.array([power.smallest, float(max(sizes))])
        axes.plot(ends, power.at(ends), "-", color=colour, lw=1.3)
