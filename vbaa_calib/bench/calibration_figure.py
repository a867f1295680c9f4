"""Lens solves as a figure: time of one against the error that it leaves on plane C."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .calibration_run import Row
from .figures import new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STYLES = {
    "oracle": ("#334155", "*"),
    "ours, auto": ("#0f766e", "s"),
    "ours, lens given": ("#14b8a6", "s"),
    "OpenCV, default": ("#b45309", "o"),
    "OpenCV, 300 iterations": ("#f59e0b", "o"),
    "mrcal": ("#6d28d9", "^"),
    "lensboy": ("#be123c", "D"),
}
"""Method → its colour and mark."""
COLUMNS = 3


def write_figure(path: Path, rows: Sequence[Row], draws: int, force: bool) -> None:
    """One panel per rig, both axes logarithmic; full marks with C's pose told, hollow ones with its pose solved."""
    from matplotlib.lines import Line2D

    names = list(dict.fromkeys(row.rig for row in rows))
    lines = len(names) // COLUMNS + 1
    figure = new_figure(11, 3.1 * lines)
    panels = figure.subplots(lines, COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    for name, panel in zip(names, panels, strict=False):
        for row in rows:
            if row.rig == name and row.seconds is not None:
                _marks(panel, row)
        panel.set_title(name, fontsize=9)
        panel.grid(alpha=0.3)
    for index in range(len(names), len(panels)):
        panels[index].set_axis_off()
        panels[index - COLUMNS].tick_params(labelbottom=True)
    there = {row.method for row in rows if row.seconds is not None}
    handles = [
        Line2D([], [], ls="", marker=mark, color=colour, label=method)
        for method, (colour, mark) in STYLES.items()
        if method in there
    ]
    handles.append(
        Line2D([], [], ls="", marker="s", color="#334155", fillstyle="none", label="hollow: pose of C solved")
    )
    panels[-1].legend(handles=handles, loc="center", fontsize=9, title=f"median of {draws} draws")
    figure.supxlabel("time of one solve, s")
    figure.supylabel("rms error of points on plane C, mm")
    save(figure, path, force)


def _marks(panel: Axes, row: Row) -> None:
    colour, mark = STYLES[row.method]
    for error, fill in ((row.error_mm, "full"), (row.jig_error_mm, "none")):
        if error is not None:
            panel.loglog(row.seconds, error, mark, color=colour, fillstyle=fill, markersize=7)
