"""Lines of equal value over a grid, by marching squares."""

from __future__ import annotations

import numpy as np

from .svg import ticks

_WIDE = 5.0
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0))
"""Sides of a cell between its corners, which go round it."""


def contour(x: np.ndarray, y: np.ndarray, values: np.ndarray, level: float) -> np.ndarray:
    """(S, 2, 2) straight pieces of the line where values (R, C) on a grid x (C,), y (R,) cross a level.

    Cells with a NaN at a corner have none.
    """
    pieces = []
    for row in range(len(y) - 1):
        for column in range(len(x) - 1):
            cell = values[[row, row, row + 1, row + 1], [column, column + 1, column + 1, column]]
            above = cell > level
            if above.all() or not above.any() or not np.isfinite(cell).all():
                continue
            corners = np.column_stack([x[[column, column + 1, column + 1, column]], y[[row, row, row + 1, row + 1]]])
            crossed = [
                corners[a] + (level - cell[a]) / (cell[b] - cell[a]) * (corners[b] - corners[a])
                for a, b in _EDGES
                if above[a] != above[b]
            ]
            # a saddle has four crossings: two lines, either pairing is right
            pieces += [crossed[index : index + 2] for index in range(0, len(crossed), 2)]
    return np.array(pieces).reshape(-1, 2, 2)


def levels(low: float, high: float, most: int = 6) -> list[float]:
    """Round values inside (low, high), at most so many: evenly spaced, by factors where high is many times low."""
    if not 0 < low < high:
        return []
    if high < _WIDE * low:
        return [level for level in ticks(low, high, most - 1) if low < level < high]
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    found = [float(f"{factor * 10.0**power:.3g}") for power in powers for factor in (1, 2, 5)]
    found = [value for value in found if low < value < high]
    return found[:: -(-len(found) // most)] if found else []
