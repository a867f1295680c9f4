"""Figures over time: a quantity with its band, and the states of frames as lanes, for any number of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from markupsafe import Markup

from vbaa_calib.core.robust import finite_median

from .drawing import Plot, limits
from .settings import STYLE


class TimeAxis:
    """The time axis of all figures over time. Times (B,), B ≥ 1, that begin far from 0 are relative to the first.

    time_s : (B,) since `start_s`, rising. step_s : the usual time between frames; 1 for a single frame.
    ends_s : half a step before the first frame and after the last. pixel_s : time per pixel.
    events_s : times of events, with words: drawn through every figure.
    """

    def __init__(self, time_s: np.ndarray, events_s: Sequence[tuple[float, str]] = ()) -> None:
        self.start_s = 0.0 if 0 <= time_s[0] <= 1e4 else float(time_s[0])
        self.time_s, steps = time_s - self.start_s, np.diff(time_s)
        self.step_s = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
        self.ends_s = float(self.time_s[0]) - 0.5 * self.step_s, float(self.time_s[-1]) + 0.5 * self.step_s
        self.pixel_s = (self.ends_s[1] - self.ends_s[0]) / STYLE.plot_px
        finite = [(at - self.start_s, words) for at, words in events_s if np.isfinite(at)]
        self.events_s = finite if len(finite) <= STYLE.most_events else []

    def axes(self, title: str, y: tuple[float, float], height: float = 190.0, bottom: float = 24.0) -> Plot:
        """Axes over the whole recording."""
        return Plot(
            title, (STYLE.width_px, height), (STYLE.left_px, STYLE.right_px, STYLE.top_px, bottom), self.ends_s, y
        )

    def columns(self, time_s: np.ndarray) -> np.ndarray:
        """The pixel column, from 0, of each time."""
        first, last = self.ends_s
        return np.floor((time_s - first) / (last - first) * STYLE.plot_px).astype(int)

    def gathered(self, time_s: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, ...]:
        """Values from low to high (N,) grouped by pixel column: time, least, middle and largest of each, (C,)."""
        column = self.columns(time_s)
        order = np.lexsort((low + high, column))
        found, first, count = np.unique(column[order], return_index=True, return_counts=True)
        if not len(found):
            return (np.zeros(0),) * 4
        start, end = self.ends_s
        centre = start + (found + 0.5) / STYLE.plot_px * (end - start)
        middle = 0.5 * (low + high)[order][first + count // 2]
        return centre, np.minimum.reduceat(low[order], first), middle, np.maximum.reduceat(high[order], first)

    def svg(self, axes: Plot) -> Markup:
        """The figure with its events, and with the scale for the page's time cursor."""
        for at, words in self.events_s:
            axes.upright(at, dashes=(3, 3), tip=words)
        first, last = (end + self.start_s for end in self.ends_s)
        right = STYLE.left_px + STYLE.plot_px
        scale = (
            f'data-left="{STYLE.left_px:g}" data-right="{right:g}" data-first="{first:.15g}" data-last="{last:.15g}"'
        )
        return axes.svg(attributes=f'class="time" {scale}')


