"""Why a board spec does not fit the pictures: the causes in words and the spec that fits, found by trying."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import yaml

from targets.board import DICTIONARIES, DICTIONARY_SIZES, BoardSpec

from .layout import Layout, Markers, best_layout, distinctive_pairs, judge, marker_cells, vacant_below

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
            markers = [_find_markers(picture, dictionary) for picture in seen]
            layout = best_layout(markers, prefer, least_pairs)
            if layout is not None:
                found.append((layout.total - layout.wrong, Sighting(dictionary, turned, markers, layout)))
        if found:
            return max(found, key=lambda one: one[0])[1]
    return None


def _turned(picture: np.ndarray, turned: str) -> np.ndarray:
    picture = cv2.flip(picture, 1) if turned in (MIRRORED, _BOTH) else picture
    return 255 - picture if turned in (NEGATIVE, _BOTH) else picture


def _find_markers(picture: np.ndarray, dictionary: str) -> Markers:
    """Markers of a dictionary (its OpenCV name) in a picture (H, W) uint8."""
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    outlines, ids, _ = cv2.aruco.ArucoDetector(known).detectMarkers(picture)
    found = np.zeros(0, int) if ids is None else np.asarray(ids, int).ravel()
    return Markers(found, np.asarray(outlines, float).reshape(-1, 4, 2))


PAIRS_NEEDED = 6
_LAYOUT_PICTURES = 10
_CONTRADICTED = 0.2
_RATIO_OFF, _RATIO_OFF_PX = 0.08, 2.0
"""How far the markers' share of a square may be off before it is called wrong. By 0.1 it costs up to half as much again
in drawn corners (0.03 px to 0.05 px), by 0.25 up to ten times (0.04 px to 0.4 px)."""


@dataclass(frozen=True)
class Mismatch:
    """Causes in words, and the spec that fits the pictures; None where no spec can say it."""

    causes: tuple[str, ...]
    fitting: BoardSpec | None

    @property
    def remedy(self) -> str:
        """What to do, with the fitting spec as a line of YAML that can be pasted."""
        if self.fitting is None:
            return f"print a board whose markers are of one of {DICTIONARIES[0]} … {DICTIONARIES[-1]}"
        return f"this board fits: {_as_yaml(self.fitting)}"


def _as_yaml(spec: BoardSpec) -> str:
    """The spec as one line of YAML, as board.yaml has it."""
    return yaml.safe_dump(spec.to_dict(), default_flow_style=True, sort_keys=False, width=10_000).strip()


def explain_mismatch(
    read: Callable[[int], np.ndarray], markers: Sequence[Markers], spec: BoardSpec, found: bool
) -> Mismatch | None:
    """What is wrong with the spec, or None where nothing is or nothing can be told.

    Parameters
    ----------
    read : picture of an index, (H, W) uint8.
    markers : per picture, what was found with the spec's dictionary.
    found : whether the board's corners are found in a fair share of the pictures.
    """
    own = judge(markers, spec.squares_x, _on_even(spec), _marker_count(spec))
    doubtful = own.total >= PAIRS_NEEDED and own.share_wrong > _CONTRADICTED
    rich = sorted(markers, key=lambda picture: len(picture.ids))[-_LAYOUT_PICTURES:]
    if found and not doubtful and not _legacy_is_wrong(markers, own, spec):
        highest = max((int(picture.ids.max(initial=-1)) for picture in markers), default=-1)
        layout = judge(markers, spec.squares_x, _on_even(spec), max(highest + 1, 1))
        return _compared(Sighting(spec.dictionary, "", markers, layout), spec)
    layout_seen = best_layout(rich, (spec.squares_x, _on_even(spec)), PAIRS_NEEDED)
    if layout_seen is not None and _fits_in(layout_seen):
        if _legacy_is_wrong(markers, own, spec):
            count = len(layout_seen.fits)
            layout_seen = judge(markers, spec.squares_x, not _on_even(spec), count)
        return _compared(Sighting(spec.dictionary, "", markers, layout_seen), spec)
    sighting = search(read, len(markers), spec, PAIRS_NEEDED)
    return None if sighting is None else _compared(sighting, spec)


def _fits_in(layout: Layout) -> bool:
    """Whether so many markers agree that they are no chance finds of a dictionary that is not on the board."""
    return int((layout.fits > 0).sum()) >= PAIRS_NEEDED


def _on_even(spec: BoardSpec) -> bool:
    return spec.legacy_pattern and spec.squares_y % 2 == 0


def _marker_count(spec: BoardSpec) -> int:
    return spec.squares_x * spec.squares_y // 2


def _legacy_is_wrong(markers: Sequence[Markers], own: Layout, spec: BoardSpec) -> bool:
    """Whether the markers fit the board clearly better with the other legacy flag.

    With an odd number of columns and an even number of rows the two layouts differ by a shift of one square, so that
    corners are found and the fit is good under both; only the markers that wrap to the next row tell them apart.
    """
    if spec.squares_y % 2:
        return False
    count = _marker_count(spec)
    rival = judge(markers, spec.squares_x, not own.on_even_squares, count)
    here = distinctive_pairs(markers, own, rival, count)
    other = distinctive_pairs(markers, rival, own, count)
    return other >= PAIRS_NEEDED and here < 0.2 * other


def _rows_seen(layout: Layout) -> int:
    """Rows of squares up to the last whose markers stand as the layout has them."""
    cells = marker_cells(layout.squares_x, layout.on_even_squares, len(layout.fits))
    seen = np.flatnonzero(layout.fits >= PAIRS_NEEDED)
    seen = seen if len(seen) else np.flatnonzero(layout.fits)
    rows = int(cells[seen, 1].max()) + 1 if len(seen) else 0
    # the first square holds a marker only on boards with an even number of rows
    return rows + rows % 2 if layout.on_even_squares else rows


def rows_too_many(markers: Sequence[Markers], spec: BoardSpec, image_size: tuple[int, int]) -> int:
    """Rows of the spec that are not on the board: their places lie well inside the pictures, and no marker is there.

    Harmless to the corners, which keep their ids, and a sheet may be covered there: a note, not an error.
    """
    count = _marker_count(spec)
    layout = judge(markers, spec.squares_x, _on_even(spec), count)
    if not layout.fits.any():
        return 0
    last = int(marker_cells(spec.squares_x, _on_even(spec), count)[np.flatnonzero(layout.fits)[-1], 1])
    vacant = [vacant_below(picture, layout, last, image_size) for picture in markers]
    sure = sum(vacant) >= PAIRS_NEEDED and sum(one >= 2 for one in vacant) >= min(3, len(markers))
    return spec.squares_y - 1 - last if sure else 0


def _compared(sighting: Sighting, spec: BoardSpec) -> Mismatch | None:
    """The differences between what is seen and the spec."""
    layout, causes = sighting.layout, []
    if sighting.turned:
        causes.append(sighting.turned)
    fitting = _fitting_spec(sighting, spec)
    if fitting is None:
        return Mismatch((*causes, f"its markers are of {sighting.dictionary}"), None)
    if fitting.dictionary != spec.dictionary:
        causes.append(f"dictionary: {fitting.dictionary} (not {spec.dictionary})")
    if fitting.squares_x != spec.squares_x:
        causes.append(f"squares_x: {fitting.squares_x} (not {spec.squares_x})")
    if fitting.squares_y != spec.squares_y:
        causes.append(f"squares_y is {fitting.squares_y} or more (not {spec.squares_y})")
    if (spec.squares_x, spec.squares_y) == (fitting.squares_y, fitting.squares_x) != (spec.squares_y, spec.squares_x):
        causes.append("squares_x and squares_y are exchanged")
    if fitting.legacy_pattern != spec.legacy_pattern:
        flag = str(fitting.legacy_pattern).lower()
        causes.append(f"the markers stand as in legacy_pattern: {flag} (not {str(spec.legacy_pattern).lower()})")
    if fitting.marker_m != spec.marker_m:
        causes.append(
            f"marker_m: {fitting.marker_m:g} (markers measure {layout.ratio:.2f} of a square, "
            f"not {spec.marker_m / spec.square_m:.2f})"
        )
    return Mismatch(tuple(causes), fitting) if causes else None


def _fitting_spec(sighting: Sighting, spec: BoardSpec) -> BoardSpec | None:
    """The spec that the pictures show: what they leave open is kept; None where its dictionary is none of ours."""
    layout = sighting.layout
    rows = max(_rows_seen(layout), 2)
    if layout.squares_x == spec.squares_x and rows <= spec.squares_y and layout.on_even_squares == _on_even(spec):
        rows = spec.squares_y
    legacy = layout.on_even_squares or (spec.legacy_pattern and rows % 2 == 1)
    dictionary = _dictionary(sighting.dictionary, spec.dictionary, layout.squares_x * rows // 2)
    if dictionary is None:
        return None
    return dataclasses.replace(
        spec,
        squares_x=layout.squares_x,
        squares_y=rows,
        legacy_pattern=legacy,
        dictionary=dictionary,
        marker_m=_marker_m(sighting, spec),
    )


def _dictionary(seen: str, named: str, markers: int) -> str | None:
    """The spec's own dictionary where it is of the family seen and large enough, else the smallest that is.

    The small ones of a family are the beginnings of the large ones.
    """
    if seen not in DICTIONARIES:
        return None
    family = seen.rpartition("_")[0]
    large_enough = [f"{family}_{size}" for size in DICTIONARY_SIZES if size >= markers]
    return named if named in large_enough else next(iter(large_enough), None)


def _marker_m(sighting: Sighting, spec: BoardSpec) -> float:
    """The spec's marker side, or that which the pictures show where it is clearly another."""
    ratio, named = sighting.layout.ratio, spec.marker_m / spec.square_m
    sides = [np.sqrt(np.abs(np.linalg.det(picture.px_per_marker))) for picture in sighting.markers if len(picture.ids)]
    side_px = float(np.median(np.concatenate(sides))) if sides else 0.0
    tolerance = max(_RATIO_OFF, _RATIO_OFF_PX * ratio / max(side_px, 1.0))
    sure = sighting.layout.total - sighting.layout.wrong >= PAIRS_NEEDED and 0.25 < ratio < 0.98
    return float(f"{round(ratio, 2) * spec.square_m:.4g}") if sure and abs(ratio - named) > tolerance else spec.marker_m
