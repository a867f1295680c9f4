"""Plots over time: a quantity with its band, and what each frame was, as lanes. Any number of frames fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import pairwise

import numpy as np

from viz.plots.marks import INK, SOFT, Entry, band, bars, dots, legend, level, line
from viz.plots.svg import Axes, runs, span

from .clock import GAP, LEFT, Clock, by_column

MEASURED, TRUTH = "#0f766e", "#b45309"
MOST_DOTS = 1500
"""More frames than this are drawn as the range of each column of pixels."""


def curve(
    title: str,
    unit: str,
    clock: Clock,
    value: np.ndarray,
    std: np.ndarray,
    truth: np.ndarray | None = None,
    meaning: str = "estimate ± 2 std",
) -> str:
    """One quantity over time: points, band of two standard deviations, truth as a line.

    Parameters
    ----------
    value, std, truth : (B,) in `unit`, NaN where there is none.
    meaning : of points and band, for the legend.
    """
    reach = _reach(value, std, truth)
    axes = clock.axes(reach, 190.0)
    known = np.isfinite(value)
    spread = 2 * np.where(np.isfinite(std), std, 0.0)
    parts = axes.frame(f"{title}, {unit}", "", "", x_ticks=12)
    for x, low, high in _stretches(axes, clock, (value - spread)[known], (value + spread)[known], known):
        parts.append(band(axes, x, low, high, MEASURED))
    if truth is not None:
        parts += _truth(axes, clock, truth)
    if known.sum() <= MOST_DOTS:
        parts += [line(axes, clock.time_s[run], value[run], f"{MEASURED}77", 0.8) for run in clock.unbroken(known)]
        parts.append(dots(axes, clock.time_s[known], value[known], MEASURED))
    else:
        parts += _crowd(axes, clock.time_s[known], value[known], MEASURED)
    entries = [Entry(MEASURED, meaning), *([] if truth is None else [Entry(TRUTH, "truth", "line")])]
    return clock.drawing(axes, [*parts, legend(axes, entries)], title)


def signals(
    title: str,
    unit: str,
    clock: Clock,
    values: Sequence[tuple[str, str, np.ndarray]],
    noise_std: np.ndarray,
    noise: str,
) -> str:
    """Quantities that are 0 unless there is something to see, with the band of ± 2 std that noise alone would fill.

    Parameters
    ----------
    values : name, colour and (B,) of each in `unit`. noise_std : (B,) of any of them.
    noise : whose it is, for the legend.
    """
    shown = np.concatenate([value for _, _, value in values])
    low, high = span(np.concatenate([shown, [-2.5 * _usual(noise_std), 2.5 * _usual(noise_std)]]))
    axes = clock.axes((low, high), 190.0)
    parts = axes.frame(f"{title}, {unit}", "", "", x_ticks=12)
    known = np.isfinite(noise_std) & np.any([np.isfinite(value) for _, _, value in values], axis=0)
    for x, under, over in _stretches(axes, clock, -2 * noise_std[known], 2 * noise_std[known], known):
        parts.append(band(axes, x, under, over, SOFT, 0.25))
    parts.append(level(axes, 0.0, SOFT))
    for _, colour, value in values:
        there = np.isfinite(value)
        if there.sum() <= MOST_DOTS:
            parts.append(dots(axes, clock.time_s[there], value[there], colour, 4.4))
        else:
            parts += _crowd(axes, clock.time_s[there], value[there], colour)
    entries = [*(Entry(colour, name) for name, colour, _ in values), Entry(SOFT, f"± 2 std of {noise}", "band")]
    return clock.drawing(axes, [*parts, legend(axes, entries)], title)


def lanes(title: str, clock: Clock, label: Sequence[str], colour: Mapping[str, str], last: bool = False) -> str:
    """What every frame was: a lane for each label that occurs, in the order of `colour`, with its count.

    Parameters
    ----------
    label : (B,) of each frame, one of `colour`'s keys, or "" for none. Where there are more frames than pixels, a lane
        is as high as its share of them.
    last : write the time axis' label under it.
    """
    names, given = [name for name in colour if name in set(label)], np.asarray(label)
    high, top = 17.0, 34.0
    bottom = 46.0 if last else 24.0
    axes = clock.axes((0.0, max(len(names), 1) * high), top + max(len(names), 1) * high + bottom, bottom)
    parts = axes.frame(title, clock.label if last else "", "", x_ticks=12, y_ticks=0)
    start, end = clock.cells()
    for row, name in enumerate(names):
        here = given == name
        y = axes.top + row * high
        parts.append(
            f'<text x="{LEFT - 8:.0f}" y="{y + 12.5:.1f}" text-anchor="end">{escape(name)} ({int(here.sum())})</text>'
        )
        if len(given) > MOST_DOTS:
            found = _shares(axes, clock.time_s, here)
        else:
            found = [(a, b, 1.0) for a, b in _joined(axes.across(start[here]), axes.across(end[here]))]
        parts += [_cell(a, b, y + 2, (high - 4) * share, high - 4, colour[name]) for a, b, share in found]
    return clock.drawing(axes, parts, title)


def _cell(start: float, end: float, y: float, height: float, lane: float, colour: str) -> str:
    place = f'x="{start:.1f}" y="{y + lane - height:.1f}" width="{max(end - start, 1.0):.1f}" height="{height:.1f}"'
    return f'<rect {place} fill="{colour}" stroke="{INK}" stroke-opacity="0.25" stroke-width="0.5"/>'


def _shares(axes: Axes, time_s: np.ndarray, here: np.ndarray) -> list[tuple[float, float, float]]:
    """Stretches of pixel columns, and which share of their frames a lane has; no share is too small to be seen."""
    column = np.floor(axes.across(time_s)).astype(int)
    of = column - column.min()
    count, own = np.bincount(of), np.bincount(of, weights=here.astype(float))
    share = np.ceil(8 * own / np.maximum(count, 1)) / 8
    edges = np.concatenate([[0], np.flatnonzero(np.diff(share)) + 1, [len(share)]])
    first = float(column.min())
    return [
        (first + start, first + end, float(share[start])) for start, end in pairwise(edges.tolist()) if share[start] > 0
    ]


def _joined(start: np.ndarray, end: np.ndarray) -> list[tuple[float, float]]:
    """Stretches that touch as one, in pixels; at most one a pixel is left of any number."""
    if not len(start):
        return []
    apart = np.flatnonzero(start[1:] - end[:-1] > 1.0) + 1
    first, last = np.concatenate([[0], apart]), np.concatenate([apart - 1, [len(start) - 1]])
    return list(zip(start[first].tolist(), end[last].tolist(), strict=True))


def _stretches(
    axes: Axes, clock: Clock, low: np.ndarray, high: np.ndarray, known: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Unbroken stretches x, low, high, each a little wider than its frames so that a lone one is seen, too."""
    x, step = clock.time_s[known], clock.step_s
    if len(x) > MOST_DOTS:
        found = by_column(axes, x, low, high)
        x, low, high = found.x, found.low, found.high
        step = max(step, (axes.x[1] - axes.x[0]) / (axes.width - axes.left - axes.right))
    broken = np.flatnonzero(np.diff(x) > GAP * step) + 1
    return [
        (
            np.concatenate([[x[run[0]] - 0.4 * step], x[run], [x[run[-1]] + 0.4 * step]]),
            low[np.concatenate([run[:1], run, run[-1:]])],
            high[np.concatenate([run[:1], run, run[-1:]])],
        )
        for run in np.split(np.arange(len(x)), broken)
        if len(run)
    ]


