"""Figures over the camera's picture: maps of uncertainty, coverage, residuals as arrows."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import cv2
import numpy as np

from viz.plots.contours import contour, levels
from viz.plots.marks import INK, dots
from viz.plots.svg import Axes

_STOPS = ("#f3faf7", "#bfe3d8", "#6cbfb4", "#23878f", "#15506f", "#1b2a4e")
_INNER = 420.0
ARROW, JIG_ARROW, OUTLIER = "#0f766e", "#b45309", "#dc2626"
_MOST_ARROWS = 4000
_CELLS = (8, 6)


def _picture_axes(image_size: Sequence[float], right: float = 18.0) -> Axes:
    """Axes over a picture (width, height), rows downward, its aspect kept."""
    width, height = (float(size) for size in image_size)
    inner = _INNER * height / width
    return Axes((-0.5, width - 0.5), (-0.5, height - 0.5), 76 + _INNER + right, 104 + inner, right=right, downward=True)


def heat_map(title: str, data: Mapping[str, Any], image_size: Sequence[float], extra: Sequence[Mapping] = ()) -> str:
    """A map of standard deviations as a picture with contours, a scale, and what lies over it.

    Parameters
    ----------
    data : as `PictureMap.to_dict` makes it, and `has_ray`, where the lens has a ray.
    extra : rows of `along_antenna`: the antenna's axis is drawn through them.
    """
    axes = _picture_axes(image_size, right=96.0)
    x, y = np.array(data["columns_px"]), np.array(data["rows_px"])
    values = np.array(data["std"], float)
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(np.quantile(known, 0.98))) if known.size else (0.0, 1.0)
    high = high if high > low else low + max(abs(low), 1.0)
    parts = [*axes.frame(title, "u, px", "v, px", y_ticks=4), _image(axes, values, low, high)]
    for index, level in enumerate(levels(low, high)):
        parts.append(_line(axes, contour(x, y, values, level), f"{level:g}", 0.75 if index % 2 else 0.25))
    rays = np.array(data["has_ray"], float)
    if (rays < 0.5).any():
        edge = contour(x, y, rays, 0.5)
        parts.append(f'<path d="{_path(axes, edge)}" stroke="{OUTLIER}" stroke-width="2" stroke-dasharray="6 4"/>')
    parts += [_antenna(axes, extra), _scale(axes, low, high, str(data["unit"]))]
    return axes.drawing(parts, title)


def coverage(corners_px: np.ndarray, image_size: Sequence[float]) -> str:
    """Where corners (N, 2) lie, and how many in each of 8 × 6 fields."""
    axes, size = _picture_axes(image_size), np.array(image_size, float)
    title = "where the corners lie"
    cells = np.clip((corners_px + 0.5) / size * _CELLS, 0, np.array(_CELLS) - 1).astype(int)
    counts = np.zeros(_CELLS, int)
    np.add.at(counts, tuple(cells.T), 1)
    parts = []
    step = size / _CELLS
    for column, row in np.ndindex(*_CELLS):
        left, top = np.array([column, row]) * step - 0.5
        x, y = float(axes.across(left)), float(axes.down(top))
        w, h = float(axes.across(left + step[0])) - x, float(axes.down(top + step[1])) - y
        share = min(float(counts[column, row]) / max(float(np.median(counts)), 1.0), 2.0) / 2.0
        fill = _colour(0.08 + 0.5 * share) if counts[column, row] else "#fde8e8"
        label = f"<title>{counts[column, row]} corners</title>"
        parts.append(f'<rect x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}" fill="{fill}">{label}</rect>')
    parts += axes.frame(title, "u, px", "v, px", y_ticks=4)
    parts.append(dots(axes, corners_px[:, 0], corners_px[:, 1], "#12355b", 2.4))
    return axes.drawing(parts, title)


def arrows(boards: Sequence[Mapping[str, Any]], image_size: Sequence[float]) -> str:
    """Residuals as arrows from predicted to seen, enlarged alike."""
    axes = _picture_axes(image_size)
    lengths = np.concatenate([np.linalg.norm(_array(view["residuals_px"]), axis=1) for view in boards])
    factor = _round_down(0.045 * float(image_size[0]) / max(float(np.quantile(lengths, 0.95)), 1e-6))
    every = -(-len(lengths) // _MOST_ARROWS)
    title = f"residuals, {factor:g} times enlarged"
    parts = axes.frame(title, "u, px", "v, px", y_ticks=4)
    for view in boards:
        corners, residuals = _array(view["corners_px"])[::every], _array(view["residuals_px"])[::every]
        good = np.array(view["good"], bool)[::every]
        colour = JIG_ARROW if view["folder"] == "plane" else ARROW
        for chosen, paint in ((good, colour), (~good, OUTLIER)):
            pieces = np.stack([corners[chosen], corners[chosen] + factor * residuals[chosen]], axis=1)
            if len(pieces):
                parts.append(f'<path d="{_path(axes, pieces)}" stroke="{paint}" stroke-width="1.3"/>')
        parts.append(dots(axes, corners[:, 0], corners[:, 1], INK, 1.8))
    parts.append(_ruler(axes, factor, float(np.quantile(lengths, 0.95))))
    return axes.drawing(parts, title)


def _array(rows: Sequence[Sequence[float]]) -> np.ndarray:
    return np.array(rows, float).reshape(-1, 2)


def _ruler(axes: Axes, factor: float, long_px: float) -> str:
    shown = _round_down(max(long_px, 1e-6))
    end = axes.width - axes.right
    start = end - float(axes.across(factor * shown) - axes.across(0.0))
    return (
        f'<line x1="{start:.1f}" x2="{end:.1f}" y1="{axes.top - 8:.0f}" y2="{axes.top - 8:.0f}" stroke="{INK}" '
        f'stroke-width="2"/><text x="{start - 6:.1f}" y="{axes.top - 4:.0f}" text-anchor="end">{shown:g} px</text>'
    )


def _round_down(value: float) -> float:
    """1, 2 or 5 times a power of ten, not above the value."""
    power = 10.0 ** float(np.floor(np.log10(value)))
    share = value / power * (1 + 1e-9)
    return float(f"{(5 if share >= 5 else 2 if share >= 2 else 1) * power:.1g}")


def _path(axes: Axes, pieces: np.ndarray) -> str:
    x, y = axes.across(pieces[..., 0]), axes.down(pieces[..., 1])
    return "".join(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for (a, c), (b, d) in zip(x, y, strict=True))


def _colour(share: float) -> str:
    stops = np.array([[int(stop[i : i + 2], 16) for i in (1, 3, 5)] for stop in _STOPS], float)
    rgb = [np.interp(share, np.linspace(0, 1, len(stops)), stops[:, channel]) for channel in range(3)]
    return "#" + "".join(f"{round(float(value)):02x}" for value in rgb)


def _image(axes: Axes, values: np.ndarray, low: float, high: float) -> str:
    """The map as an inlined PNG, transparent where there is no value."""
    known = np.isfinite(values)
    share = np.clip((np.where(known, values, high) - low) / (high - low), 0.0, 1.0)
    stops = np.array([[int(stop[i : i + 2], 16) for i in (5, 3, 1)] for stop in _STOPS], float)
    size = (8 * values.shape[1], 8 * values.shape[0])
    smooth = cv2.resize(share, size, interpolation=cv2.INTER_LINEAR)
    alpha = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_LINEAR) > 0.99
    channels = [np.interp(smooth, np.linspace(0, 1, len(stops)), stops[:, index]) for index in range(3)]
    picture = np.stack([*channels, 255.0 * alpha], axis=-1).round().astype(np.uint8)
    data = base64.b64encode(cv2.imencode(".png", picture)[1].tobytes()).decode()
    x, y = float(axes.across(axes.x[0])), float(axes.down(axes.y[0]))
    w, h = float(axes.across(axes.x[1])) - x, float(axes.down(axes.y[1])) - y
    place = f'x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}"'
    grey = f'<rect {place} fill="#eceff3"/>'
    return f'{grey}<image {place} preserveAspectRatio="none" href="data:image/png;base64,{data}"/>'


def _line(axes: Axes, pieces: np.ndarray, label: str, side: float) -> str:
    if not len(pieces):
        return ""
    middle = pieces.mean(axis=1)
    # labels stand by turns at the upper and the lower side, off the antenna's middle
    towards = np.array([axes.x[0] + 0.72 * (axes.x[1] - axes.x[0]), axes.y[0] + side * (axes.y[1] - axes.y[0])])
    at = middle[np.argmin(np.linalg.norm(middle - towards, axis=1))]
    x, y = float(axes.across(at[0])), float(axes.down(at[1]))
    x = min(max(x, axes.left + 16), axes.width - axes.right - 16)
    y = min(max(y, axes.top + 12), axes.height - axes.bottom - 8)
    return (
        f'<path d="{_path(axes, pieces)}" stroke="#ffffff" stroke-width="2.4" opacity="0.55"/>'
        f'<path d="{_path(axes, pieces)}" stroke="#111827" stroke-width="1"/>'
        f'<text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle" class="halo">{escape(label)}</text>'
    )


def _antenna(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> str:
    seen = [row for row in rows if row["u_px"] is not None]
    if len(seen) < 2:
        return ""
    points = np.array([[row["u_px"], row["v_px"]] for row in seen])
    parts = [
        f'<path d="{_path(axes, np.stack([points[:-1], points[1:]], axis=1))}" stroke="#ea580c" stroke-width="2.4"/>',
        dots(axes, points[:, 0], points[:, 1], "#ea580c", 8.0),
    ]
    for row, (u, v) in list(zip(seen, points, strict=True))[::2]:
        place = f'x="{float(axes.across(u)):.1f}" y="{float(axes.down(v)) - 9:.1f}" text-anchor="middle"'
        parts.append(f'<text {place} class="halo">{1e3 * row["arclength_m"]:.0f} mm</text>')
    return "".join(parts)


def _scale(axes: Axes, low: float, high: float, unit: str) -> str:
    """The colour scale beside the map."""
    x, top, height = axes.width - axes.right + 16, axes.top, axes.height - axes.top - axes.bottom
    parts = []
    for step in range(40):
        y = top + height * (1 - (step + 1) / 40)
        parts.append(
            f'<rect x="{x}" y="{y:.1f}" width="14" height="{height / 40 + 0.6:.1f}" fill="{_colour(step / 39)}"/>'
        )
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        value = low + share * (high - low)
        y = top + height * (1 - share) + 4
        parts.append(f'<text x="{x + 20}" y="{y:.1f}">{value:.2g}</text>')
    parts.append(f'<text x="{x}" y="{top - 12:.0f}">± {escape(unit)}</text>')
    return "".join(parts)
