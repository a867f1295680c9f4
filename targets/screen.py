"""The board for a screen: squares and markers of whole pixels, and what they measure there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .board import BoardSpec
from .pattern import marker_cells

_LEAST_MODULE_PX = 2
_MOST_PIXELS = 100_000_000
LEAST_PX_PER_MM, MOST_PX_PER_MM = 0.5, 500.0


@dataclass(frozen=True)
class ScreenBoard:
    """A board in pixels. `spec` has the sizes that it really has on that screen.

    Attributes
    ----------
    square_px, marker_px, module_px : sides of a square, a marker and one of its modules; whole numbers.
    margin_px : white around the board.
    """

    spec: BoardSpec
    px_per_mm: float
    square_px: int
    marker_px: int
    module_px: int
    margin_px: int

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the picture."""
        columns, rows = self.spec.squares_x, self.spec.squares_y
        return columns * self.square_px + 2 * self.margin_px, rows * self.square_px + 2 * self.margin_px


def on_screen(wanted: BoardSpec, px_per_mm: float) -> ScreenBoard:
    """The board nearest to the wanted one whose squares, markers, modules and gaps are whole pixels.

    Raises ValueError where a module would be smaller than two pixels, or the picture too large.
    """
    if not LEAST_PX_PER_MM <= px_per_mm <= MOST_PX_PER_MM:
        low, high = LEAST_PX_PER_MM, MOST_PX_PER_MM
        raise ValueError(f"the screen has {px_per_mm:g} pixels per mm: {low:g} to {high:g} are needed")
    modules = int(wanted.dictionary[len("DICT_")]) + 2
    square, marker = (1e3 * length * px_per_mm for length in (wanted.square_m, wanted.marker_m))
    if round(marker / modules) < _LEAST_MODULE_PX:
        least = _LEAST_MODULE_PX * modules / px_per_mm * wanted.square_m / wanted.marker_m
        raise ValueError(
            f"squares of {1e3 * wanted.square_m:g} mm are {square:.1f} pixels there, too few to draw the markers; "
            f"take squares of {least:.3g} mm or more"
        )
    module = round(marker / modules)
    gap = max(1, round((square - module * modules) / 2))
    side = modules * module + 2 * gap
    spec = replace(
        wanted, square_m=round(1e-3 * side / px_per_mm, 12), marker_m=round(1e-3 * modules * module / px_per_mm, 12)
    )
    board = ScreenBoard(spec, px_per_mm, side, modules * module, module, margin_px=(side + 1) // 2)
    if board.size_px[0] * board.size_px[1] > _MOST_PIXELS:
        raise ValueError(f"the picture would have {board.size_px[0]} x {board.size_px[1]} pixels, more than any screen")
    return board


def as_pixels(board: ScreenBoard) -> np.ndarray:
    """(rows, columns) uint8 picture, black on white."""
    width, height = board.size_px
    picture = np.full((height, width), 255, np.uint8)
    markers, side = marker_cells(board.spec), board.square_px
    inset = (side - board.marker_px) // 2
    for row in range(board.spec.squares_y):
        for column in range(board.spec.squares_x):
            x, y = board.margin_px + column * side, board.margin_px + row * side
            black = markers.get((column, row))
            if black is None:
                picture[y : y + side, x : x + side] = 0
            else:
                pixels = np.kron(black, np.ones((board.module_px, board.module_px), bool))
                place = np.s_[y + inset : y + inset + board.marker_px, x + inset : x + inset + board.marker_px]
                picture[place][pixels] = 0
    return picture
