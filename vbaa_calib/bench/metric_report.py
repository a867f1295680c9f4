"""What the metric benchmark leaves: a table for the terminal, a CSV, a figure."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from ..files import replacing, write_text
from .metric import Row


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


def write_csv(path: Path, rows: Sequence[Row], force: bool) -> None:
    """One line per row, SI-free: pixels, fractions, milliseconds."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=[field.name for field in fields(Row)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    write_text(path, text.getvalue(), force)


def write_figure(path: Path, rows: Sequence[Row], points: int, force: bool) -> None:
    """Error over time per point, one panel per lens, both logarithmic."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(row.lens for row in rows))
    figure = Figure(figsize=(11, 2.6 * ((len(names) + 2) // 3)), layout="constrained")
    panels = figure.subplots((len(names) + 2) // 3, 3, sharex=True, sharey=True).ravel()
    colours = {"this": "#0f766e", "OpenCV": "#b45309", "kornia": "#6d28d9"}
    for name, panel in zip(names, panels, strict=False):
        for row in rows:
            if row.lens == name:
                colour = colours[row.method.replace(",", "").split()[0]]
                x, y = 1e6 * row.batch_ms / points, max(row.error_px, 1e-14)
                panel.loglog(x, y, "o", color=colour, markersize=5)
                label = row.method.removeprefix("this layer").strip(", ").replace(" steps", "") or "this layer"
                panel.annotate(label, (x, y), xytext=(4, 3), textcoords="offset points", fontsize=6, color=colour)
        panel.set_title(name, fontsize=9)
        panel.grid(alpha=0.3)
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    figure.supxlabel("time, ns per point")
    figure.supylabel("largest error, px")
    with replacing(path, force) as temporary:
        figure.savefig(temporary, dpi=110)
