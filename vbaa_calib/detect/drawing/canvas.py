"""A colour picture to draw on in camera pixels, enlarged if small, with a legend below it."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from vbaa_calib.core.polyline import arc_lengths

from .settings import DrawingSettings

Colour = tuple[int, int, int]
"""Blue, green, red, 0–255."""

WHITE: Colour = (255, 255, 255)  # of titles, clamp and tip
_BLACK: Colour = (0, 0, 0)  # edge of marks and labels
_PARTS_BITS = 4
"""Canvas coordinates are drawn to a sixteenth of a pixel."""
_FARTHEST = 8000.0
"""Limit of coordinates, since OpenCV's have few bits."""


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture to draw on; points are in camera pixels, their centres whole numbers.

    image : (H, W, 3) uint8, blue, green, red. scale : canvas pixels per camera pixel.
    origin_px : (2,) camera pixel at the middle of the canvas' upper left pixel, if `scale` is 1.
    unit : thickness of a plain line, canvas pixels.
    """

    image: np.ndarray
    scale: float
    origin_px: tuple[float, float] = (0.0, 0.0)
    unit: float = 1.0

    @staticmethod
    def over(grey: np.ndarray) -> Canvas:
        """A canvas with a grey picture (H, W) uint8, enlarged by a whole factor if it is small."""
        width = grey.shape[1]
        scale = (
            DrawingSettings.widest_px / width
            if width > DrawingSettings.widest_px
            else float(max(1, round(DrawingSettings.narrowest_px / width)))
        )
        size = (max(1, round(scale * width)), max(1, round(scale * grey.shape[0])))
        large = cv2.resize(grey, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST)
        return Canvas(cv2.cvtColor(large, cv2.COLOR_GRAY2BGR), scale, unit=float(np.clip(size[0] / 1100.0, 1.0, 1.8)))

    def cut(self, grey: np.ndarray, centre_px: np.ndarray, radius_px: float, size: int) -> Canvas:
        """A square canvas of `size` with the part of a grey picture (H, W) around a point (2,)."""
        scale = size / (2.0 * radius_px)
        origin = (float(centre_px[0] - radius_px + 0.5), float(centre_px[1] - radius_px + 0.5))
        back = np.array([[1 / scale, 0, origin[0] - 0.5 + 0.5 / scale], [0, 1 / scale, origin[1] - 0.5 + 0.5 / scale]])
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        large = cv2.warpAffine(grey, back, (size, size), flags=flags, borderMode=cv2.BORDER_CONSTANT)
        return Canvas(cv2.cvtColor(large, cv2.COLOR_GRAY2BGR), scale, origin, self.unit)

    def at(self, points_px: np.ndarray) -> np.ndarray:
        """Canvas coordinates of points (..., 2)."""
        return (np.asarray(points_px, float) - self.origin_px + 0.5) * self.scale - 0.5

    def line(self, points_px: np.ndarray, colour: Colour, thick: float = 1.0) -> None:
        """Draw a polyline through the finite ones of points (M, 2)."""
        places = self._places(points_px)
        if len(places) >= 2:
            cv2.polylines(self.image, [places], False, colour, self._thickness(thick), cv2.LINE_AA, _PARTS_BITS)

    def dashes(self, points_px: np.ndarray, colour: Colour, thick: float = 1.0, dash: float = 9.0) -> None:
        """Draw a dashed polyline; dashes and gaps are `dash` canvas pixels long."""
        points = np.asarray(points_px, float)
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2:
            return
        along = arc_lengths(points) * self.scale
        for begin in np.arange(0.0, min(along[-1], _FARTHEST), 2.0 * dash * self.unit):
            at = np.linspace(begin, min(begin + dash * self.unit, along[-1]), 4)
            piece = np.stack([np.interp(at, along, points[:, i]) for i in range(2)], axis=1)
            self.line(piece, colour, thick)

    def graded(self, points_px: np.ndarray, colours: np.ndarray, thick: float = 2.0, gap_px: float = 2.5) -> None:
        """Draw points (N, 2) of colours (N, 3), joined where they are at most `gap_px` apart."""
        places = self._places(points_px, keep=True)
        near = np.hypot(*np.diff(points_px, axis=0).T) <= gap_px if len(points_px) > 1 else np.zeros(0, bool)
        for index, (place, colour) in enumerate(zip(places, colours.tolist(), strict=True)):
            end = places[index + 1] if index < len(near) and near[index] else place
            cv2.line(self.image, tuple(place), tuple(end), colour, self._thickness(thick), cv2.LINE_AA, _PARTS_BITS)

    def ring(self, point_px: np.ndarray, radius: float, colour: Colour, thick: float = 1.5) -> None:
        """Draw a circle of a radius in canvas pixels."""
        turn = np.linspace(0.0, 2.0 * np.pi, 49)
        circle = np.stack([np.cos(turn), np.sin(turn)], axis=1) * radius * self.unit / self.scale
        self.line(np.asarray(point_px) + circle, colour, thick)

    def arrow(self, tail_px: np.ndarray, head_px: np.ndarray, colour: Colour, thick: float = 2.0) -> None:
        """Draw an arrow with a black outline."""
        way = np.asarray(head_px, float) - tail_px
        length = float(np.hypot(*way))
        if not 1e-9 < length < np.inf:
            return
        size = min(11.0 * self.unit / self.scale, 0.5 * length)
        ahead = way / length * size
        across = 0.45 * np.array([-ahead[1], ahead[0]])
        barbs = np.stack([head_px - ahead + across, head_px, head_px - ahead - across])
        for ink, more in ((_BLACK, 2.0), (colour, 0.0)):
            self.line(np.stack([tail_px, head_px]), ink, thick + more)
            self.line(barbs, ink, thick + more)

    def words(
        self,
        text: str,
        at_px: np.ndarray,
        colour: Colour,
        offset: tuple[float, float] = (9.0, -9.0),
        size: float = 0.5,
    ) -> None:
        """Draw a label with a black outline, `offset` from a point and kept inside the canvas."""
        width, height = _text_size(text, size * self.unit)
        spot = self.at(np.asarray(at_px)) + np.array(offset) * self.unit - [width if offset[0] < 0 else 0, 0]
        rows, columns = self.image.shape[:2]
        spot = np.clip(spot, [3, height + 3], [max(3, columns - width - 4), max(height + 3, rows - 5)])
        for ink, edge in ((_BLACK, 2), (colour, 0)):
            _put(self.image, text, (int(spot[0]), int(spot[1])), _font_of(size * self.unit), ink, edge)

    def _thickness(self, thick: float) -> int:
        return max(1, round(thick * self.unit))

    def _places(self, points_px: np.ndarray, keep: bool = False) -> np.ndarray:
        """Canvas coordinates (M, 2) in OpenCV's fixed-point numbers."""
        points = np.asarray(points_px, float).reshape(-1, 2)
        good = points if keep else points[np.isfinite(points).all(axis=1)]
        limit = np.clip(np.nan_to_num(self.at(good)), -_FARTHEST, _FARTHEST)
        return np.rint(limit * (1 << _PARTS_BITS)).astype(np.int32)


