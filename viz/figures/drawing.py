"""Common parts of all figures: axes of a fixed size with ticks, marks in the data's units, conversion to SVG."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import groupby
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from viz.scene.readable import hexes, on_ramp, round_down

from .settings import STYLE

_THEMED = re.compile(
    r"#(ffffff|1f2937|111827|334155|5b6676|64748b|dde3ea|eceff3|0f766e|b45309|dc2626|0072b2|c2410c|7c3aed|12355b)\b"
)
"""Colours for which a page in the dark has others, by the variables of `viz/pages/templates/style.css`."""
Places = Sequence[float] | np.ndarray
Ticks = tuple[Sequence[float], Sequence[str]]
"""Places on an axis, and what is written at each."""


@dataclass(frozen=True, eq=False)
class PlotMarks:
    """Marks of the same appearance, in the units of their axes.

    Attributes
    ----------
    name : of the kind, for readers of the code. points : (N, K, 2) N lines or outlines; K = 1 for dots.
    fill, stroke : colours "#rrggbb" or "#rrggbbaa"; "" for none. width : of the stroke, px.
    dashes : px on and off. round_ends : dots and joints are round.
    ellipse : `points` (N, 3, 2) are centres and an end of each of two conjugate half axes.
    tip : shows while the mouse is over it.
    """

    name: str
    points: np.ndarray
    fill: str = ""
    stroke: str = ""
    width: float = 1.0
    dashes: tuple[float, ...] = ()
    round_ends: bool = False
    ellipse: bool = False
    tip: str = ""


@dataclass(frozen=True, eq=False)
class Plot:
    """Axes in a figure of `size` (width, height) px with `margins` left, right, top, bottom; limits `x`, `y`,
    increasing or decreasing. Drawing appends to `marks` in order, and SVG to `under` and `over` them."""

    title: str
    size: tuple[float, float] = (520.0, 344.0)
    margins: tuple[float, float, float, float] = (76.0, 18.0, 54.0, 50.0)
    x: tuple[float, float] = (0.0, 1.0)
    y: tuple[float, float] = (0.0, 1.0)
    labels: tuple[str, str] = ("", "")
    x_ticks: Ticks | None = None
    y_ticks: Ticks | None = None
    grid: str = "xy"
    marks: list[PlotMarks] = field(default_factory=list)
    under: list[str] = field(default_factory=list)
    over: list[str] = field(default_factory=list)
    key: list[tuple[str, str, str]] = field(default_factory=list)

    @property
    def inner(self) -> tuple[float, float]:
        """Width and height of the plotting area, px."""
        (width, height), (left, right, top, bottom) = self.size, self.margins
        return width - left - right, height - top - bottom

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(…, 2) px from the plot's upper left corner, of points (…, 2) in the axes' units."""
        low, high = np.array([self.x, self.y[::-1]]).T
        return (np.asarray(points, float) - low) / (high - low) * self.inner

    def svg(self, name: str = "", attributes: str = "") -> Markup:
        """The figure for a page.

        name : for readers who do not see it; the title without one. attributes : further ones of the tag, as HTML.
        """
        (width, height), (left, right, top, _), (wide, tall) = self.size, self.margins, self.inner
        x_ticks, y_ticks = self.x_ticks or ticks_in(*self.x), self.y_ticks or ticks_in(*self.y)
        x, x_names = _on_axis(self, 0, *x_ticks)
        y, y_names = _on_axis(self, 1, *y_ticks)
        lines = "".join(f"M{at:.1f} 0v{tall:g}" for at in x if "x" in self.grid)
        lines += "".join(f"M0 {at:.1f}h{wide:g}" for at in y if "y" in self.grid)
        parts = [
            f'<svg x="{left:g}" y="{top:g}" width="{wide:g}" height="{tall:g}">',
            *self.under,
            f'<path class="grid" d="{lines}"/>' if lines else "",
            *_drawn(self),
            "</svg>",
            *(_text(left + at, top + tall + 17, words, "middle") for at, words in zip(x, x_names, strict=True)),
            *(_text(left - 7, top + at + 4.5, words, "end") for at, words in zip(y, y_names, strict=True)),
            *self.over,
        ]
        if self.labels[0]:
            parts.append(_text(left + wide / 2, top + tall + 36, self.labels[0], "middle"))
        if self.labels[1]:
            # pages set letters a fifth larger on narrow screens
            away = max(left - 15 - 1.2 * STYLE.letter_px * max(map(len, y_names), default=0), 13.0)
            parts.append(_text(away, top + tall / 2, self.labels[1], "middle", turned=True))
        # the title moves up where the key would run into it
        long = 1.14 * STYLE.letter_px * len(self.title)
        long += sum(STYLE.letter_px * (len(words) + 3.5) for _, words, _ in self.key) if self.key and top <= 40 else 0
        more = 20 if long > wide else 0
        if self.title:
            parts.append(_text(left, (24 if top > 40 else top - 10) - more, self.title, "start", "title"))
        if self.key:
            side = f'x="{width - right:g}" y="{top - 8:g}" text-anchor="end"'
            entries = "".join(map(_entry, self.key)).replace(' dx="13"', "", 1)
            parts.append(f'<text class="legend" {side}>{entries}</text>')
        box = f"0 {-more} {width:g} {height + more:g}"
        name = escape(name or self.title)
        return Markup(f'<svg {attributes} viewBox="{box}" role="img" aria-label="{name}">{"".join(parts)}</svg>')

    def paths(self, points: ArrayLike, name: str, **look: Any) -> None:
        """Draw N lines or, with `fill`, polygons of K corners, (N, K, 2), as one mark."""
        points = np.asarray(points, float)
        if len(points):
            self.marks.append(PlotMarks(name, points, **look))

    def line(self, x: Places, y: Places, colour: str, width: float = 1.0, name: str = "line", **look: Any) -> None:
        """Draw a line through x, y (K,)."""
        self.paths(np.column_stack([x, y])[None], name, stroke=colour, width=width, **look)

    def level(self, y: float = 0.0, colour: str = STYLE.soft) -> None:
        """Draw a horizontal line at y."""
        self.line(self.x, (y, y), colour, name="level")

    def upright(self, x: float, colour: str = STYLE.soft, **look: Any) -> None:
        """Draw a vertical line at x."""
        self.line((x, x), self.y, colour, name="upright", **look)

    def write(self, at: Places, words: str, anchor: str, kind: str = "", shift: Places = (0.0, 0.0)) -> None:
        """Write text over the marks at a place (2,), shifted to the right and down by px. anchor : start, middle or
        end. kind : a class of style.css."""
        x, y = (self.pixels(np.asarray(at)) + np.array(self.margins)[[0, 2]] + shift).tolist()
        self.over.append(_text(x, y, words, anchor, kind))

    def dots(self, x: np.ndarray, y: np.ndarray, colour: str, size: float = 5.0) -> None:
        """Draw filled points at x, y (N,), as one short path however many there are."""
        if len(x):
            at = np.column_stack([x, y]).astype(float)[:, None]
            self.marks.append(PlotMarks("dots", at, stroke=colour, width=size, round_ends=True))

    def bars(self, x: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str, width: float = 1.3) -> None:
        """Draw vertical bars from low to high (N,), clipped at the plot's edge."""
        ends = [np.column_stack([x, np.clip(end, min(self.y), max(self.y))]) for end in (low, high)]
        self.paths(np.stack(ends, axis=1), "bars", stroke=colour, width=width)

    def band(self, x: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str, alpha: float = 0.22) -> None:
        """Fill the area between low and high (N,) over x, clipped at the plot's edge."""
        low, high = (np.clip(end, min(self.y), max(self.y)) for end in (low, high))
        outline = np.column_stack([np.concatenate([x, x[::-1]]), np.concatenate([high, low[::-1]])])
        self.paths(outline[None], "band", fill=pale(colour, alpha))

    def ellipses(self, centre: np.ndarray, covariance: np.ndarray, colours: Sequence[str]) -> None:
        """Draw ellipses of two standard deviations around centre (N, 2) by covariance (N, 2, 2), in N colours."""
        variance, turn = np.linalg.eigh(covariance)
        half_axes = turn * 2.0 * np.sqrt(np.clip(variance, 0.0, None))[:, None, :]
        shapes = centre[:, None] + np.concatenate([np.zeros((len(centre), 1, 2)), np.swapaxes(half_axes, 1, 2)], axis=1)
        for group in _groups(len(centre)):
            colour = colours[group[len(group) // 2]]
            fill, stroke = pale(colour, 0.22), pale(colour, 0.7)
            self.marks.append(PlotMarks("ellipses", shapes[group], fill, stroke, 0.7, ellipse=True))

    def dots_by_time(self, at: np.ndarray, time_s: np.ndarray) -> None:
        """Draw points (P, 2) in the order of time, coloured by it in a few groups."""
        colours = time_colours(time_s)
        for group in _groups(len(at)):
            self.dots(at[group, 0], at[group, 1], colours[group[len(group) // 2]], 3.6)

    def legend(self, entries: Sequence[tuple[str, str, str]]) -> None:
        """Draw a legend in one row above the plot, on the right: (colour, words, mark).

        A mark is "dot", "ring", "line", "dashes", "block" or, paler, "band".
        """
        self.key.extend(entries)


def _entry(entry: tuple[str, str, str]) -> str:
    colour, words, sign = entry
    look = _colour("fill", pale(colour, 0.35) if sign == "band" else colour)
    signs = {"dot": "●", "ring": "○", "line": "━", "dashes": "╍", "band": "■", "block": "■"}
    return f'<tspan style="{look}" dx="13">{signs[sign]}</tspan><tspan dx="4">{escape(words, quote=False)}</tspan>'


def key_rows(entries: Sequence[tuple[str, str, str]], width_px: float) -> list[str]:
    """A legend's entries (as in `Plot.legend`) as SVG texts, as many rows as a width needs."""
    rows, used = [""], 0.0
    for entry in entries:
        wide = STYLE.letter_px * (len(entry[1]) + 5)
        if rows[-1] and used + wide > width_px:
            rows, used = [*rows, ""], 0.0
        rows[-1], used = rows[-1] + _entry(entry), used + wide
    return rows


def _text(x: float, y: float, words: str, anchor: str, kind: str = "", turned: bool = False) -> str:
    """SVG text at (x, y) px; `turned` text reads upwards."""
    turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turned else ""
    look = f' class="{kind}"' if kind else ""
    side = f' text-anchor="{anchor}"' if anchor != "start" else ""
    return f'<text{look} x="{x:.1f}" y="{y:.1f}"{side}{turn}>{escape(words, quote=False)}</text>'


def picture(image: bytes, corners_px: np.ndarray) -> str:
    """SVG of a PNG or JPEG with its upper left, upper right and lower left corners at (3, 2) px."""
    kind = "png" if image.startswith(b"\x89PNG") else "jpeg"
    data = base64.b64encode(image).decode()
    start, right, down = corners_px
    turn = " ".join(f"{value:.2f}" for value in (*(right - start), *(down - start), *start))
    size = f'width="1" height="1" preserveAspectRatio="none" transform="matrix({turn})"'
    return f'<image {size} href="data:image/{kind};base64,{data}"/>'


def ticks_in(low: float, high: float, most: int = 8, least_step: float = 0.0) -> Ticks:
    """At most `most` round tick positions between two ends, and their labels."""
    low, high = min(low, high), max(low, high)
    step = max(round_down(2.5 * (high - low) / most), least_step)
    number = np.arange(int(np.ceil(low / step - 1e-6)), int(np.floor(high / step + 1e-6)) + 1)
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    largest = max(abs(low), abs(high))
    plain = largest < 1e7 and decimals <= 6
    names = [f"{step * one:.{decimals}f}" if plain else f"{step * one:.6g}" for one in number]
    return (step * number).tolist(), [name.replace("-", "−") for name in names]


def _on_axis(axes: Plot, axis: int, places: Sequence[float], names: Sequence[str]) -> tuple[np.ndarray, list[str]]:
    """The ticks on an axis: pixels along it, and labels."""
    points = np.zeros((len(places), 2))
    points[:, axis] = places
    at = axes.pixels(points)[:, axis]
    here = (at > -0.5) & (at < axes.inner[axis] + 0.5)
    return at[here], [name for name, is_here in zip(names, here, strict=True) if is_here]


def _drawn(axes: Plot) -> Iterator[str]:
    """SVG of the marks; consecutive marks of the same appearance become one path."""
    described = ((_look(mark), mark.tip, mark) for mark in axes.marks)
    for (look, tip), marks in groupby(described, key=lambda one: one[:2]):
        shapes = ((mark, axes.pixels(mark.points)) for _, _, mark in marks)
        path = "".join(
            _arcs(at[:, 0], at[:, 1:] - at[:, :1]) if mark.ellipse else _path(at, closed=bool(mark.fill))
            for mark, at in shapes
        )
        drawn = f'<path style="{look}" d="{path}"/>'
        yield f"<g><title>{escape(tip)}</title>{drawn}</g>" if tip else drawn


def _path(points_px: np.ndarray, closed: bool = False) -> str:
    """SVG path of (N, K, 2) px as N lines, closed outlines if `closed`, or dots if K = 1, without those that contain
    NaN."""
    points_px = points_px[np.isfinite(points_px).all(axis=(1, 2))]
    count, corners = points_px.shape[:2]
    one = "M%.1f %.1f" + ("h0" if corners == 1 else "L" + " ".join(["%.1f %.1f"] * (corners - 1))) + "z" * closed
    return (one * count % tuple(np.clip(points_px, -1e5, 1e5).ravel().tolist())).replace(".0", "")


def _arcs(centre_px: np.ndarray, half_axes_px: np.ndarray) -> str:
    """SVG path of ellipses with centres (N, 2) and two conjugate half axes (N, 2, 2), one a row, px."""
    known = np.isfinite(half_axes_px).all(axis=(1, 2)) & np.isfinite(centre_px).all(axis=1)
    centre, (turned, radii, _) = centre_px[known], np.linalg.svd(np.swapaxes(half_axes_px[known], 1, 2))
    angle = np.degrees(np.arctan2(turned[:, 1, 0], turned[:, 0, 0]))
    radii, ends = np.maximum(radii, 0.05), turned[:, :, 0] * np.maximum(radii, 0.05)[:, :1]
    numbers = np.column_stack([centre - ends, radii, angle, 2 * ends, radii, angle, -2 * ends])
    one = "M%.1f %.1fa%.2f %.2f %.0f 1 0 %.1f %.1fa%.2f %.2f %.0f 1 0 %.1f %.1fz"
    return one * len(numbers) % tuple(np.clip(numbers, -1e5, 1e5).ravel().tolist())


def _look(mark: PlotMarks) -> str:
    """CSS of a mark's appearance. Colours that differ in a page's dark mode are its variables."""
    parts = [_colour("fill", mark.fill)]
    if mark.stroke:
        parts += [_colour("stroke", mark.stroke), f"stroke-width:{mark.width:.3g}"]
        parts += [f"stroke-dasharray:{' '.join(f'{one:g}' for one in mark.dashes)}"] if mark.dashes else []
        parts += ["stroke-linecap:round"] if mark.round_ends else []
    return ";".join(parts)


def _colour(what: str, colour: str) -> str:
    """CSS of a colour "#rrggbb" or "#rrggbbaa", the page's variable where it has one; "" is none."""
    if not colour:
        return f"{what}:none"
    opacity = f";{what}-opacity:{int(colour[7:], 16) / 255:.2g}" if len(colour) > 7 else ""
    return f"{what}:" + _THEMED.sub(r"var(--c\1,#\1)", colour[:7]) + opacity


def time_colours(time_s: np.ndarray) -> list[str]:
    """A colour for each time (P,), from the first to the last."""
    first, last = (float(time_s.min()), float(time_s.max())) if len(time_s) else (0.0, 0.0)
    return hexes(on_ramp(STYLE.ramp, (time_s - first) / (last - first) if last > first else np.zeros(len(time_s))))


def _groups(count: int) -> list[np.ndarray]:
    """Indices of consecutive times that share a colour, group by group."""
    return [group for group in np.array_split(np.arange(count), 16) if len(group)]


def limits(*values: np.ndarray | Sequence[float]) -> tuple[float, float]:
    """Limits of an axis for all finite values: their range plus a margin, never empty."""
    joined = np.concatenate([np.ravel(value) for value in values])
    finite = joined[np.isfinite(joined)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    wider = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return low - wider, high + wider


def pale(colour: str, alpha: float) -> str:
    """A colour "#rrggbb" with an opacity."""
    return f"{colour}{round(255 * alpha):02x}"
