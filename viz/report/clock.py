"""The time axis that the report's plots share, and how any number of frames is gathered in its columns of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from viz.plots.marks import upright
from viz.plots.svg import Axes

LEFT, RIGHT, WIDTH = 148.0, 14.0, 960.0
MOST_EVENTS = 40
GAP = 3.0
"""Frames farther apart than so many usual steps are not joined."""


@dataclass(frozen=True, eq=False)
class Clock:
    """The time axis that all plots share.

    Attributes
    ----------
    time_s : (B,) since `start_s`, rising. step_s : the usual time between frames; 1 for a single frame.
    events_s : when something happened, with words: drawn through every plot.
    """

    time_s: np.ndarray
    start_s: float
    step_s: float
    events_s: tuple[tuple[float, str], ...] = ()

    @staticmethod
    def of(time_s: np.ndarray, events_s: Sequence[tuple[float, str]] = ()) -> Clock:
        """From the frames' times (B,), B ≥ 1. A clock that does not start near 0 is told from its first frame."""
        start = 0.0 if 0 <= time_s[0] <= 1e4 else float(time_s[0])
        steps = np.diff(time_s)
        step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
        shown = tuple((at - start, words) for at, words in events_s if np.isfinite(at))
        return Clock(time_s - start, start, step, shown if len(shown) <= MOST_EVENTS else ())

    @property
    def label(self) -> str:
        """What stands under the time axis."""
        return "time, s" if self.start_s == 0 else f"time after {self.start_s:.15g} s, s"

    def axes(self, y: tuple[float, float], height: float, bottom: float = 24.0) -> Axes:
        """A plot over the whole recording."""
        first, last = float(self.time_s[0]), float(self.time_s[-1])
        x = (first - 0.5 * self.step_s, last + 0.5 * self.step_s)
        return Axes(x, y, WIDTH, height, LEFT, RIGHT, 34.0, bottom)

    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """(B,) start and end of what each frame stands for: half way to its neighbours, at most half a usual gap."""
        half = np.minimum(0.5 * np.diff(self.time_s), 0.5 * GAP * self.step_s)
        own = 0.5 * self.step_s
        return self.time_s - np.concatenate([[own], half]), self.time_s + np.concatenate([half, [own]])

    def unbroken(self, known: np.ndarray) -> list[np.ndarray]:
        """Indices of the frames that are known (B,), parted where others or a gap lie between; two frames or more."""
        index = np.flatnonzero(known)
        apart = (np.diff(index) > 1) | (np.diff(self.time_s[index]) > GAP * self.step_s)
        return [run for run in np.split(index, np.flatnonzero(apart) + 1) if len(run) > 1]

    def drawing(self, axes: Axes, parts: Sequence[str], title: str) -> str:
        """The whole plot with the events as upright lines, and its scale for the page's time cursor."""
        first, last = axes.x
        scale = f'data-left="{axes.left:g}" data-right="{axes.width - axes.right:g}"'
        times = f'data-first="{first + self.start_s:.15g}" data-last="{last + self.start_s:.15g}"'
        events = [upright(axes, at, title=words) for at, words in self.events_s]
        return axes.drawing([*parts, *events], title, f'class="time" {scale} {times}')


@dataclass(frozen=True, eq=False)
class Columns:
    """What lies in each column of pixels: its middle's time, the least, middle and largest value, (C,) each."""

    x: np.ndarray
    low: np.ndarray
    middle: np.ndarray
    high: np.ndarray


def by_column(axes: Axes, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> Columns:
    """Values from low to high at x, (N,) each, gathered in the columns of pixels that hold any."""
    column = np.floor(axes.across(x)).astype(int)
    order = np.lexsort((low + high, column))
    found, first, count = np.unique(column[order], return_index=True, return_counts=True)
    if not len(found):
        return Columns(*(np.zeros(0) for _ in range(4)))
    inner = axes.width - axes.left - axes.right
    centre = axes.x[0] + (found + 0.5 - axes.left) / inner * (axes.x[1] - axes.x[0])
    middle = 0.5 * (low + high)[order][first + count // 2]
    return Columns(centre, np.minimum.reduceat(low[order], first), middle, np.maximum.reduceat(high[order], first))