@cache
def _font(size_px: int, bold: bool) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with Matplotlib and has characters that OpenCV's fonts lack."""
    home = importlib.util.find_spec("matplotlib")
    assert home is not None
    assert home.origin is not None
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(home.origin).parent / "mpl-data" / "fonts" / "ttf" / name, size_px)


def _font_of(size: float, bold: bool = False) -> ImageFont.FreeTypeFont:
    return _font(max(6, round(28.0 * size)), bold)


def _text_size(text: str, size: float, bold: bool = False) -> tuple[int, int]:
    """Width, and height of its capitals, in canvas pixels."""
    font = _font_of(size, bold)
    return math.ceil(font.getlength(text)), -math.floor(font.getbbox("H", anchor="ls")[1])


def _put(
    image: np.ndarray, text: str, at: tuple[int, int], font: ImageFont.FreeTypeFont, colour: Colour, edge: int = 0
) -> None:
    """Write text on an image (H, W, 3) from the lower left corner `at`, with an outline `edge` px wide."""
    left, top, right, bottom = (int(side) for side in font.getbbox(text, anchor="ls", stroke_width=edge))
    drawn = Image.new("L", (max(right - left, 0) + 2, max(bottom - top, 0) + 2))
    ImageDraw.Draw(drawn).text((1 - left, 1 - top), text, fill=255, font=font, anchor="ls", stroke_width=edge)
    x, y, cover = at[0] + left - 1, at[1] + top - 1, np.asarray(drawn)
    rows, columns = image.shape[:2]
    cover = cover[max(-y, 0) : rows - y, max(-x, 0) : columns - x]
    there = image[max(y, 0) :, max(x, 0) :][: cover.shape[0], : cover.shape[1]]
    share = cover[..., None] / 255.0
    there[:] = np.rint(share * np.array(colour) + (1.0 - share) * there).astype(np.uint8)


