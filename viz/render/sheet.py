"""The picture of a scene: the whole rig, what was touched close up, and what the colours mean, on one sheet."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from viz.parts import Part
from viz.parts.part import INK
from viz.scene.colours import Scale, contact_scale, object_scale
from viz.scene.scene import Scene

DPI = 100
WIDE, TALL = 1900, 1080
LEFT, STRIP = 740, 120
"""Pixels: width of the column with the rig, height of the strip with the scales under the close-up."""
RIG_SIZE, NEAR_SIZE = (LEFT, 700), (WIDE - LEFT, TALL - STRIP)
QUIET = "#64748b"


def compose(
    path: Path,
    scene: Scene,
    parts: list[Part],
    mode: str,
    near: np.ndarray,
    half_height_m: float,
    rig: np.ndarray | None,
) -> None:
    """Write the PNG.

    Parameters
    ----------
    near : the close-up in parallel projection, (H, W, 3) of `NEAR_SIZE`; half_height_m : what half of H shows.
    rig : the overview, of `RIG_SIZE`; None without a rig: the close-up then stands beside the legend alone.
    """
    figure = Figure(figsize=(WIDE / DPI, TALL / DPI), dpi=DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    _picture(figure, near, (LEFT, STRIP))
    if rig is not None:
        _picture(figure, rig, (0, TALL - RIG_SIZE[1]))
    _scale_bar(figure, half_height_m)
    _legend(figure, scene, parts, TALL - RIG_SIZE[1] if rig is not None else TALL)
    bars = [bar for bar in (contact_scale(scene, mode), object_scale(scene)) if bar is not None]
    for index, bar in enumerate(bars):
        _colour_bar(figure, bar, LEFT + 60 + index * 560, 460)
    canvas.print_png(str(path))


def _place(x: float, y: float, width: float, height: float) -> tuple[float, float, float, float]:
    return x / WIDE, y / TALL, width / WIDE, height / TALL


def _picture(figure: Figure, pixels: np.ndarray, corner: tuple[int, int]) -> None:
    height, width = pixels.shape[:2]
    axes = figure.add_axes(_place(*corner, width, height))
    axes.imshow(pixels, interpolation="none")
    axes.axis("off")


def _scale_bar(figure: Figure, half_height_m: float) -> None:
    per_pixel = 2 * half_height_m / NEAR_SIZE[1]
    wanted = 0.16 * NEAR_SIZE[0] * per_pixel
    exponent = 10.0 ** np.floor(np.log10(wanted))
    length = exponent * max(step for step in (1, 2, 5) if step * exponent <= wanted * 1.0001)
    right, y = WIDE - 40, STRIP + 34
    figure.add_artist(
        Line2D(
            [(right - length / per_pixel) / WIDE, right / WIDE],
            [y / TALL] * 2,
            color=INK,
            lw=3.5,
            solid_capstyle="butt",
        )
    )
    figure.text(
        (right - length / per_pixel / 2) / WIDE, (y + 9) / TALL, f"{1e3 * length:g} mm", ha="center", color=INK, size=13
    )


def _legend(figure: Figure, scene: Scene, parts: list[Part], top: int) -> None:
    scaled = ("contacts", "forces", "now", *(["object"] if object_scale(scene) is not None else []))
    rows = list({part.name: part for part in parts if part.name not in scaled}.values())
    labels = {part.name: max((p.label for p in parts if p.name == part.name), key=len) for part in rows}
    labels["antenna"] = "antenna at the greatest force"
    y, half = top - 30, (len(rows) + 1) // 2
    count = len(scene.contacts.points_m)
    figure.text(
        36 / WIDE,
        y / TALL,
        f"{count} contacts in {scene.moments.time_s[-1]:.3g} s",
        size=17,
        weight="bold",
        color=INK,
        va="center",
    )
    for index, part in enumerate(rows):
        x = 36 + 345 * (index // half)
        height = y - 42 - 29 * (index % half)
        mark = Rectangle(
            (x / WIDE, (height - 7) / TALL), 15 / WIDE, 15 / TALL, color=part.colour, transform=figure.transFigure
        )
        figure.add_artist(mark)
        figure.text((x + 24) / WIDE, height / TALL, labels[part.name], size=11.5, color=INK, va="center")
    below = y - 42 - 29 * half - 8
    facts = scene.estimate.facts if scene.estimate is not None else ()
    lines = [line for fact in facts for line in textwrap.wrap(fact, 82)][: max((below - 16) // 23, 0)]
    for index, line in enumerate(lines):
        figure.text(36 / WIDE, (below - 23 * index) / TALL, line, size=11.5, color=QUIET, va="center")


def _colour_bar(figure: Figure, scale: Scale, x: int, width: int) -> None:
    axes = figure.add_axes(_place(x, 46, width, 18))
    colours = LinearSegmentedColormap.from_list("scale", scale.stops)
    axes.imshow(np.linspace(0, 1, 256)[None], aspect="auto", cmap=colours, extent=(scale.low, scale.high, 0, 1))
    axes.set_yticks([])
    axes.set_xticks(scale.ticks)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:.4g}")
    axes.tick_params(labelsize=12, color=INK, labelcolor=INK, length=3)
    axes.set_title(f"{scale.title}, {scale.unit}", size=13.5, color=INK, pad=7)
    for spine in axes.spines.values():
        spine.set_visible(False)
