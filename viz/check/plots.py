"""Figures of `vbaa check` that are plots: residuals by radius, views, the free antenna, loads, and gauges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np

from viz.plots.marks import INK, Entry, band, bars, dots, legend, level, line
from viz.plots.svg import Axes, span

TEAL, AMBER, RED = "#0f766e", "#b45309", "#dc2626"
LEVEL_COLOURS = {"holds": TEAL, "look at": AMBER, "does not hold": RED, "not given": "#64748b"}
_STILLS = ("#0f766e", "#1d4ed8", "#b45309", "#7c3aed", "#be185d", "#475569")
_MOST_VIEWS = 30
_NOISE, _BAR = "#7fccc0", 1.6


def gauge(evidence: Mapping[str, Any]) -> str:
    """How far the difference is, in standard deviations, against the two limits; a small bar."""
    look, fail, value = (float(evidence[key]) for key in ("look_from_std", "fails_from_std", "distance_std"))
    end = 1.5 * fail
    bounds = [0.0, look, fail, end]
    parts = []
    for (left, right), colour in zip(pairwise(bounds), ("#ccebe5", "#fde6c4", "#fbd0d0"), strict=True):
        x, width = 200 * left / end, 200 * (right - left) / end
        parts.append(f'<rect x="{x:.1f}" y="10" width="{width:.1f}" height="10" fill="{colour}"/>')
    at = 200 * min(value, end) / end
    mark = f"M{at:.1f} 22l-5 8h10z" if value <= end else "M190 12l9 3l-9 3z"
    parts.append(f'<path d="{mark}" fill="{INK}" stroke="none"/>')
    parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="7" y2="23" stroke="{INK}" stroke-width="2"/>')
    label = f"{value:.1f} standard deviations; look at from {look:.1f}, does not hold from {fail:.1f}"
    return f'<svg class="gauge" viewBox="-4 4 210 28" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def by_radius(boards: Sequence[Mapping[str, Any]], centre_px: Sequence[float]) -> str:
    """Residuals along the radius over the distance from the lens' centre, with their mean over rings."""
    corners = np.concatenate([np.array(view["corners_px"], float).reshape(-1, 2) for view in boards])
    residuals = np.concatenate([np.array(view["residuals_px"], float).reshape(-1, 2) for view in boards])
    good = np.concatenate([np.array(view["good"], bool) for view in boards])
    away = corners - np.array(centre_px)
    radius = np.linalg.norm(away, axis=1)
    outward = (residuals * away).sum(axis=1) / np.maximum(radius, 1e-9)
    reach = float(np.abs(outward[good]).max()) if good.any() else 1.0
    axes = Axes((0.0, 1.05 * float(radius.max())), (-1.1 * reach, 1.1 * reach))
    title = "residuals by distance from the centre"
    parts = axes.frame(title, "distance from the lens' centre, px", "outward residual, px")
    parts.append(dots(axes, radius[good], outward[good], "#6cbfb4", 2.6))
    edges = np.quantile(radius[good], np.linspace(0, 1, 11)) if good.any() else np.zeros(0)
    rings = [good & (radius >= low) & (radius <= high) for low, high in pairwise(edges)]
    rings = [ring for ring in rings if ring.sum() >= 3]
    middle = np.array([radius[ring].mean() for ring in rings])
    mean = np.array([outward[ring].mean() for ring in rings])
    error = np.array([2 * outward[ring].std() / np.sqrt(ring.sum()) for ring in rings])
    parts.append(bars(axes, middle, mean - error, mean + error, INK, _BAR))
    parts.append(line(axes, middle, mean, INK, 2.0))
    parts.append(legend(axes, (Entry("#6cbfb4", "corner"), Entry(INK, "mean ± 2 std", "line"))))
    return axes.drawing(parts, title)


