"""Corners that are grossly wrong, one by one or together, as detectors and light make them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_PATCH = (3, 4)
"""Corners along a side of what a reflection mirrors, fewest and most."""
_TRIES = 50


@dataclass(frozen=True, eq=False)
class Corners:
    """All corners of a board, row by row: pixels (C, 2), ids (rows, columns), which are seen (C,)."""

    pixels: np.ndarray
    ids: np.ndarray
    seen: np.ndarray

    def some(self, height: int, width: int, rng: np.random.Generator) -> np.ndarray:
        """(height, width) ids of corners side by side."""
        row, column = (rng.integers(size - own + 1) for size, own in zip(self.ids.shape, (height, width), strict=True))
        return self.ids[row : row + height, column : column + width]


_Fault = Callable[[Corners, tuple[float, float], np.random.Generator], tuple[np.ndarray, np.ndarray]]
"""One fault: ids (n,) and where these corners are seen instead (n, 2)."""


def shifts(count: int, sizes_px: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """(count, 2) in any direction; sizes over a decade or more are drawn with uniform logarithms."""
    angle, (least, most) = rng.uniform(0, 2 * np.pi, count), sizes_px
    wide = most > 10.0 * least
    length = np.exp(rng.uniform(np.log(least), np.log(most), count)) if wide else rng.uniform(least, most, count)
    return length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _marker(corners: Corners, sizes_px: tuple[float, float], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A marker is misread: the four corners around it are shifted together."""
    four = corners.some(2, 2, rng).ravel()
    return four, corners.pixels[four] + shifts(1, sizes_px, rng)


def _swapped(corners: Corners, _: tuple[float, float], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two ids are exchanged."""
    pair = rng.choice(np.flatnonzero(corners.seen), 2, replace=False)
    return pair, corners.pixels[pair[::-1]]


def _mirrored(corners: Corners, _: tuple[float, float], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A reflection: a patch is seen mirrored, where it is; its middle column stays."""
    height, width = rng.integers(_PATCH[0], np.minimum(corners.ids.shape, _PATCH[1]) + 1)
    patch = corners.some(height, width, rng)
    return patch.ravel(), corners.pixels[patch[:, ::-1].ravel()]


def _row(corners: Corners, _: tuple[float, float], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A row is counted from a wrong marker: all its corners are one square off."""
    row = corners.some(1, corners.ids.shape[1], rng)[0]
    own = corners.pixels[row]
    return row, np.vstack([own[1:], 2.0 * own[-1] - own[-2]])


def _view(corners: Corners, _: tuple[float, float], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """All ids are wrong: mirrored, or in any order."""
    seen, mirrored = np.flatnonzero(corners.seen), corners.ids[:, ::-1].ravel()[corners.seen]
    return seen, corners.pixels[
        mirrored if corners.seen[mirrored].all() and rng.random() < 0.5 else rng.permutation(seen)
    ]


_TOGETHER: dict[str, _Fault] = {
    "marker": _marker,
    "swapped": _swapped,
    "mirrored": _mirrored,
    "row": _row,
    "view": _view,
}
SCATTERED, VIEW = "scattered", "view"
FAULTS = (SCATTERED, *_TOGETHER)
"""Each corner on its own, or in groups."""


def spoilt(
    corners: Corners, kind: str, share: float, sizes_px: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (C, 2) of which a share, in the mean, is wrong; which are (C,). sizes_px : least and largest shift."""
    count, moved = int(corners.seen.sum()), corners.pixels.copy()
    if kind == SCATTERED:
        chosen, by = rng.random(count) < share, shifts(count, sizes_px, rng)
        moved[np.flatnonzero(corners.seen)[chosen]] += by[chosen]
        return moved, np.any(moved != corners.pixels, axis=1)
    left = rng.binomial(count, share)
    for _ in range(_TRIES):
        ids, where = _TOGETHER[kind](corners, sizes_px, rng)
        # the last one as often as makes the share right
        if rng.random() * len(ids) >= left:
            break
        if not np.any(moved[ids] != corners.pixels[ids]):
            moved[ids] = where
            left -= int((corners.seen[ids] & np.any(where != corners.pixels[ids], axis=1)).sum())
    return moved, np.any(moved != corners.pixels, axis=1)
