"""Markers in pictures, and the measured relative positions of those of one board, independent of their ids."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from targets.board import BoardSpec

from .settings import DetectionSettings

OUTLINE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
"""(4, 2) a marker's corners about its centre, in sides, in OpenCV's order."""
TURNS = tuple(np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turns) for turns in (2, 0, 1, 3))
"""(2, 2) from a marker's directions to those of the board that it is printed on; first as Kalibr prints its tags."""


def marker_cells(numbers: np.ndarray, squares_x: int, on_even_squares: bool) -> np.ndarray:
    """(..., 2) column and row of markers, numbered (...) along the rows on every other square of a board of that width.

    on_even_squares : the first square has a marker (OpenCV's legacy layout with an even number of rows).
    """
    pair, number = np.divmod(numbers, squares_x)  # two rows hold as many markers as there are columns
    first = (squares_x + on_even_squares) // 2
    second = number >= first
    column = 2 * (number - first * second) + (second == on_even_squares)
    return np.stack([column, 2 * pair + second], axis=-1)


@dataclass(frozen=True, eq=False)
class Markers:
    """The markers of one picture: ids (M,) and their outlines (M, 4, 2) px, each side shorter by `short_px`."""

    ids: np.ndarray
    outlines: np.ndarray
    short_px: float = 1.0  # a contour runs half a pixel inside the marker's edge, on either side

    def px_per_square(self, marker_per_square: float) -> np.ndarray:
        """(M, 2, 2) pixels per square along the board's x and y (columns) at each marker, from the outlines.

        The least-squares affine map of its four corners.
        """
        return np.einsum("mcp,cb->mpb", self.outlines, OUTLINE) / marker_per_square

    @cached_property
    def px_per_marker(self) -> np.ndarray:
        """(M, 2, 2) pixels per marker side along the board's x and y (columns)."""
        found = self.px_per_square(1.0)
        side_px = np.sqrt(np.maximum(np.abs(np.linalg.det(found)), 1e-6))
        return found * (1.0 + self.short_px / side_px)[:, None, None]

    @cached_property
    def offsets(self) -> np.ndarray:
        """(M, M, 2) offsets from each marker's centre to every other's, along the board's x and y, in sides of the
        first."""
        centres = self.outlines.mean(axis=1)
        return np.einsum("ibp,ijp->ijb", np.linalg.pinv(self.px_per_marker), centres[None] - centres[:, None])

    def picked(self, which: np.ndarray) -> Markers:
        """The markers of a mask or of indices."""
        return replace(self, ids=self.ids[which], outlines=self.outlines[which])

    def nearest(self) -> np.ndarray:
        """(M, 2) absolute offsets to each marker's nearest neighbour; empty for a single marker."""
        if len(self.ids) < 2:
            return np.zeros((0, 2))
        away = np.linalg.norm(self.offsets, axis=-1) + np.diag(np.full(len(self.ids), np.inf))
        return np.abs(self.offsets[np.arange(len(away)), away.argmin(axis=1)])

    def neighbours(self, diagonal: bool, unit: float) -> tuple[np.ndarray, np.ndarray]:
        """(L, 2) pairs of neighbours, each once, and the steps (L, 2) between them, on which both markers agree.

        unit : sides of a marker in a step along x or y.
        """
        scaled = self.offsets / unit
        step = np.rint(scaled).astype(int)
        size = np.abs(step)
        near = (size.max(axis=-1) == 1) & ((size.sum(axis=-1) == 2) == diagonal)
        near &= (np.abs(scaled - step).max(axis=-1) < DetectionSettings.miss) & (step == -step.swapaxes(0, 1)).all(
            axis=-1
        )
        pairs = np.argwhere(np.triu(near))
        return pairs, step[pairs[:, 0], pairs[:, 1]]

    def at_pitch(self, unit: float) -> np.ndarray:
        """(M, 4, 2) px outlines scaled so that steps along x and y are `unit` sides, as on the board: blur shrinks
        the outlines but leaves their centres."""
        (first, second), steps = self.neighbours(False, unit)[0].T, self.neighbours(False, unit)[1]
        sizes = 0.5 * np.abs(self.offsets[first, second] - self.offsets[second, first])
        along = [sizes[steps[:, axis] != 0, axis] for axis in (0, 1)]
        wider = np.array([np.median(one) / unit if len(one) else 1.0 for one in along])
        centres = self.outlines.mean(axis=1, keepdims=True)
        inside = np.einsum("mbp,mcp->mcb", np.linalg.pinv(self.px_per_marker), self.outlines - centres)
        return np.asarray(centres + np.einsum("mpb,mcb->mcp", self.px_per_marker, wider * inside))

    def groups(self, pairs: np.ndarray) -> list[np.ndarray]:
        """Indices of the markers that pairs (L, 2) connect, the largest group first."""
        return _connected(len(self.ids), pairs)

    def one_copy(self, spec: BoardSpec) -> Markers:
        """The markers of the most visible copy of a board; all of them where there is one."""
        own = self.picked(np.isin(self.ids, spec.marker_ids))
        if len(own.ids) - len(np.unique(own.ids)) < DetectionSettings.clear:  # a single one is read by chance
            return self
        groups = own.groups(own.neighbours(True, spec.square_m / spec.marker_m)[0])
        return own.picked(next((one for one in groups if len(np.unique(own.ids[one])) == len(one)), np.zeros(0, int)))


