"""Marks in a plot: dots, bars, lines, bands, ellipses and a legend as SVG, placed by `svg.Axes`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from .svg import Axes

INK, SOFT = "#1f2937", "#5b6676"
ELLIPSE_STD = 2.0


@dataclass(frozen=True)
class Entry:
    """One line of a legend. `mark` is "dot", "ring", "line", "dashes" or "band"."""

    colour: str
    text: str
    mark: str = "dot"


def dots(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str, size: float = 5.0) -> str:
    """Filled points at x, y (N,)."""
    path = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in _placed(axes, x, y))
    return f'<path d="{path}" stroke="{colour}" stroke-width="{size:g}" stroke-linecap="round"/>' if path else ""


def rings(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str, radius: float = 3.2) -> str:
    """Hollow points at x, y (N,)."""
    r = f"{radius:g}"
    around = f"a{r} {r} 0 1 0 {2 * radius:g} 0a{r} {r} 0 1 0 {-2 * radius:g} 0"
    path = "".join(f"M{a - radius:.1f} {b:.1f}{around}" for a, b in _placed(axes, x, y))
    return f'<path d="{path}" style="fill:#fff" stroke="{colour}" stroke-width="1.5"/>' if path else ""


def bars(axes: Axes, x: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str, width: float = 1.3) -> str:
    """Upright bars from low to high (N,), cut at the plot's edge."""
    down = [axes.down(np.clip(ends, *axes.y)) for ends in (low, high)]
    path = "".join(f"M{a:.1f} {b:.1f}V{c:.1f}" for a, b, c in zip(axes.across(x), *down, strict=True))
    return f'<path d="{path}" stroke="{colour}" stroke-width="{width:g}"/>' if path else ""


def line(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str, width: float = 1.6, dashes: str = "") -> str:
    """A line through x, y (N,)."""
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in _placed(axes, x, y))
    look = f'stroke="{colour}" stroke-width="{width:g}" stroke-linejoin="round"'
    return f'<polyline points="{points}" fill="none" {look}{dashed}/>'


def area(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str, opacity: float) -> str:
    """A filled polygon with corners x, y (N,), pulled to the plot's edge where it reaches beyond."""
    placed = _placed(axes, np.clip(x, *axes.x), np.clip(y, *axes.y))
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in placed)
    return f'<polygon points="{points}" fill="{colour}" opacity="{opacity:g}"/>'


def band(axes: Axes, x: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str, opacity: float = 0.22) -> str:
    """What lies between low and high (N,) over x."""
    return area(axes, np.concatenate([x, x[::-1]]), np.concatenate([high, low[::-1]]), colour, opacity)


def level(axes: Axes, value: float, colour: str = INK, dashes: str = "") -> str:
    """A level line through the whole plot."""
    return line(axes, np.array(axes.x), np.full(2, value), colour, 1.0, dashes)


def upright(axes: Axes, at: float, colour: str = SOFT, dashes: str = "3 3", title: str = "") -> str:
    """An upright line through the whole plot."""
    x = float(axes.across(at))
    told = f"<title>{escape(title)}</title>" if title else ""
    ends = f'x1="{x:.1f}" x2="{x:.1f}" y1="{axes.top:.1f}" y2="{axes.height - axes.bottom:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-dasharray="{dashes}">{told}</line>'


def ellipses(axes: Axes, centre: np.ndarray, covariance: np.ndarray, colours: Sequence[str]) -> str:
    """Ellipses of two standard deviations around centre (N, 2) by covariance (N, 2, 2), both in the plot's units."""
    scale = np.array([axes.across(1.0) - axes.across(0.0), axes.down(1.0) - axes.down(0.0)])
    variance, turn = np.linalg.eigh(covariance * np.outer(scale, scale))
    radius = ELLIPSE_STD * np.sqrt(np.clip(variance, 0.0, None))
    angle = np.degrees(np.arctan2(turn[:, 1, 1], turn[:, 0, 1]))
    return "".join(
        f'<ellipse rx="{large:.2f}" ry="{small:.2f}" transform="translate({a:.1f} {b:.1f}) rotate({degrees:.1f})" '
        f'fill="{colour}" fill-opacity="0.22" stroke="{colour}" stroke-opacity="0.7" stroke-width="0.7"/>'
        for (small, large), (a, b), degrees, colour in zip(
            radius, _placed(axes, centre[:, 0], centre[:, 1]), angle, colours, strict=True
        )
    )


def words(axes: Axes, x: float, y: float, text: str, anchor: str = "start", style: str = "halo") -> str:
    """A few words at a place of the plot."""
    place = f'x="{float(axes.across(x)):.1f}" y="{float(axes.down(y)):.1f}"'
    return f'<text {place} class="{style}" text-anchor="{anchor}">{escape(text)}</text>'


def legend(axes: Axes, entries: Sequence[Entry]) -> str:
    """Marks and words in one row above the plot, to the right."""
    parts, right, y = [], axes.width - axes.right, axes.top - 10
    for entry in reversed(entries):
        right -= 6.9 * len(entry.text) + 30
        parts.append(_mark(entry, right, y))
        parts.append(f'<text x="{right + 18:.0f}" y="{y + 4:.0f}" class="key">{escape(entry.text)}</text>')
    return "".join(parts)


def _mark(entry: Entry, x: float, y: float) -> str:
    colour = entry.colour
    if entry.mark == "dot":
        return f'<circle cx="{x + 7:.0f}" cy="{y:.0f}" r="3.4" fill="{colour}"/>'
    if entry.mark == "ring":
        return f'<circle cx="{x + 7:.0f}" cy="{y:.0f}" r="3.2" fill="#fff" stroke="{colour}" stroke-width="1.5"/>'
    if entry.mark == "band":
        return f'<rect x="{x:.0f}" y="{y - 5:.0f}" width="14" height="10" rx="2" fill="{colour}" opacity="0.35"/>'
    dashed = ' stroke-dasharray="4 3"' if entry.mark == "dashes" else ""
    ends = f'x1="{x:.0f}" x2="{x + 14:.0f}" y1="{y:.0f}" y2="{y:.0f}"'
    return f'<line {ends} stroke="{colour}" stroke-width="2"{dashed}/>'


def _placed(axes: Axes, x: np.ndarray, y: np.ndarray) -> list[tuple[float, float]]:
    return list(zip(axes.across(x).tolist(), axes.down(y).tolist(), strict=True))
