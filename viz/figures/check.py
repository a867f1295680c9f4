"""Figures of `vbaa check`: over the camera's picture, and of views, the free antenna, loads and moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import LogLocator, MaxNLocator

from viz.scene.readable import round_down

from .drawing import AMBER, INK, RED, TEAL, band, bars, dots, legend, limits, new_axes, paths, style

_MAP = LinearSegmentedColormap.from_list("std", ("#f3faf7", "#bfe3d8", "#6cbfb4", "#23878f", "#15506f", "#1b2a4e"))
_INNER_PX = 420.0
_MOST_ARROWS, _MOST_VIEWS, _MOST_LEVELS = 4000, 30, 6
_CELLS = (8, 6)
_STILLS = ("#0f766e", "#1d4ed8", "#b45309", "#7c3aed", "#be185d", "#475569")
_PALE = "#6cbfb4"
_HALO = {"facecolor": "white", "alpha": 0.75, "pad": 1.0, "edgecolor": "none"}


def _picture_axes(title: str, image_size: Sequence[float], right: float = 18.0) -> Axes:
    """Axes over a picture (width, height), rows downward, its aspect kept."""
    width, height = (float(size) for size in image_size)
    size = (76 + _INNER_PX + right, 104 + _INNER_PX * height / width)
    ends = ((-0.5, width - 0.5), (height - 0.5, -0.5))
    return new_axes(title, size, (76, right, 54, 50), *ends, ("u, px", "v, px"))


@style
def heat_map(title: str, data: Mapping[str, Any], image_size: Sequence[float], extra: Sequence[Mapping] = ()) -> Axes:
    """A map of standard deviations as a picture with contours, a scale, and what lies over it.

    data : a map of check.json, and `has_ray`, where the lens has a ray.
    extra : rows of `along_antenna`: the antenna's axis is drawn through them.
    """
    axes = _picture_axes(title, image_size, right=96.0)
    axes.set_facecolor("#eceff3")
    axes.grid(visible=False)
    x, y = np.array(data["columns_px"]), np.array(data["rows_px"])
    values = np.ma.masked_invalid(np.array(data["std"], float))
    known = values.compressed()
    low, high = (float(known.min()), float(np.quantile(known, 0.98))) if known.size else (0.0, 1.0)
    high = high if high > low else low + max(abs(low), 1.0)
    side = [0.5 * (ends[-1] - ends[0]) / (len(ends) - 1) for ends in (x, y)]
    extent = (x[0] - side[0], x[-1] + side[0], y[-1] + side[1], y[0] - side[1])
    ends = axes.get_xlim(), axes.get_ylim()
    drawn = axes.imshow(values, _MAP, vmin=low, vmax=high, extent=extent, aspect="auto", interpolation="bilinear")
    axes.set(xlim=ends[0], ylim=ends[1])
    levels: list[float] = []
    if 0 < low < high:  # round values, evenly spaced, or by factors where high is many times low
        even = MaxNLocator(_MOST_LEVELS - 1, steps=[1, 2, 5, 10])
        ticks = even if high < 5 * low else LogLocator(subs=(1.0, 2.0, 5.0), numticks=99)
        levels = [float(f"{value:.6g}") for value in ticks.tick_values(low, high) if low < value < high]
    if levels:
        levels = levels[:: -(-len(levels) // _MOST_LEVELS)]
        lines = axes.contour(x, y, values, levels, colors="#111827", linewidths=1.0)
        for label in axes.clabel(lines, fontsize=12, fmt="%g", inline=False):
            label.set(bbox=_HALO, rotation=0)
    rays = np.array(data["has_ray"], float)
    if (rays < 0.5).any() and (rays > 0.5).any():
        axes.contour(x, y, rays, [0.5], colors=RED, linewidths=2.0, linestyles="dashed")
    seen = [row for row in extra if row["u_px"] is not None]
    if len(seen) > 1:
        points = np.array([[row["u_px"], row["v_px"]] for row in seen])
        axes.plot(*points.T, color="#ea580c", lw=2.4, marker="o", ms=8)
        for row, point in list(zip(seen, points, strict=True))[::2]:
            words = f"{1e3 * row['arclength_m']:.0f} mm"
            axes.annotate(words, point, (0, 9), textcoords="offset points", ha="center", size=12, bbox=_HALO)
    width, height = axes.figure.bbox.size
    scale = axes.figure.add_axes(((width - 80) / width, 50 / height, 14 / width, (height - 104) / height))
    axes.figure.colorbar(drawn, cax=scale, ticks=np.linspace(low, high, 5), format="%.2g")
    scale.set_title(f"± {data['unit']}", size=12.5, weight="normal", pad=6)
    scale.grid(visible=False)
    return axes


@style
def coverage(boards: Sequence[Mapping[str, Any]], image_size: Sequence[float]) -> Axes:
    """Where the corners lie, and how many in each of 8 × 6 fields."""
    axes, size = _picture_axes("where the corners lie", image_size), np.array(image_size, float)
    corners_px = _joined(boards)[0]
    cells = np.clip((corners_px + 0.5) / size * _CELLS, 0, np.array(_CELLS) - 1).astype(int)
    counts = np.zeros(_CELLS, int)
    np.add.at(counts, tuple(cells.T), 1)
    middle, step = max(float(np.median(counts)), 1.0), size / _CELLS
    for cell in np.ndindex(*_CELLS):
        (left, top), count = np.array(cell) * step - 0.5, int(counts[cell])
        fill = _MAP(0.08 + 0.25 * min(count / middle, 2.0)) if count else "#fde8e8"
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * step + [left, top]
        paths(axes, corners[None], closed=True, fc=fill, ec="none", zorder=0, gid=f"tip:{count} corners")
    dots(axes, corners_px[:, 0], corners_px[:, 1], "#12355b", 2.4)
    return axes


@style
def residual_arrows(boards: Sequence[Mapping[str, Any]], image_size: Sequence[float]) -> Axes:
    """Residuals as arrows from predicted to seen, enlarged alike."""
    lengths = np.linalg.norm(_joined(boards)[1], axis=1)
    long_px = max(float(np.quantile(lengths, 0.95)), 1e-6)
    factor = round_down(0.045 * float(image_size[0]) / long_px)
    every = -(-len(lengths) // _MOST_ARROWS)
    axes = _picture_axes(f"residuals, {factor:g} times enlarged", image_size)
    for view in boards:
        corners, residuals, good = (values[::every] for values in _joined([view]))
        for chosen, colour in ((good, AMBER if view["folder"] == "plane" else TEAL), (~good, RED)):
            start = corners[chosen]
            arrows = np.stack([start, start + factor * residuals[chosen]], axis=1)
            paths(axes, arrows, ec=colour, lw=1.3, label="arrows")
        dots(axes, corners[:, 0], corners[:, 1], INK, 1.8)
    shown = round_down(long_px)
    length = factor * shown / float(image_size[0])
    axes.plot([1 - length, 1], [1.025, 1.025], transform=axes.transAxes, color=INK, lw=2, clip_on=False)
    axes.text(1 - length, 1.012, f"{shown:g} px ", transform=axes.transAxes, ha="right", color=INK)
    return axes


def _joined(boards: Sequence[Mapping[str, Any]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (N, 2), residuals (N, 2) and which of them are good (N,), of all views."""
    names = ("corners_px", "residuals_px", "good")
    corners, residuals, good = ([row for view in boards for row in view[name]] for name in names)
    return np.array(corners, float).reshape(-1, 2), np.array(residuals, float).reshape(-1, 2), np.array(good, bool)


