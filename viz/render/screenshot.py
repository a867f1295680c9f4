"""The picture of a scene: the whole rig, a close-up of the contacts, and a legend, on one sheet."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from vbaa_calib.core.files import replacing
from viz.parts.assemble import ScenePart, all_parts, layers_of
from viz.scene.layout import INK
from viz.scene.readable import contact_scale, object_scale, round_down
from viz.scene.scene import Scene

from .probe import require_opengl
from .stage import Stage, quiet


@dataclass(frozen=True)
class _ScreenshotSettings:
    """Layout of a screenshot, px."""

    wide: int = 1900  # width of the sheet
    tall: int = 1080  # height of the sheet
    left: int = 740  # width of the column with the rig
    strip: int = 120  # height of the strip with the scales under the close-up
    rig_size: tuple[int, int] = (740, 700)  # width and height of the overview
    near_size: tuple[int, int] = (1160, 960)  # width and height of the close-up
    dpi: int = 100  # pixels per inch of matplotlib's lengths


SHEET = _ScreenshotSettings()


@quiet()
def screenshot(scene: Scene, path: Path, *, mode: str = "force", force: bool = False) -> None:
    """Write a PNG: the whole rig on the left, a close-up of the contacts on the right, and a legend.

    `mode` is what contacts are coloured by, one of `readable.MODES`. Raises InputError when the file exists and `force`
    is off, VbaaError where pictures cannot be drawn.
    """
    with replacing(path, force) as temporary:
        require_opengl()
        parts = all_parts(scene)
        near = Stage(scene, _without(parts, "grid", "plane", "camera", "now"), mode, SHEET.near_size)
        half_m = near.look_at_contacts()
        close_up, overview = _drawn(near), None
        if scene.rig is not None:
            whole = Stage(scene, _without(parts, "spread", "cones", "now"), mode, SHEET.rig_size)
            whole.look_at_all()
            overview = _drawn(whole)
        figure = Figure(figsize=(SHEET.wide / SHEET.dpi, SHEET.tall / SHEET.dpi), dpi=SHEET.dpi, facecolor="white")
        canvas = FigureCanvasAgg(figure)
        _axes(figure, SHEET.left, SHEET.strip, SHEET.near_size).imshow(close_up, interpolation="none")
        if overview is not None:
            _axes(figure, 0, SHEET.tall - SHEET.rig_size[1], SHEET.rig_size).imshow(overview, interpolation="none")
        sheet = _axes(figure, 0, 0, (SHEET.wide, SHEET.tall))
        sheet.set(xlim=(0, SHEET.wide), ylim=(0, SHEET.tall), facecolor="none")
        m_per_pixel = 2 * half_m / SHEET.near_size[1]
        length = round_down(0.16 * SHEET.near_size[0] * m_per_pixel)
        left, right, y = SHEET.wide - 40 - length / m_per_pixel, SHEET.wide - 40, SHEET.strip + 34
        sheet.plot([left, right], [y, y], color=INK, lw=3.5, solid_capstyle="butt")
        sheet.text((left + right) / 2, y + 9, f"{1e3 * length:g} mm", ha="center", color=INK, size=13)
        _legend(sheet, scene, parts, SHEET.tall - SHEET.rig_size[1] if overview is not None else SHEET.tall)
        bars = [bar for bar in (contact_scale(scene, mode), object_scale(scene)) if bar is not None]
        for index, bar in enumerate(bars):
            axes = _axes(figure, SHEET.left + 60 + index * 560, 46, (460, 18))
            axes.axis("on")
            ends = (bar.ticks[0], bar.ticks[-1], 0, 1)
            axes.imshow(np.linspace(0, 1, 256)[None], aspect="auto", cmap=bar.colormap, extent=ends)
            axes.set_yticks([])
            axes.set_xticks(bar.ticks, [f"{tick:.4g}" for tick in bar.ticks])
            axes.tick_params(labelsize=12, color=INK, labelcolor=INK, length=3)
            axes.set_title(bar.ends[1], size=13.5, color=INK, pad=7)
            axes.spines[:].set_visible(False)
        canvas.print_png(str(temporary))


def _without(parts: list[ScenePart], *names: str) -> list[ScenePart]:
    return [part for part in parts if part.name not in names]


def _drawn(stage: Stage) -> np.ndarray:
    """(H, W, 3) picture of the stage; its plotter is then closed."""
    plotter = stage.plotter
    plotter.enable_anti_aliasing("ssaa")
    # pyvista's own way would draw a scene first, to see whether that works
    plotter.renderer.SetUseDepthPeeling(True)
    plotter.renderer.SetMaximumNumberOfPeels(8)
    plotter.renderer.SetOcclusionRatio(0.0)
    plotter.add_axes(color=INK, line_width=3, viewport=(0.0, 0.0, 0.13, 0.13))
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    return np.asarray(pixels)[..., :3]


def _axes(figure: Figure, x: int, y: int, size: tuple[int, int]) -> Axes:
    axes = figure.add_axes((x / SHEET.wide, y / SHEET.tall, size[0] / SHEET.wide, size[1] / SHEET.tall))
    axes.axis("off")
    return axes


def _legend(sheet: Axes, scene: Scene, parts: list[ScenePart], top: int) -> None:
    scaled = ("contacts", "forces", "now", *(["object"] if object_scale(scene) is not None else []))
    rows = [part for part in layers_of(parts) if part.name not in scaled]
    y, half = top - 30, (len(rows) + 1) // 2
    title = f"{len(scene.contacts.points_m)} contacts in {scene.instants.time_s[-1]:.3g} s"
    sheet.text(36, y, title, size=17, weight="bold", color=INK, va="center")
    for index, part in enumerate(rows):
        x, height = 36 + 345 * (index // half), y - 42 - 29 * (index % half)
        sheet.add_patch(Rectangle((x, height - 7), 15, 15, color=part.colour))
        label = "antenna at the greatest force" if part.name == "antenna" else part.label
        sheet.text(x + 24, height, label, size=11.5, color=INK, va="center")
    below = y - 42 - 29 * half - 8
    lines = [line for fact in scene.facts for line in textwrap.wrap(fact, 82)][: max((below - 16) // 23, 0)]
    for index, line in enumerate(lines):
        sheet.text(36, below - 23 * index, line, size=11.5, color="#64748b", va="center")
