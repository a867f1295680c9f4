"""Figures of `vbaa check`: maps over the camera's picture; views, free antenna, loads and moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from contourpy import contour_generator

from viz.scene.readable import hexes, on_ramp, round_down

from .drawing import Plot, limits, picture, ticks_in
from .settings import STYLE


def _picture_axes(title: str, image_size: Sequence[float], right: float = 18.0, grid: str = "xy") -> Plot:
    """Axes over a picture (width, height) with rows downwards and its aspect ratio."""
    width, height = (float(size) for size in image_size)
    size = (76 + STYLE.map_px + right, 104 + STYLE.map_px * height / width)
    ends = ((-0.5, width - 0.5), (height - 0.5, -0.5))
    return Plot(title, size, (76, right, 54, 50), *ends, ("u, px", "v, px"), grid=grid)


def heat_map(title: str, data: Mapping[str, Any], image_size: Sequence[float], extra: Sequence[Mapping] = ()) -> Plot:
    """A map of standard deviations as a coloured picture with contours, a scale, and overlaid marks.

    data : a map of check.json, and `has_ray`, where the lens has a ray.
    extra : rows of `along_antenna`: the antenna's axis is drawn through them.
    """
    axes = _picture_axes(title, image_size, right=96.0, grid="")
    wide, tall = axes.inner
    x, y = np.array(data["columns_px"]), np.array(data["rows_px"])
    values = np.array(data["std"], float)
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(np.quantile(known, 0.98))) if known.size else (0.0, 1.0)
    high = high if high > low else low + max(abs(low), 1.0)
    side = [0.5 * (ends[-1] - ends[0]) / (len(ends) - 1) for ends in (x, y)]
    left, right, top, bottom = x[0] - side[0], x[-1] + side[0], y[0] - side[1], y[-1] + side[1]
    corners = axes.pixels(np.array([[left, top], [right, top], [left, bottom]]))
    axes.under.append(f'<rect width="{wide:g}" height="{tall:g}" style="fill:var(--ceceff3,#eceff3)"/>')
    axes.under.append(picture(_heat((values - low) / (high - low)), corners))
    for at in _levels(low, high):
        lines = _contours(x, y, values, at)
        for one in lines:
            axes.paths(one[None], "level", stroke="#0b1220")
        for one in sorted(lines, key=len)[-1:]:
            share = axes.pixels(one) / axes.inner
            free = one[((share > 0.06) & (share < 0.94)).all(axis=1)]  # the label's whole width is to be seen
            if len(free):
                axes.write(free[len(free) // 2].tolist(), f"{at:g}", "middle", "halo", (0, 4))
    rays = np.array(data["has_ray"], float)
    if (rays < 0.5).any() and (rays > 0.5).any():
        for one in _contours(x, y, rays, 0.5):
            axes.paths(one[None], "rays", stroke=STYLE.red, width=2.0, dashes=(7, 3))
    seen = [row for row in extra if row["u_px"] is not None]
    if len(seen) > 1:
        points = np.array([[row["u_px"], row["v_px"]] for row in seen])
        axes.line(points[:, 0], points[:, 1], "#ea580c", 2.4)
        axes.dots(points[:, 0], points[:, 1], "#ea580c", 8.0)
        for row, at in list(zip(seen, points, strict=True))[::2]:
            axes.write(at.tolist(), f"{1e3 * row['arclength_m']:.0f} mm", "middle", "halo", (0, -9))
    _write_scale(axes, low, high, f"± {data['unit']}")
    return axes


def _heat(share: np.ndarray) -> bytes:
    """A PNG of shares (rows, columns) from 0 to 1 in the map's colours, smooth; transparent where they are NaN."""
    colours = on_ramp(STYLE.map, share.ravel()).reshape(*share.shape, 3)[..., ::-1]
    opaque = np.where(np.isfinite(share), 255, 0).astype(np.uint8)
    size = (8 * share.shape[1], 8 * share.shape[0])
    smooth = cv2.resize(np.ascontiguousarray(colours), size, interpolation=cv2.INTER_LINEAR)
    hard = cv2.resize(opaque, size, interpolation=cv2.INTER_NEAREST)
    return cv2.imencode(".png", np.dstack([smooth, hard]))[1].tobytes()


