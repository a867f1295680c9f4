"""Small plots as inline SVG: no plotting library, no resources outside the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np


def ticks(low: float, high: float, number: int = 5) -> list[float]:
    """Round values inside [low, high], at most about `number`, in steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / number
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough * (1 - 1e-9))
    first = np.ceil(low / step - 1e-9)
    return [float(step * index) for index in np.arange(first, np.floor(high / step + 1e-9) + 1)]


def runs(known: np.ndarray) -> list[np.ndarray]:
    """Indices of the unbroken stretches of True in known (N,)."""
    index = np.flatnonzero(known)
    return [run for run in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(run)]


def span(values: np.ndarray, margin: float = 0.08) -> tuple[float, float]:
    """Range of the finite ones of values (any shape), widened by a margin to both sides; never empty."""
    finite = np.asarray(values, float)[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    wider = margin * (high - low) or 0.1 * abs(high) or 1.0
    return low - wider, high + wider


@dataclass(frozen=True)
class Axes:
    """A plot with two axes: what is drawn in it is placed by `across` and `down`.

    Attributes
    ----------
    x, y : ranges. downward : y grows downward, as a picture's rows do.
    width, height : of the whole drawing; left, right, top, bottom : its margins.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    width: float = 520.0
    height: float = 344.0
    left: float = 76.0
    right: float = 18.0
    top: float = 54.0
    bottom: float = 50.0
    downward: bool = False

    def across(self, values: np.ndarray | float) -> np.ndarray:
        """Horizontal places of x values."""
        inner = self.width - self.left - self.right
        return self.left + (np.asarray(values, float) - self.x[0]) / (self.x[1] - self.x[0]) * inner

    def down(self, values: np.ndarray | float) -> np.ndarray:
        """Vertical places of y values."""
        share = (np.asarray(values, float) - self.y[0]) / (self.y[1] - self.y[0])
        return self.top + (share if self.downward else 1.0 - share) * (self.height - self.top - self.bottom)

    def frame(self, title: str, x_label: str, y_label: str, x_ticks: int = 6, y_ticks: int = 5) -> list[str]:
        """Grid, ticks, labels with their units, and the title."""
        low, base = self.top, self.height - self.bottom
        parts = [f'<text x="{self.left:.0f}" y="{max(self.top - 32, 14):.0f}" class="title">{escape(title)}</text>']
        for tick in ticks(*self.x, x_ticks) if x_ticks else ():
            at = float(self.across(tick))
            parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{low:.1f}" y2="{base:.1f}" class="grid"/>')
            parts.append(f'<text x="{at:.1f}" y="{base + 17:.1f}" text-anchor="middle">{_tick(tick)}</text>')
        for tick in ticks(*self.y, y_ticks) if y_ticks else ():
            at = float(self.down(tick))
            ends = f'x1="{self.left:.1f}" x2="{self.width - self.right:.1f}"'
            parts.append(f'<line {ends} y1="{at:.1f}" y2="{at:.1f}" class="grid"/>')
            parts.append(f'<text x="{self.left - 7:.1f}" y="{at + 4:.1f}" text-anchor="end">{_tick(tick)}</text>')
        middle, height = 0.5 * (self.left + self.width - self.right), 0.5 * (low + base)
        if x_label:
            parts.append(f'<text x="{middle:.0f}" y="{base + 38:.0f}" text-anchor="middle">{escape(x_label)}</text>')
        if y_label:
            turned = f'transform="rotate(-90 15 {height:.0f})" text-anchor="middle"'
            parts.append(f'<text x="15" y="{height:.0f}" {turned}>{escape(y_label)}</text>')
        return parts

    def drawing(self, parts: Sequence[str], title: str, attributes: str = "") -> str:
        """The whole SVG; `attributes` are further ones of its tag."""
        view, own = f"0 0 {self.width:.0f} {self.height:.0f}", f" {attributes}" if attributes else ""
        return f'<svg{own} viewBox="{view}" role="img" aria-label="{escape(title)}">{"".join(parts)}</svg>'


def _tick(value: float) -> str:
    return f"{value:.6g}".replace("-", "−") if value else "0"