def _crowd(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str) -> list[str]:
    """More points than pixels: pale from the least to the largest of a column, dark in their middle."""
    found = by_column(axes, x, y, y)
    return [bars(axes, found.x, found.low, found.high, f"{colour}55"), dots(axes, found.x, found.middle, colour, 2.0)]


def _truth(axes: Axes, clock: Clock, truth: np.ndarray) -> list[str]:
    known = np.isfinite(truth)
    if known.sum() > MOST_DOTS:
        return _crowd(axes, clock.time_s[known], truth[known], TRUTH)
    return [
        line(axes, clock.time_s[run], truth[run], TRUTH)
        if len(run) > 1
        else dots(axes, clock.time_s[run], truth[run], TRUTH, 3)
        for run in runs(known)
    ]


def _reach(value: np.ndarray, std: np.ndarray, truth: np.ndarray | None) -> tuple[float, float]:
    """Range of the plot: the values with their usual bands; what a band of a hopeless frame needs is cut."""
    spread = 2 * np.where(np.isfinite(std), np.minimum(std, 5 * _usual(std)), 0.0)
    return span(np.concatenate([value - spread, value + spread, *([] if truth is None else [truth])]))


def _usual(std: np.ndarray) -> float:
    finite = std[np.isfinite(std)]
    return float(np.median(finite)) if len(finite) else 0.0
