"""What all figures share: style, axes of a fixed size, marks, and the way into a page as SVG with text as text."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from html import escape
from typing import Any

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import LinearSegmentedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

INK, SOFT = "#1f2937", "#5b6676"
TEAL, AMBER, RED, SLATE = "#0f766e", "#b45309", "#dc2626", "#64748b"
ESTIMATE, TRUTH = TEAL, AMBER
RAMP = tuple(to_hex(colour) for colour in colormaps["viridis"](np.linspace(0.28, 0.88, 7)))
"""From early to late, dark to light: distinguishable without colour vision, and on a page of either brightness."""
_THEMED = re.compile(
    r"#(ffffff|1f2937|111827|334155|5b6676|64748b|dde3ea|eceff3|0f766e|b45309|dc2626|0072b2|c2410c|7c3aed|12355b)\b"
)
"""Colours for which a page in the dark has others, by the variables of `viz/pages/templates/style.css`."""
_ELLIPSE_STD = 2.0
_TIME = LinearSegmentedColormap.from_list("time", RAMP)
_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}
style = matplotlib.rc_context(
    {
        "svg.fonttype": "none",
        "svg.hashsalt": "vbaa",
        "path.simplify": False,
        "font.family": "DejaVu Sans",
        "font.size": 12.5,
        "text.color": INK,
        "axes.titlesize": 14,
        "axes.titleweight": "bold",
        "axes.titlecolor": INK,
        "axes.titlelocation": "left",
        "axes.labelcolor": SOFT,
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.formatter.useoffset": False,
        "axes.formatter.limits": (-5, 7),
        "axes.spines.left": False,
        "axes.spines.right": False,
        "axes.spines.top": False,
        "axes.spines.bottom": False,
        "grid.color": "#dde3ea",
        "grid.linewidth": 1.0,
        "xtick.color": SOFT,
        "ytick.color": SOFT,
        "xtick.major.size": 0.0,
        "ytick.major.size": 0.0,
        "legend.frameon": False,
        "legend.borderaxespad": 0.0,
        "legend.columnspacing": 1.2,
        "legend.handlelength": 1.1,
        "legend.handletextpad": 0.5,
        "legend.labelcolor": SOFT,
    }
)
"""Decorates every function that draws or writes."""


@style
def new_axes(
    title: str,
    size: tuple[float, float] = (520.0, 344.0),
    margins: tuple[float, float, float, float] = (76.0, 18.0, 54.0, 50.0),
    x: tuple[float, float] = (0.0, 1.0),
    y: tuple[float, float] = (0.0, 1.0),
    labels: tuple[str, str] = ("", ""),
) -> Axes:
    """Axes in a figure of (width, height) pixels with margins left, right, top, bottom; limits `x`, `y`."""
    (width, height), (left, right, top, bottom) = size, margins
    figure = Figure(figsize=(width / 72, height / 72), dpi=72)
    FigureCanvasSVG(figure)
    inside = (left / width, bottom / height, (width - left - right) / width, (height - top - bottom) / height)
    axes = figure.add_axes(inside)
    axes.set(xlim=x, ylim=y, xlabel=labels[0], ylabel=labels[1])
    axes.set_title(title, y=1.0, pad=top - 24 if top > 40 else 10)
    return axes


@style
def svg(axes: Axes, name: str = "", attributes: str = "") -> Markup:
    """The figure for a page. What an artist's gid says after "tip:" shows while the mouse is over it.

    name : for readers who do not see it; the title without one. attributes : further ones of the tag, as HTML.
    """
    name, text = name or axes.get_title(loc="left"), io.StringIO()
    matplotlib.rcParams["svg.hashsalt"] = name
    figure = axes.figure
    assert isinstance(figure, Figure)
    figure.savefig(text, format="svg", metadata=_METADATA)
    body = text.getvalue()
    body = body[body.index('<g id="figure_1">') :]
    body = re.sub(r'<g id="tip:([^"]*)">', r"<g><title>\1</title>", body)
    body = body.replace('<g id="legend_1">', '<g class="legend">')
    body = re.sub(r' id="[A-Za-z0-9.]+_\d+"', "", body)
    body = re.sub(r' style="[^"]*"', lambda look: _THEMED.sub(r"var(--c\1, #\1)", look.group()), body)
    body = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+|\s*\n", r"\1", path.group()), body)
    width, height = 72 * figure.get_size_inches()
    return Markup(
        f'<svg {attributes} viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{escape(name)}">{body}'
    )


def paths(axes: Axes, points: np.ndarray, *, closed: bool = False, **look: object) -> None:
    """N lines or filled polygons of K corners, (N, K, 2), as one artist; nothing for none."""
    points = np.asarray(points, float)
    if not len(points):
        return
    codes = np.full(points.shape[:2], Path.LINETO, Path.code_type)
    codes[:, 0] = Path.MOVETO
    axes.add_artist(PathPatch(Path(points.reshape(-1, 2), codes.ravel()), fill=closed, **look))


def dots(axes: Axes, x: np.ndarray, y: np.ndarray, colour: object, size: float = 5.0) -> None:
    """Filled points at x, y (N,); any number of them is one short path."""
    at = np.column_stack([x, y])
    paths(axes, np.stack([at, at], axis=1), ec=colour, lw=size, capstyle="round", label="dots")


def bars(axes: Axes, x: np.ndarray, low: np.ndarray, high: np.ndarray, colour: object, width: float = 1.3) -> None:
    """Upright bars from low to high (N,), cut at the plot's edge."""
    ends = [np.column_stack([x, np.clip(end, *axes.get_ylim())]) for end in (low, high)]
    paths(axes, np.stack(ends, axis=1), ec=colour, lw=width, label="bars")


