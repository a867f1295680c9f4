"""The strip under a debug picture: the verdict, the numbers in words, and what the colours mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from .canvas import BLACK, WHITE, Canvas, Colour, put, text_size, wrapped

_GROUND: Colour = (30, 26, 24)
_SOFT: Colour = (190, 182, 176)
_TEXT_SIZE = 0.5
_LINE_HEIGHT = 22
_MARGIN = 14


@dataclass(frozen=True)
class Key:
    """One entry of the legend: a sample of the mark, and what it means; `scale` (K, 3) is drawn as a bar."""

    words: str
    colour: Colour = WHITE
    mark: Literal["line", "dashes", "ring", "arrow", "scale"] = "line"
    scale: np.ndarray | None = None


def strip(
    width: int,
    unit: float,
    badge: tuple[str, Colour],
    heading: tuple[str, str],
    lines: Sequence[str],
    keys: Sequence[Key],
) -> np.ndarray:
    """An image (H, width, 3): the badge, headings to the left and the right, wrapped paragraphs, and the keys."""
    margin, step, size = round(_MARGIN * unit), round(_LINE_HEIGHT * unit), _TEXT_SIZE * unit
    inner = width - 2 * margin
    paragraphs = [wrapped(line, inner, size) for line in lines if line]
    rows = _in_rows(keys, inner, unit)
    height = 2 * margin + round(1.5 * step) + step * (sum(map(len, paragraphs)) + len(rows)) + step // 2
    image = np.full((height, width, 3), _GROUND, np.uint8)
    below = _headed(image, badge, heading, margin, unit)
    for index, paragraph in enumerate(paragraphs):
        for line in paragraph:
            below += step
            put(image, line, (margin, below), size, WHITE if index == 0 else _SOFT)
    below += step // 2
    for row in rows:
        below += step
        across = margin
        for key in row:
            _draw_key(image, key, (across, below), unit)
            across += _key_width(key, unit)
    return image


def _headed(image: np.ndarray, badge: tuple[str, Colour], heading: tuple[str, str], margin: int, unit: float) -> int:
    """Draw badge and headings, the right one as far as there is room; returns the base line."""
    word, colour = badge
    size, pad = 0.62 * unit, round(8 * unit)
    width, height = text_size(word, size, 2)
    base = margin + height + pad // 2
    cv2.rectangle(image, (margin, margin - pad // 2), (margin + width + 2 * pad, base + pad), colour, cv2.FILLED)
    ink = BLACK if np.dot(colour, (0.114, 0.587, 0.299)) > 110 else WHITE
    put(image, word, (margin + pad, base), size, ink, max(1, round(1.4 * unit)))
    size, left = 0.56 * unit, margin + width + 4 * pad
    put(image, heading[0], (left, base), size, WHITE)
    left += text_size(heading[0], size)[0] + 3 * pad
    room = image.shape[1] - margin - left
    for line in wrapped(heading[1], room, size)[:1] if room > 0 else []:
        put(image, line, (image.shape[1] - margin - text_size(line, size)[0], base), size, _SOFT)
    return base + pad // 2


def _key_width(key: Key, unit: float) -> int:
    """From where a key starts to where the next one does."""
    sample = round((44 if key.mark != "scale" else 100) * unit)
    return sample + text_size(key.words, 0.9 * _TEXT_SIZE * unit)[0] + round(18 * unit)


def _in_rows(keys: Sequence[Key], inner: int, unit: float) -> list[list[Key]]:
    rows: list[list[Key]] = [[]]
    used = 0
    for key in keys:
        width = _key_width(key, unit)
        if rows[-1] and used + width > inner:
            rows.append([])
            used = 0
        rows[-1].append(key)
        used += width
    return rows


def _draw_key(image: np.ndarray, key: Key, at: tuple[int, int], unit: float) -> None:
    """One key with its sample."""
    left, base = at
    middle = base - round(5 * unit)
    canvas = Canvas(image, 1.0, unit=unit)
    long = round((34 if key.mark != "scale" else 90) * unit)
    ends = np.array([[left, middle], [left + long, middle]], float)
    if key.mark == "scale" and key.scale is not None:
        bar = cv2.resize(key.scale[None], (long, max(3, round(9 * unit))), interpolation=cv2.INTER_LINEAR)
        top = middle - bar.shape[0] // 2
        there = image[top : top + bar.shape[0], left : left + long]
        there[:] = bar[: there.shape[0], : there.shape[1]]
    elif key.mark == "dashes":
        canvas.dashes(ends, key.colour, 1.5, 6.0)
    elif key.mark == "ring":
        canvas.ring(ends.mean(axis=0), 5.0, key.colour)
    elif key.mark == "arrow":
        canvas.arrow(ends[0], ends[1], key.colour)
    else:
        canvas.line(ends, key.colour, 2.0)
    put(image, key.words, (left + long + round(8 * unit), base), 0.9 * _TEXT_SIZE * unit, _SOFT)
