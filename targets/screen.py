"""The board for a screen: squares and markers of whole pixels, and what they measure there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .board import BoardSpec, opencv_board

_LEAST_MODULE_PX = 2
_MOST_PIXELS = 100_000_000
_PX_PER_MM = 0.5, 500.0


@dataclass(frozen=True)
class ScreenBoard:
    """A board in pixels: sides of its squares and markers, and the white around it, all whole numbers.

    `spec` has the sizes that it really has on that screen.
    """

    spec: BoardSpec
    square_px: int
    marker_px: int
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
    low, high = _PX_PER_MM
    if not low <= px_per_mm <= high:
        raise ValueError(f"the screen has {px_per_mm:g} pixels per mm: {low:g} to {high:g} are needed")
    square, marker = (1e3 * length * px_per_mm for length in (wanted.square_m, wanted.marker_m))
    module = round(marker / wanted.modules)
    if module < _LEAST_MODULE_PX:
        least = _LEAST_MODULE_PX * wanted.modules / px_per_mm * wanted.square_m / wanted.marker_m
        raise ValueError(
            f"squares of {1e3 * wanted.square_m:g} mm are {square:.1f} pixels there, too few to draw the markers; "
            f"take squares of {least:.3g} mm or more"
        )
    marker_px = module * wanted.modules
    side = marker_px + 2 * max(1, round((square - marker_px) / 2))
    square_m, marker_m = (round(1e-3 * pixels / px_per_mm, 12) for pixels in (side, marker_px))
    board = ScreenBoard(replace(wanted, square_m=square_m, marker_m=marker_m), side, marker_px, (side + 1) // 2)
    width, height = board.size_px
    if width * height > _MOST_PIXELS:
        raise ValueError(f"the picture would have {width} x {height} pixels, more than any screen")
    return board


def as_pixels(board: ScreenBoard) -> np.ndarray:
    """(rows, columns) uint8 picture, black on white."""
    return np.asarray(opencv_board(board.spec).generateImage(board.size_px, marginSize=board.margin_px))