def band(axes: Axes, x: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str, alpha: float = 0.22) -> None:
    """What lies between low and high (N,) over x, cut at the plot's edge."""
    low, high = (np.clip(end, *axes.get_ylim()) for end in (low, high))
    outline = np.column_stack([np.concatenate([x, x[::-1]]), np.concatenate([high, low[::-1]])])
    paths(axes, outline[None], closed=True, fc=colour, ec="none", alpha=alpha, label="band")


def ellipses(axes: Axes, centre: np.ndarray, covariance: np.ndarray, colours: np.ndarray) -> None:
    """Ellipses of two standard deviations around centre (N, 2) by covariance (N, 2, 2); colours (N, 4)."""
    variance, turn = np.linalg.eigh(covariance)
    half_axes = turn * _ELLIPSE_STD * np.sqrt(np.clip(variance, 0.0, None))[:, None, :]
    angle = np.linspace(0, 2 * np.pi, 25)
    outline = centre[:, None] + np.einsum("nij,kj->nki", half_axes, np.column_stack([np.cos(angle), np.sin(angle)]))
    for group in _groups(len(centre)):
        rgb = tuple(colours[group[len(group) // 2]][:3])
        paths(axes, outline[group], closed=True, fc=(*rgb, 0.22), ec=(*rgb, 0.7), lw=0.7, label="ellipses")


def time_colours(time_s: np.ndarray) -> np.ndarray:
    """(P, 4) a colour for each time (P,), from the first to the last."""
    first, last = (float(time_s.min()), float(time_s.max())) if len(time_s) else (0.0, 0.0)
    return _TIME((time_s - first) / (last - first) if last > first else np.zeros(len(time_s)))


def dots_by_time(axes: Axes, at: np.ndarray, time_s: np.ndarray) -> None:
    """Points (P, 2) in the order of time, coloured by it: a few groups of equal colour."""
    colours = time_colours(time_s)
    for group in _groups(len(at)):
        dots(axes, at[group, 0], at[group, 1], tuple(colours[group[len(group) // 2]]), 3.6)


def _groups(count: int) -> list[np.ndarray]:
    """Neighbours in time that share a colour."""
    return [group for group in np.array_split(np.arange(count), 16) if len(group)]


@style
def legend(axes: Axes, entries: Sequence[tuple[str, str, str]]) -> None:
    """Marks and words in one row above the plot, to the right: (colour, words, mark).

    A mark is "dot", "ring", "line", "dashes" or "band".
    """
    point: dict[str, Any] = {"ls": "", "marker": "o", "ms": 6.5}
    looks: dict[str, dict[str, Any]] = {
        "line": {"lw": 2, "ls": "-"},
        "dashes": {"lw": 2, "ls": (0, (2, 1.5))},
        "ring": {**point, "mfc": "white", "mew": 1.5},
        "dot": {**point, "mew": 0},
    }
    handles = [
        Patch(fc=colour, alpha=0.35) if mark == "band" else Line2D([], [], color=colour, **looks[mark])
        for colour, _, mark in entries
    ]
    words = [words for _, words, _ in entries]
    axes.legend(handles, words, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(words))


def limits(*values: np.ndarray | Sequence[float]) -> tuple[float, float]:
    """Range of the finite ones of all values, a little wider to both sides; never empty."""
    joined = np.concatenate([np.ravel(value) for value in values])
    finite = joined[np.isfinite(joined)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    wider = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return low - wider, high + wider
