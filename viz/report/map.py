"""Map of the contacts: from above and from two sides, with their 2σ ellipses, in millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from viz.plots.marks import INK, SOFT, area, dots, ellipses, line
from viz.plots.svg import Axes

VIEWS = (("from above", 0, 1), ("from the side, along y", 0, 2), ("from the side, along x", 1, 2))
"""Name, and which world axes run to the right and up."""
RAMP = ("#352a87", "#2f6fb5", "#2a9d8f", "#8ab17d", "#e9c46a", "#f4a261", "#e76f51")
"""From early to late, dark to light: told apart without seeing colours, too."""
MOST_ELLIPSES, MOST_POINTS, MOST_TRIANGLES = 300, 2000, 3000
SIDE, LEFT, RIGHT, TOP, BOTTOM = 276.0, 62.0, 12.0, 34.0, 46.0
SEEN_PX, ENLARGEMENTS = 5.0, (1, 2, 5, 10, 20, 50, 100)
"""Ellipses whose usual radius is smaller than this are drawn so many times larger, which the key says."""
OBJECT, TRUTH = "#64748b", "#111827"


@dataclass(frozen=True, eq=False)
class Chart:
    """What the map shows, world frame.

    Attributes
    ----------
    points_m : (P, 3) contacts on the antenna's centreline. covariance_m2 : (P, 3, 3), NaN where it is not known.
    time_s : (P,) of each.
    surface_m : (V, 3) of the reconstructed object; lines (E, 2) and triangles (T, 3) into it.
    truth_m : (Q, 3) where the contacts truly were; Q is 0 where that is not known.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    time_s: np.ndarray
    surface_m: np.ndarray
    lines: np.ndarray
    triangles: np.ndarray
    truth_m: np.ndarray


def maps(chart: Chart) -> str:
    """The three views as SVG, all at one scale, and the key of their colours."""
    shown = 1e3 * np.concatenate([chart.points_m, chart.truth_m])
    middle, half = 0.5 * (shown.min(axis=0) + shown.max(axis=0)), 0.5 * float(np.ptp(shown, axis=0).max())
    half = 1.12 * max(half, 1.0)
    larger = _enlargement(chart.covariance_m2, 2 * half / SIDE)
    drawn = "".join(f"<div>{_view(chart, name, [i, j], middle, half, larger)}</div>" for name, i, j in VIEWS)
    return f'<div class="three">{drawn}</div>{_key(chart, larger)}'


def _enlargement(covariance_m2: np.ndarray, mm_per_px: float) -> int:
    """How many times larger ellipses are drawn, so that the usual one can be seen; 1 where it can."""
    size = 1e3 * np.sqrt(np.trace(covariance_m2, axis1=1, axis2=2))
    usual = 2 * float(np.median(size[np.isfinite(size)])) / mm_per_px if np.isfinite(size).any() else SEEN_PX
    return next((factor for factor in ENLARGEMENTS if factor * usual >= SEEN_PX), ENLARGEMENTS[-1])


def spread_out(number: int, most: int) -> np.ndarray:
    """Indices of at most `most` of `number` rows, evenly spread."""
    return np.unique(np.linspace(0, number - 1, min(number, most)).round().astype(int)) if number else np.zeros(0, int)


def colours(time_s: np.ndarray) -> list[str]:
    """A colour for each time (P,), from the first to the last."""
    first, last = (float(time_s.min()), float(time_s.max())) if len(time_s) else (0.0, 0.0)
    share = (time_s - first) / (last - first) if last > first else np.zeros(len(time_s))
    stops = np.array([list(bytes.fromhex(stop[1:])) for stop in RAMP], float)
    at = share * (len(RAMP) - 1)
    mixed = np.stack([np.interp(at, np.arange(len(RAMP)), stops[:, channel]) for channel in range(3)], axis=1)
    return ["#{:02x}{:02x}{:02x}".format(*(round(float(value)) for value in row)) for row in mixed]


def _view(chart: Chart, name: str, pair: list[int], middle_mm: np.ndarray, half_mm: float, larger: int) -> str:
    i, j = pair
    ranges = [(float(middle_mm[k] - half_mm), float(middle_mm[k] + half_mm)) for k in pair]
    axes = Axes(ranges[0], ranges[1], SIDE + LEFT + RIGHT, SIDE + TOP + BOTTOM, LEFT, RIGHT, TOP, BOTTOM)
    right, up = "XYZ"[i], "XYZ"[j]
    parts = axes.frame(name, f"{right}, mm", f"{up}, mm", x_ticks=5)
    parts += _surface(axes, chart, pair)
    if len(chart.truth_m):
        true = 1e3 * chart.truth_m[spread_out(len(chart.truth_m), MOST_POINTS)]
        parts.append(_crosses(axes, true[:, i], true[:, j]))
    parts += _contacts(axes, chart, pair, larger)
    return axes.drawing(parts, f"contacts {name}")


