"""Why a board spec does not fit the pictures: the cause in words, found by trying the alternatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from targets.board import DICTIONARIES, BoardSpec

Markers = tuple[np.ndarray, np.ndarray]
"""Marker ids (M,) and their outlines (M, 4, 2) px in one picture."""

_PICTURES_TRIED = 4
_LAYOUT_PICTURES = 10
_MARKERS_NEEDED = 4
_PAIRS_NEEDED = 6
_LARGEST_WIDTH = 60
# the unit square's outline in OpenCV's marker corner order, about its centre
_OUTLINE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
_APRILTAGS = ("DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11")
# small dictionaries first: the large ones contain them
_DICTIONARIES = (*DICTIONARIES, *_APRILTAGS, "DICT_ARUCO_ORIGINAL")


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


def _neighbours(found: Markers, cells: np.ndarray, marker_per_square: float) -> tuple[np.ndarray, np.ndarray]:
    """(M, M) pairs of markers within two squares of each other in a layout, and which of them stand so in the picture.

    Each marker's outline predicts where its neighbours stand; a pair fits when that misses by less than 0.6 squares.
    Being local, this bears any lens.
    """
    ids, outlines = found
    centres = outlines.mean(axis=1)
    per_square = px_per_square(outlines, marker_per_square)
    steps = cells[ids][None] - cells[ids][:, None]
    distance = np.abs(steps).max(axis=-1)
    near = (distance > 0) & (distance <= 2)
    predicted = centres[:, None] + np.einsum("ipb,ijb->ijp", per_square, steps)
    miss_px = np.linalg.norm(centres[None] - predicted, axis=-1)
    square_px = np.sqrt(np.abs(np.linalg.det(per_square)))
    return near, near & (miss_px < 0.6 * square_px[:, None])


def _on_board(found: Markers, cells: np.ndarray) -> Markers:
    ids, outlines = found
    return ids[ids < len(cells)], outlines[ids < len(cells)]


def misplaced_pairs(markers: Sequence[Markers], cells: np.ndarray, marker_per_square: float) -> tuple[int, int]:
    """How many pairs of neighbouring markers contradict a layout, and how many there are."""
    wrong = total = 0
    for found in markers:
        near, fits = _neighbours(_on_board(found, cells), cells, marker_per_square)
        wrong += int((near & ~fits).sum())
        total += int(near.sum())
    return wrong, total


def distinctive_pairs(
    markers: Sequence[Markers], cells: np.ndarray, rival_cells: np.ndarray, marker_per_square: float
) -> int:
    """How many pairs of neighbouring markers fit a layout and stand differently in the rival layout."""
    votes = 0
    for found in markers:
        ids, outlines = _on_board(found, cells)
        _, fits = _neighbours((ids, outlines), cells, marker_per_square)
        steps, rival = (layout[ids][None] - layout[ids][:, None] for layout in (cells, rival_cells))
        votes += int((fits & (steps != rival).any(axis=-1)).sum())
    return votes


def legacy_flag_is_wrong(markers: Sequence[Markers], spec: BoardSpec) -> bool:
    """Whether the markers fit the board clearly better with the other legacy flag.

    With an odd number of columns and an even number of rows the two layouts differ by a shift of one square, so that
    corners are found and the fit is good under both; only the markers that wrap to the next row tell them apart.
    """
    if spec.squares_y % 2:
        return False
    ratio, count = spec.marker_m / spec.square_m, spec.squares_x * spec.squares_y // 2
    layouts = [marker_cells(spec.squares_x, flag, count) for flag in (spec.legacy_pattern, not spec.legacy_pattern)]
    here = distinctive_pairs(markers, layouts[0], layouts[1], ratio)
    other = distinctive_pairs(markers, layouts[1], layouts[0], ratio)
    return other >= _PAIRS_NEEDED and here < 0.2 * other


def rows_beyond(markers: Sequence[Markers], spec: BoardSpec) -> int:
    """Rows of squares that the pictures show beyond the board's last, judged by markers that continue its layout."""
    ratio, count = spec.marker_m / spec.square_m, spec.squares_x * spec.squares_y // 2
    highest = max((int(ids.max(initial=0)) for ids, _ in markers), default=0)
    cells = marker_cells(spec.squares_x, spec.legacy_pattern and spec.squares_y % 2 == 0, highest + 1)
    fitting = np.zeros(highest + 1, int)
    for ids, outlines in markers:
        _, fits = _neighbours((ids, outlines), cells, ratio)
        np.add.at(fitting, ids, fits.sum(axis=1))
    seen = np.flatnonzero(fitting[count:] >= _PAIRS_NEEDED) + count
    return int(cells[seen, 1].max()) + 1 - spec.squares_y if len(seen) else 0


