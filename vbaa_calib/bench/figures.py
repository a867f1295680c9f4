"""Figures of the benchmarks: made and saved alike, without a window."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 110


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty one whose panels make room for their words."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def save(figure: Figure, path: Path, force: bool) -> None:
    """To a PNG, whole or not at all."""
    with replacing(path, force) as temporary:
        figure.savefig(temporary, dpi=DPI)
