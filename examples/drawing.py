"""What the examples share: figures for who asks for them (`python examples/01_... --figures DIR`), all in one look."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("agg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, RED, GREY, DARK = "#0b6ea8", "#d1730f", "#2c8a4b", "#c0392b", "#9aa3ab", "#2b3036"
STYLE: dict[Any, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": DARK,
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "grid.color": "#e3e6e8",
    "legend.fontsize": 8.0,
    "legend.framealpha": 0.9,
    "savefig.dpi": 110,
}


def figures_folder() -> Path | None:
    """The folder that `--figures` names; None: print only."""
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--figures", type=Path, metavar="DIR", help="folder for the figure (default: print only)")
    folder: Path | None = parser.parse_args().figures
    return folder


def canvas(columns: int = 1, height_in: float = 3.3, **options: Any) -> tuple[Figure, Any]:
    """A figure as wide as a page of the documentation, and its panels side by side."""
    with plt.rc_context(STYLE):
        return plt.subplots(1, columns, figsize=(8.6, height_in), **options)


def save(figure: Figure, folder: Path, example: str) -> None:
    """Write the figure under its example's name. `example` is the example's `__file__`."""
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        figure.savefig(folder / f"{Path(example).stem}.png")
    plt.close(figure)