def explain_mismatch(read: Callable[[int], np.ndarray], markers: Sequence[Markers], spec: BoardSpec) -> str | None:
    """The likely cause in words, or None.

    Parameters
    ----------
    read : picture of an index, (H, W) uint8.
    markers : per picture, what was found with the spec's dictionary.
    """
    chosen = np.unique(np.linspace(0, len(markers) - 1, _PICTURES_TRIED).astype(int))
    tried = [markers[index] for index in chosen]
    if sum(len(ids) for ids, _ in tried) < _MARKERS_NEEDED * len(tried):
        pictures = [read(index) for index in chosen]
        return _other_dictionary(pictures, tried, spec) or _turned_pictures(pictures, spec)
    return _other_layout(markers, spec)


def _find(picture: np.ndarray, dictionary: str, inverted: bool = False) -> Markers:
    parameters = cv2.aruco.DetectorParameters()
    parameters.detectInvertedMarker = inverted
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    outlines, ids, _ = cv2.aruco.ArucoDetector(known, parameters).detectMarkers(picture)
    found = np.zeros(0, int) if ids is None else np.asarray(ids, int).ravel()
    return found, np.asarray(outlines, float).reshape(-1, 4, 2)


def _other_dictionary(pictures: Sequence[np.ndarray], found: Sequence[Markers], spec: BoardSpec) -> str | None:
    counts = {name: sum(len(_find(picture, name)[0]) for picture in pictures) for name in _DICTIONARIES}
    most = max(counts.values())
    if most < max(_MARKERS_NEEDED, 2 * sum(len(ids) for ids, _ in found)):
        return None
    name = next(name for name, count in counts.items() if count >= 0.9 * most)
    return f"{counts[name]} markers of {name} are found in {len(pictures)} of them, of {spec.dictionary} hardly any"


def _turned_pictures(pictures: Sequence[np.ndarray], spec: BoardSpec) -> str | None:
    if sum(len(_find(cv2.flip(picture, 1), spec.dictionary)[0]) >= _MARKERS_NEEDED for picture in pictures):
        return "the markers are found only in the mirror image (the pictures are mirrored)"
    if sum(len(_find(picture, spec.dictionary, inverted=True)[0]) >= _MARKERS_NEEDED for picture in pictures):
        return "the markers are found only with black and white exchanged (the board is a negative)"
    return None


def _other_layout(markers: Sequence[Markers], spec: BoardSpec) -> str | None:
    if legacy_flag_is_wrong(markers, spec):
        return f"the markers stand as in legacy_pattern: {str(not spec.legacy_pattern).lower()}"
    markers = sorted(markers, key=lambda found: len(found[0]))[-_LAYOUT_PICTURES:]
    ratio, count = spec.marker_m / spec.square_m, 1 + max(int(ids.max(initial=0)) for ids, _ in markers)
    best = None
    for squares_x in range(2, _LARGEST_WIDTH + 1):
        for on_even_squares in (False, True):
            wrong, total = misplaced_pairs(markers, marker_cells(squares_x, on_even_squares, count), ratio)
            if total >= _PAIRS_NEEDED and (best is None or wrong / total < best[0]):
                best = (wrong / total, squares_x, on_even_squares)
    if best is None or best[0] > 0.1:
        return None
    _, squares_x, on_even_squares = best
    rows = 1 + int(marker_cells(squares_x, on_even_squares, count)[-1, 1])
    differences = []
    if squares_x != spec.squares_x:
        differences.append(f"squares_x: {squares_x} (not {spec.squares_x})")
    if rows > spec.squares_y:
        differences.append(f"squares_y: {rows} or more (not {spec.squares_y})")
    if on_even_squares and not spec.legacy_pattern:
        differences.append("legacy_pattern: true with an even squares_y")
    return f"the markers, with ids up to {count - 1}, stand as in {', '.join(differences)}" if differences else None
