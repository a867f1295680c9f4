"""What the metric benchmark leaves: a table for the terminal, a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .figures import new_figure, save
from .metric_run import Row


def as_text(rows: Sequence[Row], points: int) -> str:
    """The table for people."""
    head = (
        f"{'lens':<18}{'method':<24}{'error px':>10}{'silent %':>10}{'marked %':>10}{'ms':>9}{'× ours':>8}{'200 ms':>8}"
    )
    lines = [f"{points} pixels over the whole picture; silent: wrong by over 0.001 px and not marked", head]
    lens = ""
    for row in rows:
        shown, lens = (row.lens if row.lens != lens else ""), row.lens
        lines.append(
            f"{shown:<18}{row.method:<24}{row.error_px:>10.1e}{100 * row.silent:>10.2f}{100 * row.marked:>10.2f}"
            f"{row.batch_ms:>9.1f}{row.ratio:>8.2f}{row.live_ms:>8.3f}"
        )
    return "\n".join(lines)


FAMILIES = {"this layer": ("#0f766e", "s", 3), "OpenCV": ("#b45309", "o", 7), "kornia": ("#6d28d9", "^", -10)}
"""Of each family of methods: its colour, its mark, and how far above it (points) its number of steps stands."""


def write_figure(path: Path, rows: Sequence[Row], points: int, force: bool) -> None:
    """Error over time per point, one panel per lens, both logarithmic."""
    from matplotlib.lines import Line2D

    names = list(dict.fromkeys(row.lens for row in rows))
    lines = (len(names) + 2) // 3
    figure = new_figure(11, 2.6 * lines)
    panels = figure.subplots(lines, 3, sharex=True, sharey=True).ravel()
    for name, panel in zip(names, panels, strict=False):
        for row in rows:
            if row.lens == name:
                family, _, detail = row.method.partition(", ")
                colour, mark, above = FAMILIES[family]
                at = 1e6 * row.batch_ms / points, max(row.error_px, 1e-14)
                panel.loglog(*at, mark, color=colour, markersize=5)
                label, shift = detail.removesuffix(" steps"), (4, above)
                panel.annotate(label, at, xytext=shift, textcoords="offset points", fontsize=6, color=colour)
        panel.set_title(name, fontsize=9)
        panel.grid(alpha=0.3)
    for index in range(len(names), len(panels)):
        panels[index].set_visible(False)
        panels[index - 3].tick_params(labelbottom=True)
    marks = [
        Line2D([], [], ls="", marker=mark, color=colour, label=name) for name, (colour, mark, _) in FAMILIES.items()
    ]
    figure.legend(handles=marks, loc="lower right", fontsize=9, title="numbers: steps")
    figure.supxlabel("time, ns per point")
    figure.supylabel("largest error, px")
    save(figure, path, force)
