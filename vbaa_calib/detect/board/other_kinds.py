"""Whether the pictures show a board of another kind than the spec says: ChArUco, plain chessboard, grid of circles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from targets.board import Board, BoardSpec, Chessboard, CircleGrid, spec_line

from .diagnosis import PICTURES_TRIED, fitting_board, markers_within
from .grids import find_grid, find_whole_chessboard

_CHARUCO, _CHESSBOARD = "a ChArUco board", "a plain chessboard"
_LEAST_CORNERS = 20
_MARKERS_AMID = 3
"""Least number of markers within a plain chessboard that makes it a ChArUco board."""
_Read = Callable[[int], np.ndarray]


def explain_other_kind(read: _Read, found: Sequence[np.ndarray], spec: Board) -> tuple[str, str] | None:
    """The board that the pictures show instead, in words, and a remedy; None if that cannot be determined.

    Parameters
    ----------
    read : reads a picture (H, W) uint8 by its index.
    found : (N, 2) px marks of the spec's board in each picture.
    """
    shown = [index for index, corners in enumerate(found) if len(corners)]
    if shown:
        if isinstance(spec, BoardSpec) or markers_within(read(shown[0]), found[shown[0]]) < _MARKERS_AMID:
            return None
        return _as_charuco([read(index) for index in shown[:PICTURES_TRIED]], spec)
    chosen = np.unique(np.linspace(0, len(found) - 1, PICTURES_TRIED).astype(int))
    pictures = [read(int(index)) for index in chosen]
    charuco = None if isinstance(spec, BoardSpec) else _as_charuco(pictures, spec)
    return charuco or _as_circles(pictures, spec) or _as_chessboard(pictures, spec)


def _mistaken(what: str, fitting: Board | None, spec: Board) -> tuple[str, str]:
    if isinstance(spec, BoardSpec):
        named = _CHARUCO
    elif isinstance(spec, Chessboard):
        named = f"{_CHESSBOARD} of {spec.squares_x} x {spec.squares_y} squares"
    else:
        named = _circles_in_words(spec)
    remedy = (
        "describe that board" if fitting is None else f"this board fits, if its lengths are right: {spec_line(fitting)}"
    )
    return f"{what} is in the pictures, the board spec says {named}", remedy


def _circles_in_words(spec: CircleGrid) -> str:
    kind = "an asymmetric grid" if spec.type == "asymmetric_circles" else "a grid"
    return f"{kind} of {spec.columns} columns and {spec.rows} rows of circles"


def _as_charuco(pictures: Sequence[np.ndarray], spec: Chessboard | CircleGrid) -> tuple[str, str] | None:
    seen = fitting_board(pictures, spec.pitch_m)
    return None if seen is None else _mistaken(_CHARUCO, seen if isinstance(seen, BoardSpec) else None, spec)


def _as_circles(pictures: Sequence[np.ndarray], spec: Board) -> tuple[str, str] | None:
    """Circles of the other kind, or with columns and rows exchanged."""
    if not isinstance(spec, CircleGrid):
        return None
    for kind in ("circles", "asymmetric_circles"):
        for columns, rows in ((spec.columns, spec.rows), (spec.rows, spec.columns)):
            other = replace(spec, type=kind, columns=columns, rows=rows)
            if other != spec and any(find_grid(picture, other) is not None for picture in pictures):
                return _mistaken(_circles_in_words(other), other, spec)
    return None


def _as_chessboard(pictures: Sequence[np.ndarray], spec: Board) -> tuple[str, str] | None:
    """A plain chessboard of another size: the largest that two pictures agree on, or that of a single picture."""
    sizes = [sorted(size)[::-1] for picture in pictures if (size := find_whole_chessboard(picture))]
    own = sorted((spec.squares_x - 1, spec.squares_y - 1))[::-1] if isinstance(spec, Chessboard) else [0, 0]
    least = 2 if len(pictures) > 1 or any(np.greater_equal(own, max(sizes, default=own))) else 1
    agreed = [size for size in sizes if np.prod(size) >= _LEAST_CORNERS and sizes.count(size) >= least]
    columns, rows = (corners + 1 for corners in max(agreed, key=np.prod, default=own))
    if not agreed or [columns - 1, rows - 1] == own:
        return None
    fitting = Chessboard("chessboard", columns, rows, spec.pitch_m)
    what, remedy = _mistaken(f"{_CHESSBOARD} of {columns} x {rows} squares", fitting, spec)
    if isinstance(spec, Chessboard):
        remedy += "; all squares are counted, not the corners between them"
    return what, remedy