def find_markers(picture: np.ndarray, dictionary: str, border: int = 1) -> Markers:
    """Detect the markers of a dictionary in a picture (H, W) uint8. border : modules of black around a marker's
    bits; where it is wide, as in an AprilGrid, black squares meet at the corners, and these are refined."""
    options = cv2.aruco.DetectorParameters()
    options.markerBorderBits = border
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX if border > 1 else cv2.aruco.CORNER_REFINE_NONE
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    seen = picture if picture.size else np.zeros((1, 1), np.uint8)  # OpenCV refuses a picture without pixels
    outlines, ids, _ = cv2.aruco.ArucoDetector(known, options).detectMarkers(seen)
    found = np.zeros(0, int) if ids is None else np.asarray(ids, int).ravel()
    return Markers(found, np.asarray(outlines, float).reshape(-1, 4, 2), 0.0 if border > 1 else 1.0)


def _connected(count: int, pairs: np.ndarray) -> list[np.ndarray]:
    """Groups of indices below `count` that pairs (L, 2) connect, the largest first."""
    own = np.arange(count)
    for _ in range(count):
        before = own.copy()
        for a, b in pairs.tolist():
            own[a] = own[b] = min(own[a], own[b])
        if np.array_equal(before, own):
            break
    groups = [np.flatnonzero(own == label) for label in np.unique(own).tolist()]
    return sorted(groups, key=len, reverse=True)


@dataclass(frozen=True, eq=False)
class MarkerGrid:
    """Markers of one board, located by their neighbours.

    Attributes
    ----------
    diagonal : whether neighbours stand diagonally, as on a ChArUco board, or along x and y.
    unit : sides of a marker in a step along x or y.
    pairs : (L, 2) ids of neighbours. steps : (L, 2) from the first to the second. votes : (L,) pictures that show it.
    cells : id → column and row, from the least of each.
    """

    diagonal: bool
    unit: float
    pairs: np.ndarray
    steps: np.ndarray
    votes: np.ndarray
    cells: dict[int, tuple[int, int]]

    def against(self, cells: np.ndarray) -> tuple[int, int]:
        """Numbers of pairs that agree and disagree with a layout, by the cells (L, 2, 2) of the pairs in it."""
        agree = (cells[:, 1] - cells[:, 0] == self.steps).all(axis=-1)
        return int(self.votes[agree].sum()), int(self.votes[~agree].sum())


def marker_grids(pictures: Sequence[Markers]) -> list[MarkerGrid]:
    """The boards in pictures of one camera, the most visible first."""
    nearest = np.concatenate([np.zeros((0, 2)), *(picture.nearest() for picture in pictures)])
    if not len(nearest):
        return []
    short, long = np.sort(nearest, axis=1).T
    slanted = short > DetectionSettings.diagonal * long
    diagonal = bool(slanted.mean() > DetectionSettings.diagonals)
    unit = float(np.median(nearest[slanted].mean(axis=1) if diagonal else long))
    seen: defaultdict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    lengths = []
    for picture in pictures:
        pairs, steps = picture.neighbours(diagonal, unit)
        # from both ends: of two markers the nearer one looks larger
        for (a, b), sign in ((pairs.T, 1), (pairs.T[::-1], -1)):
            lengths.append(sign * (picture.offsets[a, b] * steps).sum(axis=1) / np.maximum((steps**2).sum(axis=1), 1))
        for (a, b), (x, y) in zip(picture.ids[pairs].tolist(), steps.tolist(), strict=True):
            seen[min(a, b), max(a, b)].append((x, y) if a < b else (-x, -y))
    known = {}
    for pair, every in seen.items():
        step, votes = Counter(every).most_common(1)[0]
        if votes >= DetectionSettings.agreed * len(every) and pair[0] != pair[1]:
            known[pair] = (step, votes)
    if not known:
        return []
    size = float(np.median(np.concatenate(lengths)))
    return sorted(_joined(known, diagonal, size), key=lambda grid: -int(grid.votes.sum()))


def _joined(
    known: dict[tuple[int, int], tuple[tuple[int, int], int]], diagonal: bool, unit: float
) -> Iterator[MarkerGrid]:
    """The grid of each group of markers that pairs connect, from pairs of ids, with their steps and votes."""
    pairs = np.array(list(known))
    steps, votes = np.array([one[0] for one in known.values()]), np.array([one[1] for one in known.values()])
    ids, numbers = np.unique(pairs, return_inverse=True)
    numbers = numbers.reshape(-1, 2)
    for group in _connected(len(ids), numbers):
        own = np.isin(numbers[:, 0], group)
        if not own.any():
            continue
        cells = {int(group[0]): np.zeros(2, int)}
        while len(cells) < len(group):
            for (a, b), step in zip(numbers[own].tolist(), steps[own], strict=True):
                if a in cells and b not in cells:
                    cells[b] = cells[a] + step
                elif b in cells and a not in cells:
                    cells[a] = cells[b] - step
        least = np.min(list(cells.values()), axis=0)
        places = {int(ids[number]): (int(x), int(y)) for number, cell in cells.items() for x, y in [cell - least]}
        yield MarkerGrid(diagonal, unit, pairs[own], steps[own], votes[own], places)