def curve(
    clock: TimeAxis,
    title: str,
    value: np.ndarray,
    std: np.ndarray,
    truth: np.ndarray | None = None,
    shared: np.ndarray | None = None,
) -> Plot:
    """One quantity over time: points, band of two standard deviations, truth as a line.

    With the part of the deviations that all frames share, the band shows that part, and bars each frame's own.

    value, std, truth, shared : (B,) in one unit, NaN where there is none.
    """
    # the values with their usual bands: the band of a frame that is hardly known is cut
    usual = 2 * np.where(np.isfinite(std), np.minimum(std, 5 * finite_median(std)), 0.0)
    axes = clock.axes(title, limits(value - usual, value + usual, [] if truth is None else truth))
    meaning = "estimate ± 2 std" if np.isfinite(std).any() else "each frame"
    apart = shared is not None and bool(np.isfinite(shared).any())
    spread = 2 * np.nan_to_num(shared if apart and shared is not None else std)
    _bands(axes, clock, value - spread, value + spread, STYLE.estimate)
    if apart:
        own = 2 * np.sqrt(np.clip(np.nan_to_num(std) ** 2 - (spread / 2) ** 2, 0.0, None))
        known = np.isfinite(value)
        x, low, high = clock.time_s[known], (value - own)[known], (value + own)[known]
        if len(x) > STYLE.most_dots:
            x, low, _, high = clock.gathered(x, low, high)
        axes.bars(x, low, high, f"{STYLE.estimate}99")
        meaning = "estimate ± 2 std, its own"
    if truth is not None:
        _lines(axes, clock, truth, STYLE.truth, 1.6)
        known = np.isfinite(truth)
        alone = known & ~np.append(known[1:], False) & ~np.append(False, known[:-1])
        _points(axes, clock, np.where(alone | (known.sum() > STYLE.most_dots), truth, np.nan), STYLE.truth, 3.0)
    _lines(axes, clock, value, f"{STYLE.estimate}77", 0.8)
    _points(axes, clock, value, STYLE.estimate)
    both = [(STYLE.estimate, "shared", "band")] if apart else []
    axes.legend([(STYLE.estimate, meaning, "dot"), *both, *([] if truth is None else [(STYLE.truth, "truth", "line")])])
    return axes


def with_framewise(axes: Plot, clock: TimeAxis, value: np.ndarray) -> Plot:
    """The plot of a refined quantity with its frame-by-frame values (B,) added in grey."""
    _points(axes, clock, value, STYLE.soft, 1.6)
    return replace(axes, title=f"{axes.title}; grey: frame by frame")


def signals(
    clock: TimeAxis, title: str, values: Sequence[tuple[str, str, np.ndarray]], noise_std: np.ndarray, noise: str
) -> Plot:
    """Quantities that are 0 unless something is wrong, with the ± 2 std band of their noise.

    values : name, colour and (B,) of each in one unit. noise_std : (B,) of any of them.
    noise : its source, for the legend.
    """
    usual = np.nan_to_num(finite_median(noise_std))
    axes = clock.axes(title, limits(*(value for _, _, value in values), [-2.5 * usual, 2.5 * usual]))
    known = np.isfinite(noise_std) & np.any([np.isfinite(value) for _, _, value in values], axis=0)
    spread = np.where(known, 2 * noise_std, np.nan)
    _bands(axes, clock, -spread, spread, STYLE.soft)
    axes.level()
    for _, colour, value in values:
        _points(axes, clock, value, colour, 4.4)
    axes.legend([*((colour, name, "dot") for name, colour, _ in values), (STYLE.soft, f"± 2 std of {noise}", "band")])
    return axes


def lanes(clock: TimeAxis, title: str, label: Sequence[str], colour: Mapping[str, str], last: bool = False) -> Plot:
    """The states of the frames: a lane for each label that occurs, in the order of `colour`, with its count.

    label : (B,) of each frame, one of `colour`'s keys, or "" for none. Where there are more frames than pixels, a lane
        is as high as its share of them.
    last : write the time axis' label under it.
    """
    labels, names = np.asarray(label), [name for name in colour if name in set(label)]
    written = [f"{name} ({int((labels == name).sum())})" for name in names]
    count, bottom = max(len(names), 1), 46.0 if last else 24.0
    axes = replace(
        clock.axes(title, (count, 0.0), STYLE.top_px + 17.0 * count + bottom, bottom),
        grid="x",
        y_ticks=([row + 0.5 for row in range(len(names))], written),
        labels=(("time, s" if clock.start_s == 0 else f"time after {clock.start_s:.15g} s, s") * last, ""),
    )
    for row, name in enumerate(names):
        start, end, share = _stretches(clock, labels == name)
        base, lane = row + 0.88, 0.76
        top = base - lane * share
        corners = [(start, top), (end, top), (end, np.full_like(end, base)), (start, np.full_like(end, base))]
        boxes = np.stack([np.column_stack(corner) for corner in (*corners, corners[0])], axis=1)
        axes.paths(boxes[:, :-1], name, fill=colour[name], stroke=f"{STYLE.ink}40", width=0.5)
    return axes