def _contacts(axes: Axes, chart: Chart, pair: list[int], larger: int) -> list[str]:
    known = np.flatnonzero(np.isfinite(chart.covariance_m2).all(axis=(1, 2)))
    known = known[spread_out(len(known), MOST_ELLIPSES)]
    block = chart.covariance_m2[known][:, pair][:, :, pair]
    colour = colours(chart.time_s)
    centre, area_mm2 = 1e3 * chart.points_m[known][:, pair], 1e6 * larger**2 * block
    parts = [ellipses(axes, centre, area_mm2, [colour[k] for k in known])]
    shown = spread_out(len(chart.points_m), MOST_POINTS)
    for first in np.array_split(shown, min(24, max(len(shown), 1))):
        if len(first):
            at = 1e3 * chart.points_m[first][:, pair]
            parts.append(dots(axes, at[:, 0], at[:, 1], colour[first[len(first) // 2]], 3.6))
    return parts


def _surface(axes: Axes, chart: Chart, pair: list[int]) -> list[str]:
    at = 1e3 * chart.surface_m[:, pair] if len(chart.surface_m) else np.zeros((0, 2))
    faces = chart.triangles[spread_out(len(chart.triangles), MOST_TRIANGLES)]
    parts = [area(axes, at[face, 0], at[face, 1], OBJECT, 0.13) for face in faces]
    return parts + [line(axes, at[edge, 0], at[edge, 1], OBJECT, 1.6) for edge in chart.lines[:MOST_TRIANGLES]]


def _crosses(axes: Axes, x: np.ndarray, y: np.ndarray) -> str:
    places = zip(axes.across(x), axes.down(y), strict=True)
    path = "".join(f"M{a - 2:.1f} {b - 2:.1f}l4 4m0 -4l-4 4" for a, b in places)
    return f'<path d="{path}" stroke="{TRUTH}" stroke-width="0.8"/>'


def _key(chart: Chart, larger: int) -> str:
    lasted = float(np.ptp(chart.time_s))
    bar = "".join(f'<i style="background:{colour}"></i>' for colour in RAMP)
    entries = [f'<span>first contact <span class="ramp">{bar}</span> {lasted:.4g} s later</span>']
    size = f", drawn {larger} times larger" if larger > 1 else ""
    entries.append(f"<span>point: contact, coloured by time; ellipse: ± 2 std{size}</span>")
    if len(chart.lines) or len(chart.triangles):
        entries.append(f'<span><i class="dot" style="background:{OBJECT}"></i>reconstructed object</span>')
    if len(chart.truth_m):
        entries.append(f'<span><b style="color:{TRUTH}">×</b> truth</span>')
    return f'<p class="keys">{"".join(entries)}</p>'


def scatter_across(force_mN: np.ndarray, std_mN: np.ndarray, time_s: np.ndarray) -> str:
    """The force across the antenna: f_z over f_y, each contact an arrow's head from the origin (paper, Fig. 5).

    Parameters
    ----------
    force_mN, std_mN : (P, 2) y and z in the antenna frame; std NaN where it is not known. time_s : (P,).
    """
    reach = 1.12 * max(float(np.abs(force_mN).max(initial=0.0)), 1e-6)
    axes = Axes((-reach, reach), (-reach, reach), 480.0, 440.0, 90.0, 68.0, 70.0, 48.0)
    title = "force across the antenna"
    parts = axes.frame(title, "f_y, mN", "f_z, mN")
    zero = np.zeros(2)
    ends = np.array([-reach, reach])
    parts += [line(axes, ends, zero, SOFT, 1.0), line(axes, zero, ends, SOFT, 1.0)]
    shown = spread_out(len(force_mN), MOST_POINTS)
    colour = colours(time_s)
    for index in shown[: MOST_ELLIPSES if len(shown) <= MOST_ELLIPSES else 0]:
        tip = force_mN[index]
        parts.append(line(axes, np.array([0.0, tip[0]]), np.array([0.0, tip[1]]), colour[index], 0.5))
    known = shown[np.isfinite(std_mN[shown]).all(axis=1)]
    known = known[spread_out(len(known), MOST_ELLIPSES)]
    own = std_mN[known, :, None] ** 2 * np.eye(2)
    parts.append(ellipses(axes, force_mN[known], own, [colour[index] for index in known]))
    for part in np.array_split(shown, min(24, max(len(shown), 1))):
        if len(part):
            parts.append(dots(axes, force_mN[part, 0], force_mN[part, 1], colour[part[len(part) // 2]], 3.6))
    parts.append(dots(axes, np.zeros(1), np.zeros(1), INK, 5.0))
    return axes.drawing(parts, title)


def mesh_arrays(surface: object | None) -> Sequence[np.ndarray]:
    """Points (V, 3), lines (E, 2) and triangles (T, 3) of anything that has them; empty for None."""
    if surface is None:
        return np.zeros((0, 3)), np.zeros((0, 2), int), np.zeros((0, 3), int)
    return tuple(np.asarray(getattr(surface, name)) for name in ("points_m", "lines", "triangles"))