def _levels(low: float, high: float) -> list[float]:
    """Round values between two, evenly spaced, or by constant factors where high is many times low."""
    if not 0 < low < high:
        return []
    found = ticks_in(low, high, STYLE.most_levels - 1)[0]
    if high >= 5 * low:
        powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        found = [step * 10.0**power for power in powers for step in (1, 2, 5)]
    found = [float(f"{value:.6g}") for value in found if low < value < high]
    return found[:: -(-len(found) // STYLE.most_levels)] if found else []


def _contours(x: np.ndarray, y: np.ndarray, values: np.ndarray, at: float) -> list[np.ndarray]:
    """Contour lines (K, 2) of values (rows, columns) over x and y at the level `at`."""
    return [np.asarray(one) for one in contour_generator(x, y, np.ma.masked_invalid(values)).lines(at)]


def _write_scale(axes: Plot, low: float, high: float, title: str) -> None:
    """Draw a bar of the map's colours on the right, with five values and a title."""
    (wide, tall), (left, _, top, _), (bottom, end) = axes.inner, axes.margins, axes.y
    colours = hexes(on_ramp(STYLE.map, 1.0 - (np.arange(42) + 0.5) / 42))
    for row, colour in enumerate(colours):
        box = f'x="{left + wide + 16:g}" y="{top + row * tall / 42:.1f}" width="14" height="{tall / 42 + 0.5:.1f}"'
        axes.over.append(f'<rect {box} fill="{colour}"/>')
    for share in np.linspace(0.0, 1.0, 5):
        words = f"{low + share * (high - low):.2g}".replace("-", "−")
        axes.write((axes.x[1], bottom + share * (end - bottom)), words, "start", shift=(35, 4.5))
    axes.write((axes.x[1], end), title, "middle", shift=(23, -8))


def coverage(boards: Sequence[Mapping[str, Any]], image_size: Sequence[float]) -> Plot:
    """Positions of the corners, and their number in each of 8 × 6 fields."""
    axes, size = _picture_axes("where the corners lie", image_size), np.array(image_size, float)
    corners_px = _joined(boards)[0]
    cells = np.clip((corners_px + 0.5) / size * STYLE.cells, 0, np.array(STYLE.cells) - 1).astype(int)
    counts = np.zeros(STYLE.cells, int)
    np.add.at(counts, tuple(cells.T), 1)
    middle, step = max(float(np.median(counts)), 1.0), size / STYLE.cells
    fills = hexes(on_ramp(STYLE.map, 0.08 + 0.25 * np.minimum(counts.ravel() / middle, 2.0)))
    for cell, count, fill in zip(np.ndindex(*STYLE.cells), counts.ravel().tolist(), fills, strict=True):
        corners = (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) + cell) * step - 0.5
        axes.paths(corners[None], "field", fill=fill if count else "#fde8e8", tip=f"{count} corners")
    axes.dots(corners_px[:, 0], corners_px[:, 1], "#12355b", 2.4)
    return axes


def residual_arrows(boards: Sequence[Mapping[str, Any]], image_size: Sequence[float]) -> Plot:
    """Residuals as equally enlarged arrows from the predicted to the detected corners."""
    lengths = np.linalg.norm(_joined(boards)[1], axis=1)
    long_px = max(float(np.quantile(lengths, 0.95)), 1e-6)
    factor = round_down(0.045 * float(image_size[0]) / long_px)
    every = -(-len(lengths) // STYLE.most_arrows)
    axes = _picture_axes(f"residuals, {factor:g} times enlarged", image_size)
    for view in boards:
        corners, residuals, good = (values[::every] for values in _joined([view]))
        for chosen, colour in ((good, STYLE.amber if view["folder"] == "plane" else STYLE.teal), (~good, STYLE.red)):
            start = corners[chosen]
            arrows = np.stack([start, start + factor * residuals[chosen]], axis=1)
            axes.paths(arrows, "arrows", stroke=colour, width=1.3)
        axes.dots(corners[:, 0], corners[:, 1], STYLE.ink, 1.8)
    length_px = round_down(long_px)
    long, right = axes.inner[0] * factor * length_px / float(image_size[0]), axes.size[0] - axes.margins[1]
    axes.over.append(f'<path class="sample" d="M{right - long:.1f} 42h{long:.1f}"/>')
    axes.write((axes.x[1], axes.y[1]), f"{length_px:g} px", "end", shift=(-long - 6, -8))
    return axes


def _joined(boards: Sequence[Mapping[str, Any]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (N, 2), residuals (N, 2) and the mask (N,) of the good ones, of all views."""
    names = ("corners_px", "residuals_px", "good")
    corners, residuals, good = ([row for view in boards for row in view[name]] for name in names)
    return np.array(corners, float).reshape(-1, 2), np.array(residuals, float).reshape(-1, 2), np.array(good, bool)


def residuals_by_radius(boards: Sequence[Mapping[str, Any]], centre_px: Sequence[float]) -> Plot:
    """Radial residuals against the distance from the lens's centre, with their mean over rings."""
    corners, residuals, good = _joined(boards)
    away = corners - centre_px
    radius = np.linalg.norm(away, axis=1)
    outward = (residuals * away).sum(axis=1) / np.maximum(radius, 1e-9)
    reach = 1.1 * float(np.abs(outward[good]).max()) if good.any() else 1.0
    axes = Plot(
        "residuals by distance from the centre",
        x=(0.0, 1.05 * float(radius.max())),
        y=(-reach, reach),
        labels=("distance from the lens' centre, px", "outward residual, px"),
    )
    axes.dots(radius[good], outward[good], STYLE.pale, 2.6)
    edges = np.quantile(radius[good], np.linspace(0, 1, 11)) if good.any() else np.zeros(0)
    rings = [good & (radius >= low) & (radius <= high) for low, high in pairwise(edges)]
    rings = [ring for ring in rings if ring.sum() >= 3]
    middle, mean = (np.array([values[ring].mean() for ring in rings]) for values in (radius, outward))
    error = np.array([2 * outward[ring].std() / np.sqrt(ring.sum()) for ring in rings])
    axes.bars(middle, mean - error, mean + error, STYLE.ink, 1.6)
    axes.line(middle, mean, STYLE.ink, 2.0)
    axes.legend([(STYLE.pale, "corner", "dot"), (STYLE.ink, "mean ± 2 std", "line")])
    return axes


def views_rms(boards: Sequence[Mapping[str, Any]], expected_px: float | None) -> Plot:
    """The rms of each picture; only the worst where there are many."""
    worst = sorted(boards, key=lambda view: -float(view["rms_px"]))[: STYLE.most_views]
    listed = sorted(worst, key=lambda view: (view["folder"], view["name"]))
    names, rms = [str(view["name"])[-24:] for view in listed], [float(view["rms_px"]) for view in listed]
    left, most = 14.0 + 8.2 * max(map(len, names)), max(rms + ([expected_px] if expected_px else []))
    axes = Plot(
        "rms of every picture",
        (520.0, 110.0 + 17.0 * len(listed)),
        (left, 18, 54, 50),
        x=(0.0, 1.12 * most),
        y=(len(listed) - 0.5, -0.5),
        labels=("rms, px", ""),
        y_ticks=(range(len(names)), names),
        grid="x",
    )
    for row, (view, long) in enumerate(zip(listed, rms, strict=True)):
        corners = np.array([[0.0, row - 0.3], [long, row - 0.3], [long, row + 0.3], [0.0, row + 0.3]])
        axes.paths(corners[None], "bar", fill=STYLE.amber if view["folder"] == "plane" else STYLE.teal)
    folders = {view["folder"] for view in listed}
    kinds = (("intrinsics", STYLE.teal, "intrinsics"), ("plane", STYLE.amber, "jig")) if len(folders) > 1 else ()
    entries = [(colour, words, "dot") for _, colour, words in kinds]
    if expected_px:
        axes.upright(expected_px, STYLE.ink, dashes=(5, 3))
        entries.append((STYLE.ink, "expected", "dashes"))
    axes.legend(entries)
    return axes


def free_residuals(rows: Sequence[Mapping[str, Any]], length_mm: float) -> Plot:
    """The free antenna's residuals along it, one curve per picture."""
    every = np.concatenate([np.array(row["residual_mm"], float) for row in rows])
    reach = max(1.15 * float(np.abs(every).max(initial=0.0)), 0.02)
    labels = ("distance from the clamp, mm", "residual across it, mm")
    axes = Plot("free antenna: measured minus predicted", x=(0.0, length_mm), y=(-reach, reach), labels=labels)
    for index, row in enumerate(rows):
        axes.line(row["arclength_mm"], row["residual_mm"], STYLE.frames[index % len(STYLE.frames)], 1.6)
    named = [(STYLE.frames[index], str(row["image"])[-16:], "line") for index, row in enumerate(rows[:3])]
    axes.legend(named if len(rows) <= 3 else [(STYLE.frames[0], f"{len(rows)} pictures, a colour each", "line")])
    return axes


def stiffness_by_load(loads: Sequence[Mapping[str, Any]]) -> Plot:
    """EI from each load alone, compared with the rig's."""
    step = np.array([row["stiffness_percent"] for row in loads], float)
    std = np.array([row["stiffness_std_percent"] for row in loads], float)
    suspect = np.array([row["look_at"] for row in loads], bool)
    ends = limits(step - 2 * std, step + 2 * std, [0.0])
    axes = _counted_axes("EI by each load, against the rig's", len(loads), ends, ("load", "difference of EI, %"))
    number = np.arange(1, len(loads) + 1)
    for chosen, colour in ((~suspect, STYLE.teal), (suspect, STYLE.red)):
        axes.bars(number[chosen], (step - 2 * std)[chosen], (step + 2 * std)[chosen], colour, 1.6)
        axes.dots(number[chosen], step[chosen], colour, 8.0)
    axes.legend([(STYLE.teal, "± 2 std", "dot"), (STYLE.red, "look at", "dot")])
    return axes


def moment_residuals(rows: Sequence[Mapping[str, Any]], std_Nm: float) -> Plot:
    """The sensor's readings less the rig's predictions, for free frames and loads."""
    residual = 1e3 * np.array([row["moment_residual_mNm"] for row in rows], float)
    loaded = np.array(["distance_mm" in row for row in rows], bool)
    number, std = np.arange(1, len(rows) + 1), 1e6 * std_Nm
    ends = limits(residual, [3 * std, -3 * std])
    axes = _counted_axes("moment: measured minus predicted", len(rows), ends, ("picture", "residual, µN·m"))
    axes.band(np.array(axes.x), np.full(2, -2 * std), np.full(2, 2 * std), "#7fccc0", 0.35)
    for chosen, colour in ((~loaded, STYLE.teal), (loaded, STYLE.amber)):
        axes.dots(number[chosen], residual[chosen], colour, 8.0)
    axes.legend([(STYLE.teal, "free", "dot"), (STYLE.amber, "loaded", "dot"), ("#7fccc0", "noise ± 2 std", "band")])
    return axes


def _counted_axes(title: str, count: int, y: tuple[float, float], labels: tuple[str, str]) -> Plot:
    """Axes over the numbers 1 to `count`, with a line at 0."""
    x = (0.4, count + 0.6)
    axes = Plot(title, x=x, y=y, labels=labels, x_ticks=ticks_in(*x, most=12, least_step=1.0))
    axes.level(0.0, STYLE.ink)
    return axes