@style
def residuals_by_radius(boards: Sequence[Mapping[str, Any]], centre_px: Sequence[float]) -> Axes:
    """Residuals along the radius over the distance from the lens' centre, with their mean over rings."""
    corners, residuals, good = _joined(boards)
    away = corners - centre_px
    radius = np.linalg.norm(away, axis=1)
    outward = (residuals * away).sum(axis=1) / np.maximum(radius, 1e-9)
    reach = 1.1 * float(np.abs(outward[good]).max()) if good.any() else 1.0
    axes = new_axes(
        "residuals by distance from the centre",
        x=(0.0, 1.05 * float(radius.max())),
        y=(-reach, reach),
        labels=("distance from the lens' centre, px", "outward residual, px"),
    )
    dots(axes, radius[good], outward[good], _PALE, 2.6)
    edges = np.quantile(radius[good], np.linspace(0, 1, 11)) if good.any() else np.zeros(0)
    rings = [good & (radius >= low) & (radius <= high) for low, high in pairwise(edges)]
    rings = [ring for ring in rings if ring.sum() >= 3]
    middle, mean = (np.array([values[ring].mean() for ring in rings]) for values in (radius, outward))
    error = np.array([2 * outward[ring].std() / np.sqrt(ring.sum()) for ring in rings])
    bars(axes, middle, mean - error, mean + error, INK, 1.6)
    axes.plot(middle, mean, color=INK, lw=2)
    legend(axes, [(_PALE, "corner", "dot"), (INK, "mean ± 2 std", "line")])
    return axes


