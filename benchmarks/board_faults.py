"""Corners that are grossly wrong, one by one or together, as detectors and light make them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_PATCH = (3, 4)
"""Corners of a patch that a reflection mirrors, fewest and most along a side."""


@dataclass(frozen=True, eq=False)
class Corners:
    """All corners of a board, row by row with so many columns: pixels (C, 2), and which are seen (C,)."""

    pixels: np.ndarray
    seen: np.ndarray
    columns: int

    @property
    def grid(self) -> np.ndarray:
        """(rows, columns) ids."""
        return np.arange(len(self.pixels)).reshape(-1, self.columns)


Fault = Callable[[Corners, float, tuple[float, float], np.random.Generator], tuple[np.ndarray, np.ndarray]]
"""Corners, share of them, least and largest shift px → pixels (C, 2), which are wrong (C,)."""


def _shifts(count: int, sizes_px: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """(count, 2) in any direction; sizes over a decade or more are drawn with uniform logarithms."""
    angle, (least, most) = rng.uniform(0, 2 * np.pi, count), sizes_px
    wide = most > 10.0 * least
    length = np.exp(rng.uniform(np.log(least), np.log(most), count)) if wide else rng.uniform(least, most, count)
    return length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _scattered(
    corners: Corners, share: float, sizes_px: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Each corner on its own."""
    count = int(corners.seen.sum())
    chosen, shifts = rng.random(count) < share, _shifts(count, sizes_px, rng)
    wrong, moved = np.zeros(len(corners.seen), bool), corners.pixels.copy()
    wrong[np.flatnonzero(corners.seen)[chosen]] = True
    moved[wrong] += shifts[chosen]
    return moved, wrong


def _until(
    corners: Corners, share: float, rng: np.random.Generator, fault: Callable[[np.ndarray], None]
) -> tuple[np.ndarray, np.ndarray]:
    """A fault, which moves some corners, again and again until the share of those seen is reached, in the mean."""
    moved = corners.pixels.copy()
    seen = corners.seen
    for _ in range(50):
        before = np.any(moved != corners.pixels, axis=1)
        fault(moved)
        after = np.any(moved != corners.pixels, axis=1)
        more, had = (after & seen).sum() / seen.sum(), (before & seen).sum() / seen.sum()
        # the last one stays as often as makes the share right in the mean
        if more > had and (more >= share) and rng.random() >= (share - had) / (more - had):
            moved[after & ~before] = corners.pixels[after & ~before]
            return moved, before
        if more >= share:
            break
    return moved, np.any(moved != corners.pixels, axis=1)


def _marker(
    corners: Corners, share: float, sizes_px: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A marker is misread: the four corners around it are shifted together."""
    grid = corners.grid

    def misread(moved: np.ndarray) -> None:
        row, column = (int(rng.integers(size - 1)) for size in grid.shape)
        four = grid[row : row + 2, column : column + 2].ravel()
        moved[four] = corners.pixels[four] + _shifts(1, sizes_px, rng)

    return _until(corners, share, rng, misread)


def _swapped(
    corners: Corners, share: float, sizes_px: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Two ids are exchanged."""
    seen = np.flatnonzero(corners.seen)

    def exchange(moved: np.ndarray) -> None:
        pair = rng.choice(seen, 2, replace=False)
        if not np.any(moved[pair] != corners.pixels[pair]):
            moved[pair] = corners.pixels[pair[::-1]]

    return _until(corners, share, rng, exchange)


def _mirrored(
    corners: Corners, share: float, sizes_px: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A reflection: a patch is seen mirrored, where it is."""
    grid = corners.grid

    def reflect(moved: np.ndarray) -> None:
        height, width = (int(rng.integers(_PATCH[0], min(_PATCH[1], size) + 1)) for size in grid.shape)
        row, column = (int(rng.integers(size - own + 1)) for size, own in zip(grid.shape, (height, width), strict=True))
        patch = grid[row : row + height, column : column + width]
        if corners.seen[patch].all() and not np.any(moved[patch] != corners.pixels[patch]):
            moved[patch] = corners.pixels[patch[:, ::-1]]

    return _until(corners, share, rng, reflect)


def _row(
    corners: Corners, share: float, sizes_px: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A row is counted from the wrong end or marker: all its corners are one square off."""
    grid = corners.grid

    def shift(moved: np.ndarray) -> None:
        row = grid[rng.integers(len(grid))]
        own = corners.pixels[row]
        moved[row] = np.vstack([own[1:], 2.0 * own[-1] - own[-2]])

    return _until(corners, share, rng, shift)


def _view(
    corners: Corners, share: float, sizes_px: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """All ids of the view are wrong, where the share is not nil: mirrored, or in any order."""
    if not share:
        return corners.pixels, np.zeros(len(corners.seen), bool)
    seen = np.flatnonzero(corners.seen)
    mirrored = corners.grid[:, ::-1].ravel()[seen]
    other = mirrored if rng.random() < 0.5 and corners.seen[mirrored].all() else rng.permutation(seen)
    moved = corners.pixels.copy()
    moved[seen] = corners.pixels[other]
    return moved, np.any(moved != corners.pixels, axis=1)


def whole_views(share: float, views: int, rng: np.random.Generator) -> tuple[int, ...]:
    """Which views are wrong as a whole: one at least."""
    return tuple(rng.choice(views, max(1, round(share * views)), replace=False).tolist())


FAULTS: dict[str, Fault] = {
    "scattered": _scattered,
    "marker": _marker,
    "swapped": _swapped,
    "mirrored": _mirrored,
    "row": _row,
    "view": _view,
}
"""By name."""