def _stretches(clock: TimeAxis, here: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start, end and share (0 to 1) of each stretch of a lane; the share is never too small to be visible."""
    first, pixel = clock.ends_s[0], clock.pixel_s
    if len(here) > STYLE.most_dots:
        column = clock.columns(clock.time_s)
        frames, own = np.bincount(column), np.bincount(column, weights=here.astype(float))
        share = np.ceil(8 * own / np.maximum(frames, 1)) / 8
        edges = np.concatenate([[0], np.flatnonzero(np.diff(share)) + 1, [len(share)]])
        kept = np.flatnonzero(share[edges[:-1]] > 0)
        return first + pixel * edges[kept], first + pixel * edges[kept + 1], share[edges[kept]]
    # a frame stands for half the way to its neighbours, at most half a usual gap
    half, own_s = np.minimum(0.5 * np.diff(clock.time_s), 0.5 * STYLE.gap * clock.step_s), 0.5 * clock.step_s
    start = (clock.time_s - np.concatenate([[own_s], half]))[here]
    end = (clock.time_s + np.concatenate([half, [own_s]]))[here]
    apart = np.flatnonzero(start[1:] - end[:-1] > pixel)
    start, end = start[np.concatenate([[0], apart + 1])], end[np.concatenate([apart, [len(end) - 1]])]
    return start, np.maximum(end, start + pixel), np.ones(len(start))


def _bands(axes: Plot, clock: TimeAxis, low: np.ndarray, high: np.ndarray, colour: str) -> None:
    """Draw the band between low and high (B,) by unbroken stretches, each a little wider than its frames so that a
    single one is visible."""
    known = np.isfinite(low) & np.isfinite(high)
    x, low, high, step = clock.time_s[known], low[known], high[known], clock.step_s
    if len(x) > STYLE.most_dots:
        x, low, _, high = clock.gathered(x, low, high)
        step = max(step, clock.pixel_s)
    for run in np.split(np.arange(len(x)), np.flatnonzero(np.diff(x) > STYLE.gap * step) + 1):
        if len(run):
            wide = np.concatenate([[x[run[0]] - 0.4 * step], x[run], [x[run[-1]] + 0.4 * step]])
            inner = np.concatenate([run[:1], run, run[-1:]])
            axes.band(wide, low[inner], high[inner], colour)


def _points(axes: Plot, clock: TimeAxis, value: np.ndarray, colour: str, size: float = 5.0) -> None:
    """Draw a point for each frame; where there are more frames than pixels, the range of each column pale and its
    middle dark."""
    known = np.isfinite(value)
    x, value = clock.time_s[known], value[known]
    if len(x) > STYLE.most_dots:
        x, low, value, high = clock.gathered(x, value, value)
        axes.bars(x, low, high, f"{colour}55")
        size = 2.0
    axes.dots(x, value, colour, size)


def _lines(axes: Plot, clock: TimeAxis, value: np.ndarray, colour: str, width: float) -> None:
    """Draw lines between known neighbours (B,) without a gap between them, unless there are too many."""
    index = np.flatnonzero(np.isfinite(value))
    if len(index) > STYLE.most_dots:
        return
    apart = (np.diff(index) > 1) | (np.diff(clock.time_s[index]) > STYLE.gap * clock.step_s)
    for run in np.split(index, np.flatnonzero(apart) + 1):
        if len(run) > 1:
            axes.line(clock.time_s[run], value[run], colour, width)
