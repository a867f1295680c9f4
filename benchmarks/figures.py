"""One style for all figures: colours, panels, labels, legends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREEN, AMBER, VIOLET, BLUE, RED, GREY = "#0f766e", "#b45309", "#6d28d9", "#1d4ed8", "#be123c", "#64748b"
COLOURS = (GREEN, AMBER, VIOLET, BLUE, RED, GREY)
INK, SHADE = "#334155", "#e2e8f0"
"""Of lines and words, and of areas behind them."""

Style = tuple[str, str]
"""Colour and mark."""


def panels(count: int, across: int, size_in: tuple[float, float], **shared: Any) -> tuple[Figure, list[Axes]]:
    """A figure of so many panels, each of that size, at most `across` side by side; `shared` as for `subplots`."""
    from matplotlib.figure import Figure

    across = min(across, count)
    down = -(-count // across)
    figure = Figure(figsize=(size_in[0] * across, size_in[1] * down), layout="constrained")
    every = figure.subplots(down, across, squeeze=False, **shared).ravel()
    for index in range(count, len(every)):
        every[index].set_axis_off()
        every[index - across].tick_params(labelbottom=True)
    return figure, list(every[:count])


def label(panel: Axes, title: str = "", x: str = "", y: str = "") -> None:
    """A panel's title, axes and grid."""
    panel.set_title(title, fontsize=10)
    panel.set_xlabel(x)
    panel.set_ylabel(y)
    panel.grid(alpha=0.3)


def legend(figure: Figure, styles: Mapping[str, Style], hollow: str = "", columns: int = 6, title: str = "") -> None:
    """Below a figure: name → its mark; `hollow` : what hollow marks are."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], ls="", marker=mark, color=colour, label=name) for name, (colour, mark) in styles.items()]
    if hollow:
        handles.append(Line2D([], [], ls="", marker="s", color=INK, markerfacecolor="none", label=hollow))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=8, title=title or None)
