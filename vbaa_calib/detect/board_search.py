"""Which markers are in pictures in which the spec's are not: other dictionaries, mirrored pictures, negatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import DICTIONARIES, BoardSpec

from .board_layout import Layout, Markers, best_layout

MIRRORED = "the markers are found only in the mirror image (the pictures are mirrored: mirror them back)"
NEGATIVE = "the markers are found only with black and white exchanged (the board is a negative: print it anew)"
_BOTH = f"{MIRRORED}; {NEGATIVE}"
_PICTURES_TRIED = 4
_APRILTAGS = ("DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11")
# the largest of each family holds the smaller ones
_FAMILIES = (*(name for name in DICTIONARIES if name.endswith("_1000")), *_APRILTAGS, "DICT_ARUCO_ORIGINAL")


@dataclass(frozen=True, eq=False)
class Sighting:
    """Markers that agree on a layout: their dictionary, how the pictures are turned (in words, or ""), per picture."""

    dictionary: str
    turned: str
    markers: Sequence[Markers]
    layout: Layout


def search(read: Callable[[int], np.ndarray], count: int, spec: BoardSpec, least_pairs: int) -> Sighting | None:
    """The markers that agree best on a layout, in a few of `count` pictures, as they are or else turned somehow.

    read : index → picture (H, W).
    """
    chosen = np.unique(np.linspace(0, count - 1, _PICTURES_TRIED).astype(int))
    pictures = [read(int(index)) for index in chosen]
    prefer = (spec.squares_x, spec.legacy_pattern and spec.squares_y % 2 == 0)
    for turned in ("", MIRRORED, NEGATIVE, _BOTH):
        seen = [_turned(picture, turned) for picture in pictures]
        found: list[tuple[int, Sighting]] = []
        for dictionary in _FAMILIES:
            markers = [find_markers(picture, dictionary) for picture in seen]
            layout = best_layout(markers, prefer, least_pairs)
            if layout is not None:
                found.append((layout.total - layout.wrong, Sighting(dictionary, turned, markers, layout)))
        if found:
            return max(found, key=lambda one: one[0])[1]
    return None


def _turned(picture: np.ndarray, turned: str) -> np.ndarray:
    picture = cv2.flip(picture, 1) if turned in (MIRRORED, _BOTH) else picture
    return 255 - picture if turned in (NEGATIVE, _BOTH) else picture


def find_markers(picture: np.ndarray, dictionary: str) -> Markers:
    """Markers of a dictionary (its OpenCV name) in a picture (H, W) uint8."""
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    outlines, ids, _ = cv2.aruco.ArucoDetector(known).detectMarkers(picture)
    found = np.zeros(0, int) if ids is None else np.asarray(ids, int).ravel()
    return Markers(found, np.asarray(outlines, float).reshape(-1, 4, 2))
