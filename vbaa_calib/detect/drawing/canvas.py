"""A colour picture to draw on in the picture's own pixels, enlarged where they are few."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

Colour = tuple[int, int, int]
"""Blue, green, red, 0–255."""

WHITE: Colour = (255, 255, 255)
BLACK: Colour = (0, 0, 0)
_WIDEST, _NARROWEST = 1920.0, 960.0
"""Widths, in canvas pixels, that a picture is reduced or enlarged to."""
_PARTS_BITS = 4
"""Canvas coordinates are drawn to a sixteenth of a pixel."""
_FARTHEST = 8000.0
"""Coordinates are cut off here: OpenCV's are of few bits."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_ASCII = {"±": "+-", "°": " deg", "µ": "u", "·": ".", "–": "-", "→": "->", "≤": "<=", "ξ": "xi", "×": "x", "²": "^2"}
"""OpenCV's fonts have _ASCII only."""


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture being drawn on. Points are given in the camera's pixels (centres at whole numbers) and drawn in place.

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
        """A canvas with a grey picture (H, W) uint8 in it, a whole number of times as large where that is small."""
        width = grey.shape[1]
        scale = _WIDEST / width if width > _WIDEST else float(max(1, round(_NARROWEST / width)))
        size = (max(1, round(scale * width)), max(1, round(scale * grey.shape[0])))
        large = cv2.resize(grey, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST)
        return Canvas(cv2.cvtColor(large, cv2.COLOR_GRAY2BGR), scale, unit=float(np.clip(size[0] / 1100.0, 1.0, 1.8)))

    def cut(self, grey: np.ndarray, centre_px: np.ndarray, radius_px: float, size: int) -> Canvas:
        """A square canvas of `size` with the grey picture's surroundings (H, W) of a point (2,) in it."""
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
        """A polyline through points (M, 2); those that are not finite are left out."""
        places = self._places(points_px)
        if len(places) >= 2:
            cv2.polylines(self.image, [places], False, colour, self._thickness(thick), cv2.LINE_AA, _PARTS_BITS)

    def dashes(self, points_px: np.ndarray, colour: Colour, thick: float = 1.0, dash: float = 9.0) -> None:
        """The same, dashed: as long on as off, in canvas pixels."""
        points = np.asarray(points_px, float)
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2:
            return
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))]) * self.scale
        for begin in np.arange(0.0, min(along[-1], _FARTHEST), 2.0 * dash * self.unit):
            at = np.linspace(begin, min(begin + dash * self.unit, along[-1]), 4)
            piece = np.stack([np.interp(at, along, points[:, i]) for i in range(2)], axis=1)
            self.line(piece, colour, thick)

    def graded(self, points_px: np.ndarray, colours: np.ndarray, thick: float = 2.0, gap_px: float = 2.5) -> None:
        """Points (N, 2), each of its own colour (N, 3), joined where they are no farther apart than the gap."""
        places = self._places(points_px, keep=True)
        near = np.hypot(*np.diff(points_px, axis=0).T) <= gap_px if len(points_px) > 1 else np.zeros(0, bool)
        for index, (place, colour) in enumerate(zip(places, colours.tolist(), strict=True)):
            end = places[index + 1] if index < len(near) and near[index] else place
            cv2.line(self.image, tuple(place), tuple(end), colour, self._thickness(thick), cv2.LINE_AA, _PARTS_BITS)

    def ring(self, point_px: np.ndarray, radius: float, colour: Colour, thick: float = 1.5) -> None:
        """A circle of a radius in canvas pixels."""
        turn = np.linspace(0.0, 2.0 * np.pi, 49)
        circle = np.stack([np.cos(turn), np.sin(turn)], axis=1) * radius * self.unit / self.scale
        self.line(np.asarray(point_px) + circle, colour, thick)

    def arrow(self, tail_px: np.ndarray, head_px: np.ndarray, colour: Colour, thick: float = 2.0) -> None:
        """An arrow with a black edge."""
        way = np.asarray(head_px, float) - tail_px
        length = float(np.hypot(*way))
        if not 1e-9 < length < np.inf:
            return
        size = min(11.0 * self.unit / self.scale, 0.5 * length)
        ahead = way / length * size
        aside = 0.45 * np.array([-ahead[1], ahead[0]])
        barbs = np.stack([head_px - ahead + aside, head_px, head_px - ahead - aside])
        for ink, more in ((BLACK, 2.0), (colour, 0.0)):
            self.line(np.stack([tail_px, head_px]), ink, thick + more)
            self.line(barbs, ink, thick + more)

    def words(self, text: str, at_px: np.ndarray, colour: Colour, aside: tuple[float, float] = (9.0, -9.0)) -> None:
        """A label beside a point, to its left where `aside` says so; kept inside the canvas, with a black edge."""
        width, height = text_size(text, 0.5 * self.unit)
        spot = self.at(np.asarray(at_px)) + np.array(aside) * self.unit - [width if aside[0] < 0 else 0, 0]
        rows, columns = self.image.shape[:2]
        spot = np.clip(spot, [3, height + 3], [max(3, columns - width - 4), max(height + 3, rows - 5)])
        for ink, thick in ((BLACK, 4), (colour, 1)):
            put(self.image, text, (int(spot[0]), int(spot[1])), 0.5 * self.unit, ink, thick)

    def _thickness(self, thick: float) -> int:
        return max(1, round(thick * self.unit))

    def _places(self, points_px: np.ndarray, keep: bool = False) -> np.ndarray:
        """Canvas coordinates (M, 2) as OpenCV's whole numbers of parts."""
        points = np.asarray(points_px, float).reshape(-1, 2)
        good = points if keep else points[np.isfinite(points).all(axis=1)]
        limit = np.clip(np.nan_to_num(self.at(good)), -_FARTHEST, _FARTHEST)
        return np.rint(limit * (1 << _PARTS_BITS)).astype(np.int32)


def ascii_text(text: str) -> str:
    """The text in the letters that OpenCV can draw."""
    return "".join(_ASCII.get(letter, letter) for letter in text).encode("ascii", "replace").decode()


def text_size(text: str, size: float, thick: int = 1) -> tuple[int, int]:
    """Width and height of a text in canvas pixels."""
    (width, height), _ = cv2.getTextSize(ascii_text(text), _FONT, size, thick)
    return int(width), int(height)


def put(image: np.ndarray, text: str, at: tuple[int, int], size: float, colour: Colour, thick: int = 1) -> None:
    """Write on an image (H, W, 3), from the lower left corner `at`."""
    cv2.putText(image, ascii_text(text), at, _FONT, size, colour, thick, cv2.LINE_AA)


def wrapped(text: str, width: float, size: float) -> list[str]:
    """The text in lines that are no wider than so many canvas pixels; a single longer word is cut."""
    lines: list[str] = []
    for word in ascii_text(text).split():
        while text_size(word, size)[0] > width and len(word) > 1:
            word = word[:-1]
        if lines and text_size(f"{lines[-1]} {word}", size)[0] <= width:
            lines[-1] = f"{lines[-1]} {word}"
        else:
            lines.append(word)
    return lines