@style
def views_rms(boards: Sequence[Mapping[str, Any]], expected_px: float | None) -> Axes:
    """Each picture's rms; the worst where there are many."""
    worst = sorted(boards, key=lambda view: -float(view["rms_px"]))[:_MOST_VIEWS]
    shown = sorted(worst, key=lambda view: (view["folder"], view["name"]))
    names, rms = [str(view["name"])[-24:] for view in shown], [float(view["rms_px"]) for view in shown]
    left, most = 14.0 + 8.2 * max(map(len, names)), max(rms + ([expected_px] if expected_px else []))
    axes = new_axes(
        "rms of every picture",
        (520.0, 110.0 + 17.0 * len(shown)),
        (left, 18, 54, 50),
        x=(0.0, 1.12 * most),
        y=(len(shown) - 0.5, -0.5),
        labels=("rms, px", ""),
    )
    colours = [AMBER if view["folder"] == "plane" else TEAL for view in shown]
    axes.barh(range(len(names)), rms, 0.6, color=colours)
    axes.set_yticks(range(len(names)), names, size=11.5)
    axes.grid(axis="y", visible=False)
    folders = {view["folder"] for view in shown}
    kinds = (("intrinsics", TEAL, "intrinsics"), ("plane", AMBER, "jig")) if len(folders) > 1 else ()
    entries = [(colour, words, "dot") for _, colour, words in kinds]
    if expected_px:
        axes.axvline(expected_px, color=INK, lw=1, ls=(0, (5, 3)))
        entries.append((INK, "expected", "dashes"))
    legend(axes, entries)
    return axes


@style
def free_residuals(rows: Sequence[Mapping[str, Any]], length_mm: float) -> Axes:
    """The free antenna's residuals along it, one line a picture."""
    every = np.concatenate([np.array(row["residual_mm"], float) for row in rows])
    reach = max(1.15 * float(np.abs(every).max(initial=0.0)), 0.02)
    labels = ("distance from the clamp, mm", "residual across it, mm")
    axes = new_axes("free antenna: measured minus predicted", x=(0.0, length_mm), y=(-reach, reach), labels=labels)
    for index, row in enumerate(rows):
        axes.plot(row["arclength_mm"], row["residual_mm"], color=_STILLS[index % len(_STILLS)], lw=1.6)
    named = [(_STILLS[index], str(row["image"])[-16:], "line") for index, row in enumerate(rows[:3])]
    legend(axes, named if len(rows) <= 3 else [(_STILLS[0], f"{len(rows)} pictures, a colour each", "line")])
    return axes


@style
def stiffness_by_load(loads: Sequence[Mapping[str, Any]]) -> Axes:
    """EI by each load alone, against the rig's."""
    step = np.array([row["stiffness_percent"] for row in loads], float)
    std = np.array([row["stiffness_std_percent"] for row in loads], float)
    odd = np.array([row["look_at"] for row in loads], bool)
    ends = limits(step - 2 * std, step + 2 * std, [0.0])
    axes = _counted_axes("EI by each load, against the rig's", len(loads), ends, ("load", "difference of EI, %"))
    number = np.arange(1, len(loads) + 1)
    for chosen, colour in ((~odd, TEAL), (odd, RED)):
        bars(axes, number[chosen], (step - 2 * std)[chosen], (step + 2 * std)[chosen], colour, 1.6)
        dots(axes, number[chosen], step[chosen], colour, 8.0)
    legend(axes, [(TEAL, "± 2 std", "dot"), (RED, "look at", "dot")])
    return axes


@style
def moment_residuals(rows: Sequence[Mapping[str, Any]], std_Nm: float) -> Axes:
    """The sensor's readings less what the rig predicts, free frames and loads."""
    residual = 1e3 * np.array([row["moment_residual_mNm"] for row in rows], float)
    loaded = np.array(["distance_mm" in row for row in rows], bool)
    number, std = np.arange(1, len(rows) + 1), 1e6 * std_Nm
    ends = limits(residual, [3 * std, -3 * std])
    axes = _counted_axes("moment: measured minus predicted", len(rows), ends, ("picture", "residual, µN·m"))
    band(axes, np.array(axes.get_xlim()), np.full(2, -2 * std), np.full(2, 2 * std), "#7fccc0", 0.35)
    for chosen, colour in ((~loaded, TEAL), (loaded, AMBER)):
        dots(axes, number[chosen], residual[chosen], colour, 8.0)
    legend(axes, [(TEAL, "free", "dot"), (AMBER, "loaded", "dot"), ("#7fccc0", "noise ± 2 std", "band")])
    return axes


def _counted_axes(title: str, count: int, y: tuple[float, float], labels: tuple[str, str]) -> Axes:
    """Axes over the numbers 1 to `count`, with a line at 0."""
    axes = new_axes(title, x=(0.4, count + 0.6), y=y, labels=labels)
    axes.xaxis.set_major_locator(MaxNLocator(12, integer=True))
    axes.axhline(0, color=INK, lw=1)
    return axes
