"""The headline's figure: time a picture over error, between the two limits."""

from __future__ import annotations

from collections.abc import Sequence
from math import log10
from typing import TYPE_CHECKING

from benchmarks.figures import AMBER, BLUE, GREEN, GREY, INK, SHADE, VIOLET, label, legend, name_points, panels

from .methods import CLASSIC, LINE, LOOP, ONE_LOOK, OURS, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .chain import ChainRow

_STYLES = {
    OURS: (GREEN, "s"),
    ONE_LOOK: (GREEN, "P"),
    LOOP: (GREY, "D"),
    PAPER: (AMBER, "o"),
    LINE: (VIOLET, "^"),
    CLASSIC: (BLUE, "v"),
}
"""Of each family of methods: its colour and mark."""
_ALIKE = 1.25, 2.0
"""Rungs whose errors and times differ by no more than these factors share a label."""


def figure(rows: Sequence[ChainRow]) -> Figure:
    """One panel for each picture size and rig; full marks a picture that comes alone, hollow ones in a recording."""
    shown = [row for row in rows if row.l_rms_mm is not None]
    cells = list(dict.fromkeys((row.size, row.rig) for row in rows))
    drawn, every = panels(len(cells), 2, (6, 4.9), sharex=True, sharey=True)
    for cell, panel in zip(cells, every, strict=True):
        own = [row for row in rows if (row.size, row.rig) == cell]
        _limits(panel, own[0])
        _marks(panel, [row for row in own if row.l_rms_mm is not None])
        label(panel, f"{cell[0]}, rig {'exactly known' if cell[1] == 'exact' else 'as calibrated'}")
    least = min([row.bound_mm for row in rows] + [row.l_rms_mm or 1.0 for row in shown])
    every[0].set_xlim(0.35 * least, 8.0 * max([row.l_rms_mm or 0.0 for row in shown], default=1.0))
    every[0].set_ylim(0.35 * min(row.read_ms for row in rows), 8.0 * max([row.ms for row in shown], default=1.0))
    legend(drawn, _STYLES, "hollow: in a recording; bars: one standard error of the rms", columns=4)
    drawn.supxlabel("rms error of the contact distance, mm")
    drawn.supylabel("processor time per picture, ms")
    return drawn


def _limits(panel: Axes, row: ChainRow) -> None:
    """Left of the bound and below the reading of the picture nothing can be."""
    panel.axvspan(1e-9, row.bound_mm, color=SHADE, lw=0)
    panel.axhspan(1e-9, row.read_ms, color=SHADE, lw=0)
    panel.axvline(row.bound_mm, color=INK, lw=1.2)
    panel.axhline(row.read_ms, color=INK, lw=1.2)
    across, along = panel.get_xaxis_transform(), panel.get_yaxis_transform()
    bound = f"Cramér–Rao bound, {row.bound_mm:.2f} mm "
    panel.text(row.bound_mm, 0.4, bound, rotation=90, ha="right", va="center", transform=across, fontsize=8, color=INK)
    read = f"the picture read once from memory, {row.read_ms:.3f} ms"
    panel.text(0.98, 0.8 * row.read_ms, read, ha="right", va="top", transform=along, fontsize=8, color=INK)


def _marks(panel: Axes, rows: Sequence[ChainRow]) -> None:
    groups: list[list[ChainRow]] = []
    for row in rows:
        colour, mark = _STYLES[row.family]
        error = row.l_rms_mm or 0.0
        scatter = (row.l_rms_error_mm or 0.0) / error
        panel.loglog([error, error], [row.ms, row.ms_recording], color=colour, lw=0.7)
        panel.loglog([error * (1 - scatter), error * (1 + scatter)], [row.ms, row.ms], color=colour, lw=1.0, alpha=0.5)
        panel.loglog(error, row.ms_recording, mark, color=colour, markerfacecolor="white", markersize=6)
        panel.loglog(error, row.ms, mark, color=colour, markersize=6)
        alike = next((group for group in groups if _together(group[0], row)), None)
        if alike is None:
            groups.append([row])
        else:
            alike.append(row)
    names = [", ".join(row.method for row in group) for group in groups]
    at = [(max(row.l_rms_mm or 0.0 for row in group), group[0].ms, _STYLES[group[0].family][0]) for group in groups]
    name_points(panel, [(name, *place) for name, place in zip(names, at, strict=True)], gap=1.5)


def _together(one: ChainRow, other: ChainRow) -> bool:
    near = abs(log10((one.l_rms_mm or 0.0) / (other.l_rms_mm or 0.0))) < log10(_ALIKE[0])
    return one.family == other.family == OURS and near and abs(log10(one.ms / other.ms)) < log10(_ALIKE[1])
