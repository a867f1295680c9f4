"""The headline's figure: time a picture over error, between the two walls."""

from __future__ import annotations

from collections.abc import Sequence
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.core.files import replacing

from .methods import CLASSIC, LINE, LOOP, ONE_LOOK, OURS, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .chain import ChainRow

STYLES = {
    OURS: ("#0f766e", "s"),
    ONE_LOOK: ("#0f766e", "P"),
    LOOP: ("#64748b", "D"),
    PAPER: ("#b45309", "o"),
    LINE: ("#6d28d9", "^"),
    CLASSIC: ("#1d4ed8", "v"),
}
"""Of each family of methods: its colour and mark."""
WALL, ON_WALL = "#e2e8f0", "#334155"
SHORT = {
    "two points, camera A": "camera A",
    "two points, camera B": "camera B",
    "two points on the straight part": "straight part, told",
    "elastica by least_squares": "elastica",
    "skeleton, two points": "skeleton, two",
    "skeleton, least_squares": "skeleton, SciPy",
    "centroids, two points": "centroids, two",
    "centroids, least_squares": "centroids, SciPy",
    "auto, one look": "one look",
}
"""Names that the legend makes clear are shortened."""
ALIKE = 1.25, 2.0
"""Rungs whose errors and times differ by no more than these factors share a label."""
CHARACTER, LINE_HEIGHT, MARK = 0.045, 0.22, 0.09
"""Room for text and marks, in decades of the axes."""

Box = tuple[float, float, float, float]
"""Least and most of error and time, in decades."""


def write_figure(path: Path, rows: Sequence[ChainRow], force: bool) -> None:
    """One panel for each picture size and rig; full marks a picture that comes alone, hollow ones in a recording."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    shown = [row for row in rows if row.l_rms_mm is not None]
    cells = list(dict.fromkeys((row.size, row.rig) for row in rows))
    lines = -(-len(cells) // 2)
    figure = Figure(figsize=(12, 4.6 * lines + 0.7), layout="constrained")
    panels = figure.subplots(lines, min(2, len(cells)), sharex=True, sharey=True, squeeze=False).ravel()
    furthest = max([row.l_rms_mm or 0.0 for row in shown], default=1.0)
    for cell, panel in zip(cells, panels, strict=False):
        own = [row for row in rows if (row.size, row.rig) == cell]
        _walls(panel, own[0])
        _marks(panel, [row for row in own if row.l_rms_mm is not None])
        panel.set_title(f"{cell[0]}, rig {'exactly known' if cell[1] == 'exact' else 'as calibrated'}", fontsize=11)
        panel.grid(alpha=0.3)
        panel.label_outer()
    for panel in panels[-2:]:
        panel.set_xlabel("rms error of the contact distance, mm", fontsize=10)
    nearest = min([row.bound_mm for row in rows] + [row.l_rms_mm or 1.0 for row in shown])
    panels[0].set_xlim(0.35 * nearest, 8.0 * furthest)
    panels[0].set_ylim(0.35 * min(row.read_ms for row in rows), 8.0 * max([row.ms for row in shown], default=1.0))
    marks = [Line2D([], [], ls="", marker=mark, color=colour, label=name) for name, (colour, mark) in STYLES.items()]
    marks.append(
        Line2D(
            [],
            [],
            ls="",
            marker="s",
            color=ON_WALL,
            markerfacecolor="none",
            label="hollow: in a recording; bars: one standard error of the rms",
        )
    )
    figure.legend(handles=marks, loc="outside lower center", ncols=4, fontsize=9)
    figure.supylabel("processor time per picture, ms", fontsize=11)
    with replacing(path, force) as temporary:
        figure.savefig(temporary, dpi=110)


def _walls(panel: Axes, row: ChainRow) -> None:
    """Left of the bound and below the reading of the picture nothing can be."""
    panel.axvspan(1e-9, row.bound_mm, color=WALL, lw=0)
    panel.axhspan(1e-9, row.read_ms, color=WALL, lw=0)
    panel.axvline(row.bound_mm, color=ON_WALL, lw=1.2)
    panel.axhline(row.read_ms, color=ON_WALL, lw=1.2)
    beside: dict[str, Any] = {"fontsize": 8, "color": ON_WALL}
    panel.annotate(
        f"Cramér–Rao bound, {row.bound_mm:.2f} mm",
        (row.bound_mm, 0.4),
        xycoords=("data", "axes fraction"),
        xytext=(-4, 0),
        textcoords="offset points",
        rotation=90,
        ha="right",
        va="center",
        **beside,
    )
    panel.annotate(
        f"the picture read once from memory, {row.read_ms:.3f} ms",
        (0.98, row.read_ms),
        xycoords=("axes fraction", "data"),
        xytext=(0, -4),
        textcoords="offset points",
        ha="right",
        va="top",
        **beside,
    )


def _marks(panel: Axes, rows: Sequence[ChainRow]) -> None:
    taken: list[Box] = []
    for row in rows:
        colour, mark = STYLES[row.family]
        error = row.l_rms_mm or 0.0
        scatter = (row.l_rms_error_mm or 0.0) / error
        panel.loglog([error, error], [row.ms, row.ms_recording], color=colour, lw=0.7)
        panel.loglog([error * (1 - scatter), error * (1 + scatter)], [row.ms, row.ms], color=colour, lw=1.0, alpha=0.5)
        panel.loglog(error, row.ms_recording, mark, color=colour, markerfacecolor="white", markersize=6)
        panel.loglog(error, row.ms, mark, color=colour, markersize=6)
        taken += [_around(error, ms) for ms in (row.ms, row.ms_recording)]
    for group in _alike(rows):
        colour, _ = STYLES[group[0].family]
        name = ", ".join(SHORT.get(row.method, row.method) for row in group)
        at = max(row.l_rms_mm or 0.0 for row in group), group[0].ms
        box = _free_place(at, name, taken)
        taken.append(box)
        label = panel.annotate(
            name,
            at,
            xytext=(10.0 ** box[0], 10.0 ** ((box[2] + box[3]) / 2)),
            arrowprops={"arrowstyle": "-", "lw": 0.4, "color": colour},
            va="center",
            fontsize=8,
            color=colour,
        )
        label.set_in_layout(False)


def _alike(rows: Sequence[ChainRow]) -> list[list[ChainRow]]:
    """The rows, this library's rungs that stand at one place together."""
    groups: list[list[ChainRow]] = []
    for row in rows:
        for group in groups:
            first = group[0]
            together = first.family == row.family == OURS
            near = abs(log10((row.l_rms_mm or 0.0) / (first.l_rms_mm or 0.0))) < log10(ALIKE[0])
            if together and near and abs(log10(row.ms / first.ms)) < log10(ALIKE[1]):
                group.append(row)
                break
        else:
            groups.append([row])
    return groups


def _around(error: float, ms: float) -> Box:
    return log10(error) - MARK, log10(error) + MARK, log10(ms) - MARK, log10(ms) + MARK


def _free_place(at: tuple[float, float], name: str, taken: Sequence[Box]) -> Box:
    """Room for a name right of a mark, as little above or below it as the boxes before allow."""
    left, middle = log10(at[0]) + 1.5 * MARK, log10(at[1])
    box = left, left, middle, middle
    for step in range(40):
        low = middle + (-1) ** step * ((step + 1) // 2) * 0.5 * LINE_HEIGHT - 0.5 * LINE_HEIGHT
        box = left, left + CHARACTER * len(name), low, low + LINE_HEIGHT
        if not any(_overlap(box, other) for other in taken):
            break
    return box


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[1] and other[0] < one[1] and one[2] < other[3] and other[2] < one[3]
