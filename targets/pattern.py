"""The board's black areas as outlines, exactly as OpenCV draws them."""

from __future__ import annotations

import cv2
import numpy as np

from .board import BoardSpec, opencv_board

Loop = tuple[tuple[float, float], ...]
"""A closed polygon's corners (x, y), the last joined to the first."""


def outlines(black: np.ndarray) -> tuple[Loop, ...]:
    """The border of the black cells of a (rows, columns) mask, in cells; to be filled by the even-odd rule.

    One outline round neighbouring cells, not one rectangle each: viewers that smooth edges show a hairline between
    rectangles that touch.
    """
    steps: dict[tuple[int, int], list[tuple[int, int]]] = {}
    padded = np.pad(np.asarray(black, bool), 1)
    # borders between a cell and the one below it run along x, between a cell and the one right of it along y
    for y, x in np.argwhere(padded[:-1] != padded[1:]):
        _join(steps, (x - 1, y), (x, y))
    for y, x in np.argwhere(padded[:, :-1] != padded[:, 1:]):
        _join(steps, (x, y - 1), (x, y))
    loops = []
    while steps:
        start = min(steps)
        loop = [start, _take(steps, start)]
        while loop[-1] != start:
            loop.append(_take(steps, loop[-1]))
        loops.append(_corners_only(loop[:-1]))
    return tuple(loops)


def _join(steps: dict, a: tuple[int, int], b: tuple[int, int]) -> None:
    a, b = (int(a[0]), int(a[1])), (int(b[0]), int(b[1]))
    steps.setdefault(a, []).append(b)
    steps.setdefault(b, []).append(a)


def _take(steps: dict, at: tuple[int, int]) -> tuple[int, int]:
    to = steps[at].pop()
    steps[to].remove(at)
    for end in (at, to):
        if not steps[end]:
            del steps[end]
    return to


def _corners_only(loop: list[tuple[int, int]]) -> Loop:
    ends = zip([loop[-1], *loop[:-1]], loop, [*loop[1:], loop[0]], strict=True)
    return tuple((x, y) for (ax, ay), (x, y), (bx, by) in ends if not (ax == x == bx or ay == y == by))


def board_shapes(spec: BoardSpec) -> list[tuple[Loop, ...]]:
    """The black squares all together, then marker by marker: outlines for the even-odd rule, mm in the board frame.

    Together, because viewers move a rectangle that stands alone to whole pixels.
    """
    square, marker = 1e3 * spec.square_m, 1e3 * spec.marker_m
    board, black = opencv_board(spec), np.ones((spec.squares_y, spec.squares_x), bool)
    markers = []
    for number, corners in zip(np.ravel(board.getIds()), board.getObjPoints(), strict=True):
        column, row = (np.asarray(corners)[:, :2].mean(axis=0) // spec.square_m).astype(int).tolist()
        black[row, column] = False
        cells = cv2.aruco.generateImageMarker(board.getDictionary(), int(number), spec.modules) < 128
        at = (length * square + (square - marker) / 2 for length in (column, row))
        markers.append(placed(outlines(cells), marker / spec.modules, *at))
    return [placed(outlines(black), square, 0.0, 0.0), *markers]


def placed(loops: tuple[Loop, ...], scale: float, x: float, y: float) -> tuple[Loop, ...]:
    """The same outlines, scaled and then shifted."""
    return tuple(tuple((x + scale * u, y + scale * v) for u, v in loop) for loop in loops)
