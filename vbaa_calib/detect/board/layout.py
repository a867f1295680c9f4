"""How a board's markers stand to one another: which layout and marker size their neighbours agree on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

PAIRS_NEEDED = 6
"""Pairs of markers that must agree before anything is concluded from them."""
_MISS_SQUARES = 0.6
_LARGEST_WIDTH = 60
_RATIOS = (0.2, 1.0)
_NEAR = 2
# the unit square's outline in OpenCV's marker corner order, about its centre
_OUTLINE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
# contours run through the centres of the outermost black pixels: half a pixel inside the edge, on either side
_CONTOUR_PX = 1.0


def marker_cells(squares_x: int, on_even_squares: bool, count: int) -> np.ndarray:
    """(count, 2) column and row of each marker id: markers are numbered along the rows, on every other square.

    on_even_squares: the first square holds a marker (OpenCV's legacy layout with an even number of rows).
    """
    rows = 2 * count // squares_x + 2
    row, column = np.mgrid[:rows, :squares_x]
    holds_marker = (row + column) % 2 == (0 if on_even_squares else 1)
    return np.stack([column[holds_marker], row[holds_marker]], axis=-1)[:count]


def px_per_square(outlines: np.ndarray, marker_per_square: float) -> np.ndarray:
    """(M, 2, 2) pixels per square along the board's x and y (columns) at each marker, outlines (M, 4, 2) px.

    The least-squares affine map of its four corners.
    """
    return np.einsum("mcp,cb->mpb", outlines, _OUTLINE) / marker_per_square


@dataclass(frozen=True, eq=False)
class Markers:
    """The markers of one picture: ids (M,) and their outlines (M, 4, 2) px."""

    ids: np.ndarray
    outlines: np.ndarray

    @cached_property
    def px_per_marker(self) -> np.ndarray:
        """(M, 2, 2) pixels per marker side along the board's x and y (columns)."""
        found = px_per_square(self.outlines, 1.0)
        side_px = np.sqrt(np.maximum(np.abs(np.linalg.det(found)), 1e-6))
        return found * (1.0 + _CONTOUR_PX / side_px)[:, None, None]

    @cached_property
    def offsets(self) -> np.ndarray:
        """(M, M, 2) from each marker's centre to every other one's, in sides of the first along the board's x and y."""
        centres = self.outlines.mean(axis=1)
        return np.einsum("ibp,ijp->ijb", np.linalg.pinv(self.px_per_marker), centres[None] - centres[:, None])

    def below(self, count: int) -> Markers:
        """Those with ids under a count."""
        low = self.ids < count
        return self if low.all() else Markers(self.ids[low], self.outlines[low])


@dataclass(frozen=True, eq=False)
class Layout:
    """How well markers stand as a layout has them.

    Attributes
    ----------
    squares_x, on_even_squares : the layout (`marker_cells`).
    ratio : marker side over square side that fits it best.
    wrong, total : pairs of markers at most two squares apart in it: that contradict it, and all.
    fits : (count,) of how many fitting pairs each id is the first.
    """

    squares_x: int
    on_even_squares: bool
    ratio: float
    wrong: int
    total: int
    fits: np.ndarray

    @property
    def agreeing(self) -> int:
        """Pairs that stand as the layout has them."""
        return self.total - self.wrong

    @property
    def share_wrong(self) -> float:
        """wrong / total."""
        return self.wrong / max(self.total, 1)

    @property
    def cells(self) -> np.ndarray:
        """(count, 2) column and row of each id."""
        return marker_cells(self.squares_x, self.on_even_squares, len(self.fits))


def judge(pictures: Sequence[Markers], squares_x: int, on_even_squares: bool, count: int) -> Layout:
    """How well the markers with ids under `count` fit a layout.

    Each marker's outline predicts where its neighbours stand; a pair fits when that misses by less than 0.6 squares.
    Being local, this bears any lens. The marker's size against the square's is found from the same pairs.
    """
    cells = marker_cells(squares_x, on_even_squares, count)
    ids, steps, offsets = [np.zeros(0, int)], [np.zeros((0, 2))], [np.zeros((0, 2))]
    for picture in (picture.below(count) for picture in pictures):
        step = cells[picture.ids][None] - cells[picture.ids][:, None]
        near = (np.abs(step).max(axis=-1) <= _NEAR) & step.any(axis=-1)
        ids.append(picture.ids[np.nonzero(near)[0]])
        steps.append(step[near].astype(float))
        offsets.append(picture.offsets[near])
    step, offset = np.concatenate(steps), np.concatenate(offsets)
    along = (step * offset).sum(axis=1)
    ahead = along > 0.0
    typical = np.median((step[ahead] ** 2).sum(axis=1) / along[ahead]) if ahead.any() else np.mean(_RATIOS)
    ratio = float(np.clip(typical, *_RATIOS))
    good = np.linalg.norm(ratio * offset - step, axis=1) < _MISS_SQUARES
    fits = np.bincount(np.concatenate(ids)[good], minlength=count)
    return Layout(squares_x, on_even_squares, ratio, int((~good).sum()), len(good), fits)


def distinctive_pairs(pictures: Sequence[Markers], here: Layout, other: Layout) -> int:
    """How many pairs of neighbouring markers fit one layout and stand differently in the other, of as many ids."""
    cells, votes = (here.cells, other.cells), 0
    for picture in (picture.below(len(here.fits)) for picture in pictures):
        step, rival = (layout[picture.ids][None] - layout[picture.ids][:, None] for layout in cells)
        near = (np.abs(step).max(axis=-1) <= _NEAR) & (step != rival).any(axis=-1)
        votes += int((near & (np.linalg.norm(here.ratio * picture.offsets - step, axis=-1) < _MISS_SQUARES)).sum())
    return votes


def best_layout(pictures: Sequence[Markers], prefer: tuple[int, bool]) -> Layout | None:
    """The layout that the fewest pairs contradict; the preferred (squares_x, on_even_squares) where none is better.

    None where too few pairs say anything, or one in ten contradicts the best.
    """
    count = 1 + max((int(picture.ids.max(initial=-1)) for picture in pictures), default=-1)
    every = [(squares_x, even) for squares_x in range(2, _LARGEST_WIDTH + 1) for even in (False, True)]
    best: Layout | None = None
    for squares_x, even in [prefer, *every]:
        layout = judge(pictures, squares_x, even, count)
        if layout.agreeing >= PAIRS_NEEDED and (best is None or layout.share_wrong < best.share_wrong - 1e-9):
            best = layout
    return best if best is not None and best.share_wrong <= 0.1 else None


def vacant_below(picture: Markers, layout: Layout, row: int, image_size: tuple[int, int]) -> int:
    """How many markers of the row after `row` would stand well inside the picture, beside markers of `row` in it."""
    picture = picture.below(len(layout.fits))
    column, its_row = layout.cells[picture.ids].T
    last = its_row == row
    centres, per_square = picture.outlines.mean(axis=1)[last], picture.px_per_marker[last] / layout.ratio
    size_px, vacant = np.linalg.norm(per_square, axis=(1, 2)), 0
    for side in (-1, 1):
        where = centres + per_square @ np.array([side, 1.0])
        room = np.minimum(where, np.array(image_size) - 1 - where).min(axis=1)
        beside = column[last] + side
        vacant += int(((room > size_px) & (beside >= 0) & (beside < layout.squares_x)).sum())
    return vacant
