"""Reflections on the board: places that are as bright as its paper, or clipped, where it is black."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import BoardSpec

from .outline import TEXELS, BoardMap

# of a black square, and of a marker with some of its black border
_MIDDLE, _MARKER = slice(TEXELS // 4, TEXELS - TEXELS // 4), slice(TEXELS // 6, TEXELS - TEXELS // 6)
_CLIPPED = 250
_WASHED_OUT = 0.5
_BRIGHT = 0.9
_COVERED = 0.25


@dataclass(frozen=True, eq=False)
class Levels:
    """Grey levels on the board.

    Attributes
    ----------
    dark : (squares_y, squares_x) median of each black square's middle, and of the darkest third of each marker; NaN
        where the square is not wholly in the picture.
    black, white : what is usual: the median black square, and the brighter ones of the white squares' rims.
    """

    dark: np.ndarray
    black: float
    white: float


@dataclass(frozen=True)
class Blemish:
    """A connected patch of squares that are not black where they should be.

    Attributes
    ----------
    squares : how many. centre : (2,) of them, in squares along the board's x and y.
    shining : clipped or as bright as paper: a reflection; else something covers the board, or a shadow's edge.
    """

    squares: int
    centre: tuple[float, float]
    shining: bool


def levels(image: np.ndarray, where: BoardMap, spec: BoardSpec) -> Levels | None:
    """Of a picture (H, W) uint8; None where no whole square is in it."""
    flat = where.flat(image, spec)
    height, width = image.shape
    nodes = np.stack(np.meshgrid(np.arange(spec.squares_x + 1.0), np.arange(spec.squares_y + 1.0)), axis=-1)
    pixels = where.pixels(nodes.reshape(-1, 2))
    inside = np.all((pixels >= 0) & (pixels <= (width - 1, height - 1)), axis=1).reshape(nodes.shape[:2])
    whole = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
    if not whole.any():
        return None
    middle, marker = (flat[:, :, part, part].reshape(*whole.shape, -1) for part in (_MIDDLE, _MARKER))
    row, column = np.indices(whole.shape)
    first_black = not (spec.legacy_pattern and spec.squares_y % 2 == 0)
    is_black = ((row + column) % 2 == 0) == first_black
    rim = flat[:, :, (1, TEXELS - 2), _MIDDLE]
    if not (whole & is_black).any() or not (whole & ~is_black).any():
        return None
    dark = np.where(is_black, np.median(middle, axis=-1), np.percentile(marker, 100.0 / 6.0, axis=-1))
    return Levels(
        np.where(whole, dark, np.nan),
        float(np.median(dark[whole & is_black])),
        float(np.percentile(rim[whole & ~is_black], 75.0)),
    )


def blemishes(seen: Levels) -> list[Blemish]:
    """Patches of squares whose black is gone, the largest first: every square of a board has black in its middle."""
    rise = (np.nan_to_num(seen.dark, nan=seen.black) - seen.black) / max(seen.white - seen.black, 1.0)
    count, labels = cv2.connectedComponents((rise > _WASHED_OUT).astype(np.uint8), connectivity=8)
    found = []
    for label in range(1, count):
        rows, columns = np.nonzero(labels == label)
        bright = seen.dark[rows, columns]
        shining = (bright >= _CLIPPED) | (rise[rows, columns] >= _BRIGHT)
        centre = (float(columns.mean()) + 0.5, float(rows.mean()) + 0.5)
        found.append(Blemish(len(rows), centre, bool(shining.mean() > _COVERED)))
    return sorted(found, key=lambda one: -one.squares)
