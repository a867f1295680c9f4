"""Small plots as inline SVG: no plotting library, no resources outside the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

WIDTH, HEIGHT = 960, 210
LEFT, RIGHT, TOP, BOTTOM = 64, 14, 30, 26
MEASURED, BAND, TRUTH = "#0d9488", "#0d9488", "#b45309"


def ticks(low: float, high: float, number: int = 5) -> list[float]:
    """Round values inside [low, high], at most about `number`, in steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / number
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough * (1 - 1e-9))
    first = np.ceil(low / step - 1e-9)
    return [float(step * index) for index in np.arange(first, np.floor(high / step + 1e-9) + 1)]


def runs(known: np.ndarray) -> list[np.ndarray]:
    """Indices of the unbroken stretches of True."""
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
        parts = [f'<text x="{self.left:.0f}" y="{self.top - 32:.0f}" class="title">{escape(title)}</text>']
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
        parts.append(f'<text x="{middle:.0f}" y="{base + 38:.0f}" text-anchor="middle">{escape(x_label)}</text>')
        turned = f'transform="rotate(-90 15 {height:.0f})" text-anchor="middle"'
        parts.append(f'<text x="15" y="{height:.0f}" {turned}>{escape(y_label)}</text>')
        return parts

    def drawing(self, parts: Sequence[str], title: str) -> str:
        """The whole SVG."""
        view = f"0 0 {self.width:.0f} {self.height:.0f}"
        return f'<svg viewBox="{view}" role="img" aria-label="{escape(title)}">{"".join(parts)}</svg>'


def _tick(value: float) -> str:
    return f"{value:.6g}".replace("-", "−") if value else "0"


def curve(
    title: str, unit: str, frame: np.ndarray, value: np.ndarray, std: np.ndarray, truth: np.ndarray | None = None
) -> str:
    """One quantity over the frames: points, band of ±2 standard deviations, truth as a line.

    Parameters
    ----------
    frame : (B,). value, std, truth : (B,) in `unit`, NaN where there is none.
    """
    band = 2 * np.nan_to_num(std)
    shown = [value - band, value + band, *([] if truth is None else [truth])]
    low, high = span(np.concatenate(shown))

    def x(numbers: np.ndarray) -> np.ndarray:
        return _place(frame, numbers)

    def y(numbers: np.ndarray) -> np.ndarray:
        return TOP + (high - numbers) / (high - low) * (HEIGHT - TOP - BOTTOM)

    parts = [_frame_axis(frame)]
    for tick in ticks(low, high):
        height = float(y(np.array(tick)))
        parts.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{height:.1f}" y2="{height:.1f}" class="grid"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{height + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for run in runs(np.isfinite(value) & np.isfinite(std)):
        # half a frame to both sides, so that a lone frame has a visible band, too
        at = np.concatenate([[frame[run[0]] - 0.4], frame[run], [frame[run[-1]] + 0.4]])
        held = np.concatenate([[run[0]], run, [run[-1]]])
        upper, lower = _points(x(at), y((value + band)[held])), _points(x(at)[::-1], y((value - band)[held])[::-1])
        parts.append(f'<polygon points="{upper} {lower}" fill="{BAND}" opacity="0.22"/>')
    if truth is not None:
        for run in runs(np.isfinite(truth)):
            line = _points(x(frame[run]), y(truth[run]))
            parts.append(f'<polyline points="{line}" fill="none" stroke="{TRUTH}" stroke-width="1.6"/>')
    known = np.isfinite(value)
    for across, down in zip(x(frame[known]), y(value[known]), strict=True):
        parts.append(f'<circle cx="{across:.1f}" cy="{down:.1f}" r="2.4" fill="{MEASURED}"/>')
    parts.append(f'<text x="{LEFT}" y="16" class="title">{escape(title)}, {escape(unit)}</text>')
    parts.append(_key([(MEASURED, "estimated ± 2 std"), *([] if truth is None else [(TRUTH, "truth")])]))
    return _svg(HEIGHT, parts, title)


def strip(title: str, frame: np.ndarray, label: Sequence[str], colour: Mapping[str, str]) -> str:
    """One coloured cell per frame: what became of it."""
    height = 78
    width = max(0.92 * (WIDTH - LEFT - RIGHT) / (float(np.ptp(frame)) + 1), 1.0)
    parts = [
        f'<rect x="{across - width / 2:.2f}" y="30" width="{width:.2f}" height="22" fill="{colour[text]}">'
        f"<title>frame {number}: {escape(text)}</title></rect>"
        for across, number, text in zip(_place(frame, frame), frame, label, strict=True)
    ]
    parts.append(_frame_axis(frame, height))
    parts.append(f'<text x="{LEFT}" y="16" class="title">{escape(title)}</text>')
    parts.append(_key([(colour[text], f"{text} ({list(label).count(text)})") for text in dict.fromkeys(label)]))
    return _svg(height, parts, title)


def _place(frame: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Horizontal position of frame numbers."""
    first, span = float(frame.min()) - 0.5, float(np.ptp(frame)) + 1.0
    return LEFT + (numbers - first) / span * (WIDTH - LEFT - RIGHT)


def _frame_axis(frame: np.ndarray, height: int = HEIGHT) -> str:
    low, high = float(frame.min()), float(frame.max())
    at = np.unique([round(tick) for tick in ticks(low, high, 12)]) if high > low else np.array([low])
    return "".join(
        f'<text x="{across:.1f}" y="{height - 8}" text-anchor="middle">{number:g}</text>'
        for number, across in zip(at, _place(frame, at), strict=True)
    )


def _key(entries: Sequence[tuple[str, str]]) -> str:
    parts, right = [], WIDTH - RIGHT
    for colour, text in reversed(entries):
        right -= 7 * len(text) + 24
        parts.append(f'<rect x="{right}" y="7" width="10" height="10" rx="2" fill="{colour}"/>')
        parts.append(f'<text x="{right + 15}" y="16">{escape(text)}</text>')
    return "".join(parts)


def _points(x: np.ndarray, y: np.ndarray) -> str:
    return " ".join(f"{across:.1f},{down:.1f}" for across, down in zip(x, y, strict=True))


def _svg(height: int, parts: Sequence[str], title: str) -> str:
    return f'<svg viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{escape(title)}">{"".join(parts)}</svg>'