def _wrapped(text: str, width: float, size: float) -> list[str]:
    """The text in lines of at most `width` canvas pixels; a longer word is cut."""
    lines: list[str] = []
    for word in text.split():
        while _text_size(word, size)[0] > width and len(word) > 1:
            word = word[:-1]
        if lines and _text_size(f"{lines[-1]} {word}", size)[0] <= width:
            lines[-1] = f"{lines[-1]} {word}"
        else:
            lines.append(word)
    return lines


@dataclass(frozen=True)
class Key:
    """An entry of the legend: a sample of the mark, and its meaning; `scale` (K, 3) is drawn as a bar."""

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
    """An image (H, width, 3) with badge, left and right heading, wrapped paragraphs and keys."""
    margin, step, size = (
        round(DrawingSettings.margin_px * unit),
        round(DrawingSettings.line_height_px * unit),
        DrawingSettings.text_size * unit,
    )
    inner = width - 2 * margin
    paragraphs = [_wrapped(line, inner, size) for line in lines if line]
    rows = _in_rows(keys, inner, unit)
    height = 2 * margin + round(1.5 * step) + step * (sum(map(len, paragraphs)) + len(rows)) + step // 2
    image = np.full((height, width, 3), DrawingSettings.legend, np.uint8)
    below = _headed(image, badge, heading, margin, unit)
    for index, paragraph in enumerate(paragraphs):
        for line in paragraph:
            below += step
            _put(image, line, (margin, below), _font_of(size), WHITE if index == 0 else DrawingSettings.soft)
    below += step // 2
    for row in rows:
        below += step
        across = margin
        for key in row:
            _draw_key(image, key, (across, below), unit)
            across += _key_width(key, unit)
    return image


def _headed(image: np.ndarray, badge: tuple[str, Colour], heading: tuple[str, str], margin: int, unit: float) -> int:
    """Draw badge and headings, the right one if there is room; returns the base line."""
    word, colour = badge
    size, pad = 0.62 * unit, round(8 * unit)
    width, height = _text_size(word, size, bold=True)
    base = margin + height + pad // 2
    cv2.rectangle(image, (margin, margin - pad // 2), (margin + width + 2 * pad, base + pad), colour, cv2.FILLED)
    ink = _BLACK if np.dot(colour, (0.114, 0.587, 0.299)) > 110 else WHITE
    _put(image, word, (margin + pad, base), _font_of(size, bold=True), ink)
    size, left = 0.56 * unit, margin + width + 4 * pad
    _put(image, heading[0], (left, base), _font_of(size), WHITE)
    left += _text_size(heading[0], size)[0] + 3 * pad
    room = image.shape[1] - margin - left
    for line in _wrapped(heading[1], room, size)[:1] if room > 0 else []:
        _put(
            image,
            line,
            (image.shape[1] - margin - _text_size(line, size)[0], base),
            _font_of(size),
            DrawingSettings.soft,
        )
    return base + pad // 2


def _key_width(key: Key, unit: float) -> int:
    """Distance to the next key."""
    sample = round((44 if key.mark != "scale" else 100) * unit)
    return sample + _text_size(key.words, 0.9 * DrawingSettings.text_size * unit)[0] + round(18 * unit)


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
    _put(
        image,
        key.words,
        (left + long + round(8 * unit), base),
        _font_of(0.9 * DrawingSettings.text_size * unit),
        DrawingSettings.soft,
    )