def views_rms(boards: Sequence[Mapping[str, Any]], expected_px: float | None) -> str:
    """Each picture's rms, the worst first where there are many."""
    shown = sorted(boards, key=lambda view: -float(view["rms_px"]))[:_MOST_VIEWS]
    shown = sorted(shown, key=lambda view: (view["folder"], view["name"]))
    most = max([float(view["rms_px"]) for view in shown] + ([expected_px] if expected_px else []))
    left = 14.0 + 8.2 * min(max(len(str(view["name"])) for view in shown), 24)
    axes = Axes(
        (0.0, 1.12 * most), (-0.5, len(shown) - 0.5), height=110.0 + 17.0 * len(shown), left=left, downward=True
    )
    title = "rms of every picture"
    parts = axes.frame(title, "rms, px", "", y_ticks=0)
    for row, view in enumerate(shown):
        y = float(axes.down(row))
        colour = AMBER if view["folder"] == "plane" else TEAL
        width = float(axes.across(view["rms_px"])) - left
        parts.append(f'<rect x="{left}" y="{y - 5:.1f}" width="{width:.1f}" height="10" rx="2" fill="{colour}"/>')
        name = escape(str(view["name"])[-24:])
        parts.append(f'<text x="{left - 7}" y="{y + 4:.1f}" text-anchor="end" class="key">{name}</text>')
    if expected_px:
        x = float(axes.across(expected_px))
        low, high = axes.top - 4, axes.height - axes.bottom
        parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{low}" y2="{high}" stroke="{INK}" stroke-dasharray="5 3"/>')
    expected = (Entry(INK, "expected", "dashes"),) if expected_px else ()
    parts.append(legend(axes, (Entry(TEAL, "intrinsics"), Entry(AMBER, "jig"), *expected)))
    return axes.drawing(parts, title)


def free_residuals(rows: Sequence[Mapping[str, Any]], length_mm: float) -> str:
    """The free antenna's residuals along it, one line a picture."""
    every = np.concatenate([np.array(row["residual_mm"], float) for row in rows])
    reach = max(1.15 * float(np.abs(every).max(initial=0.0)), 0.02)
    axes = Axes((0.0, length_mm), (-reach, reach))
    title = "free antenna: seen less predicted"
    parts = axes.frame(title, "distance from the clamp, mm", "residual across it, mm")
    for index, row in enumerate(rows):
        colour = _STILLS[index % len(_STILLS)]
        parts.append(line(axes, np.array(row["arclength_mm"]), np.array(row["residual_mm"]), colour, 1.6))
    named = [(_STILLS[index], str(row["image"])[-16:]) for index, row in enumerate(rows[:3])]
    if len(rows) > 3:
        named = [(_STILLS[0], f"{len(rows)} pictures, a colour each")]
    parts.append(legend(axes, [Entry(colour, words, "line") for colour, words in named]))
    return axes.drawing(parts, title)


def stiffness_by_load(loads: Sequence[Mapping[str, Any]]) -> str:
    """What each load by itself says of EI, against the rig's."""
    step = np.array([row["stiffness_percent"] for row in loads], float)
    std = np.array([row["stiffness_std_percent"] for row in loads], float)
    odd = np.array([row["look_at"] for row in loads], bool)
    number = np.arange(1, len(loads) + 1)
    axes = Axes((0.4, len(loads) + 0.6), span(np.concatenate([step - 2 * std, step + 2 * std, [0.0]])))
    title = "EI by each load, against the rig's"
    parts = axes.frame(title, "load", "difference of EI, %", x_ticks=min(len(loads) + 1, 12))
    parts.append(level(axes, 0.0))
    for chosen, colour in ((~odd, TEAL), (odd, RED)):
        parts.append(bars(axes, number[chosen], (step - 2 * std)[chosen], (step + 2 * std)[chosen], colour, _BAR))
        parts.append(dots(axes, number[chosen], step[chosen], colour, 8.0))
    parts.append(legend(axes, (Entry(TEAL, "± 2 std"), Entry(RED, "look at"))))
    return axes.drawing(parts, title)


def moments(rows: Sequence[Mapping[str, Any]], std_Nm: float) -> str:
    """The sensor's readings less what the rig predicts, free frames and loads."""
    residual = 1e3 * np.array([row["moment_residual_mNm"] for row in rows], float)
    loaded = np.array(["distance_mm" in row for row in rows], bool)
    number, std = np.arange(1, len(rows) + 1), 1e6 * std_Nm
    axes = Axes((0.4, len(rows) + 0.6), span(np.concatenate([residual, [3 * std, -3 * std]])))
    title = "moment: read less predicted"
    parts = [
        band(axes, np.array(axes.x), np.full(2, -2 * std), np.full(2, 2 * std), _NOISE, 0.35),
        *axes.frame(title, "picture", "residual, µN·m", x_ticks=min(len(rows) + 1, 12)),
    ]
    parts.append(level(axes, 0.0))
    for chosen, colour in ((~loaded, TEAL), (loaded, AMBER)):
        parts.append(dots(axes, number[chosen], residual[chosen], colour, 8.0))
    parts.append(legend(axes, (Entry(TEAL, "free"), Entry(AMBER, "loaded"), Entry(_NOISE, "noise ± 2 std", "band"))))
    return axes.drawing(parts, title)
