"""Why a board spec does not fit the pictures, and the spec that does, found by trying.

A layout fits when neighbouring markers lie relative to one another as it says.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from targets.board import DICTIONARIES, DICTIONARY_SIZES, BoardSpec, spec_line
from vbaa_calib.core.errors import Diagnosis

MIRRORED = "the markers are found only in the mirror image (the pictures are mirrored: mirror them back)"
_NEGATIVE = "the markers are found only with black and white exchanged (the board is a negative: print it anew)"
_BOTH = f"{MIRRORED}; {_NEGATIVE}"
PICTURES_TRIED, _LAYOUT_PICTURES = 4, 10
_APRILTAGS = ("DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11")
# the largest of each family holds the smaller ones
_FAMILIES = (*(name for name in DICTIONARIES if name.endswith("_1000")), *_APRILTAGS, "DICT_ARUCO_ORIGINAL")
_CONTRADICTED = 0.2
_RATIO_OFF, _RATIO_OFF_PX = 0.08, 2.0
"""Error of the marker-to-square ratio that is reported. In drawn pictures an error of 0.1 raises the corners' error
from 0.03 to 0.05 px, one of 0.25 from 0.04 to 0.4 px."""
_PAIRS_NEEDED = 6
"""Least number of agreeing pairs of markers for any conclusion."""
_MISS_SQUARES = 0.6
_LARGEST_WIDTH = 60
_RATIOS = (0.2, 1.0)
_NEAR = 2
# the unit square's outline in OpenCV's marker corner order, about its centre
_OUTLINE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
# contours run through the centres of the outermost black pixels: half a pixel inside the edge, on either side
_CONTOUR_PX = 1.0


def marker_cells(squares_x: int, on_even_squares: bool, count: int) -> np.ndarray:
    """(count, 2) column and row of each marker id, numbered along the rows on every other square.

    on_even_squares : the first square has a marker (OpenCV's legacy layout with an even number of rows).
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
        """(M, M, 2) from each marker's centre to every other's, along the board's x and y in sides of the first."""
        centres = self.outlines.mean(axis=1)
        return np.einsum("ibp,ijp->ijb", np.linalg.pinv(self.px_per_marker), centres[None] - centres[:, None])

    def below(self, count: int) -> Markers:
        """The markers with ids below `count`."""
        low = self.ids < count
        return self if low.all() else Markers(self.ids[low], self.outlines[low])


@dataclass(frozen=True, eq=False)
class _MarkerLayout:
    """How well markers fit a layout.

    Attributes
    ----------
    squares_x, on_even_squares : the layout (`marker_cells`).
    ratio : best fitting marker side over square side.
    wrong, total : pairs of markers at most two squares apart that contradict the layout, and all such pairs.
    fits : (count,) number of fitting pairs that begin with each id.
    """

    squares_x: int
    on_even_squares: bool
    ratio: float
    wrong: int
    total: int
    fits: np.ndarray

    @property
    def agreeing(self) -> int:
        return self.total - self.wrong

    @property
    def share_wrong(self) -> float:
        return self.wrong / max(self.total, 1)

    @property
    def cells(self) -> np.ndarray:
        """(count, 2) column and row of each id."""
        return marker_cells(self.squares_x, self.on_even_squares, len(self.fits))


def judge(pictures: Sequence[Markers], squares_x: int, on_even_squares: bool, count: int) -> _MarkerLayout:
    """How well the markers with ids under `count` fit a layout.

    Each marker's outline predicts its neighbours' places; a pair fits if they are within 0.6 squares. This is local and
    so holds for any lens. The marker-to-square ratio is found from the same pairs.
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
    return _MarkerLayout(squares_x, on_even_squares, ratio, int((~good).sum()), len(good), fits)


def _distinctive_pairs(pictures: Sequence[Markers], here: _MarkerLayout, other: _MarkerLayout) -> int:
    """Number of pairs of neighbouring markers that fit the layout `here` and would lie differently in `other`."""
    cells, votes = (here.cells, other.cells), 0
    for picture in (picture.below(len(here.fits)) for picture in pictures):
        step, rival = (layout[picture.ids][None] - layout[picture.ids][:, None] for layout in cells)
        near = (np.abs(step).max(axis=-1) <= _NEAR) & (step != rival).any(axis=-1)
        votes += int((near & (np.linalg.norm(here.ratio * picture.offsets - step, axis=-1) < _MISS_SQUARES)).sum())
    return votes


def _best_layout(pictures: Sequence[Markers], prefer: tuple[int, bool]) -> _MarkerLayout | None:
    """The layout with the smallest share of contradicting pairs, `prefer` (squares_x, on_even_squares) among equals.

    None with too few pairs, or if one in ten contradicts the best layout.
    """
    if sum(len(picture.ids) * (len(picture.ids) - 1) for picture in pictures) < _PAIRS_NEEDED:
        return None
    count = 1 + max((int(picture.ids.max(initial=-1)) for picture in pictures), default=-1)
    every = [(squares_x, even) for squares_x in range(2, _LARGEST_WIDTH + 1) for even in (False, True)]
    best: _MarkerLayout | None = None
    for squares_x, even in [prefer, *every]:
        layout = judge(pictures, squares_x, even, count)
        if layout.agreeing >= _PAIRS_NEEDED and (best is None or layout.share_wrong < best.share_wrong - 1e-9):
            best = layout
    return best if best is not None and best.share_wrong <= 0.1 else None


def _vacant_below(picture: Markers, layout: _MarkerLayout, row: int, image_size: tuple[int, int]) -> int:
    """Number of places for markers of the next row that lie well inside the picture, beside markers of `row`."""
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


@dataclass(frozen=True, eq=False)
class _Sighting:
    """Markers per picture that agree on a layout, and how the pictures are mirrored or inverted ("" for not)."""

    dictionary: str
    turned: str
    markers: Sequence[Markers]
    layout: _MarkerLayout


def explain_mismatch(
    read: Callable[[int], np.ndarray], markers: Sequence[Markers], spec: BoardSpec, found: bool
) -> Diagnosis | None:
    """What is wrong with the spec; None if nothing is, or if that cannot be determined.

    Parameters
    ----------
    read : reads a picture (H, W) uint8 by its index.
    markers : markers of the spec's dictionary in each picture.
    found : whether the board's corners are found in enough pictures.
    """
    own = judge(markers, spec.squares_x, spec.starts_with_marker, spec.marker_count)
    doubtful = own.total >= _PAIRS_NEEDED and own.share_wrong > _CONTRADICTED
    legacy_is_wrong = _legacy_is_wrong(markers, own, spec)
    if found and not doubtful and not legacy_is_wrong:
        highest = max((int(picture.ids.max(initial=-1)) for picture in markers), default=-1)
        layout = judge(markers, spec.squares_x, spec.starts_with_marker, max(highest + 1, 1))
        return _compared(_Sighting(spec.dictionary, "", markers, layout), spec)
    rich = sorted(markers, key=lambda picture: len(picture.ids))[-_LAYOUT_PICTURES:]
    seen = _best_layout(rich, (spec.squares_x, spec.starts_with_marker))
    # so many that they are no chance finds of a dictionary that is not on the board
    if seen is not None and (seen.fits > 0).sum() >= _PAIRS_NEEDED:
        if legacy_is_wrong:
            seen = judge(markers, spec.squares_x, not spec.starts_with_marker, len(seen.fits))
        return _compared(_Sighting(spec.dictionary, "", markers, seen), spec)
    chosen = np.unique(np.linspace(0, len(markers) - 1, PICTURES_TRIED).astype(int))
    sighting = _searched([read(int(index)) for index in chosen], (spec.squares_x, spec.starts_with_marker))
    return None if sighting is None else _compared(sighting, spec)


def fitting_board(pictures: Sequence[np.ndarray], square_m: float) -> BoardSpec | str | None:
    """The ChArUco board in pictures (H, W) uint8, given the side of its squares; only the dictionary's name where no
    BoardSpec fits, None without markers."""
    any_board = BoardSpec(3, 3, square_m, 0.75 * square_m)
    sighting = _searched(pictures, (any_board.squares_x, False))
    return None if sighting is None else _fitting_spec(sighting, any_board) or sighting.dictionary


def markers_within(picture: np.ndarray, corners_px: np.ndarray) -> int:
    """Largest number of markers of one dictionary within the hull of corners (N, 2) px, N ≥ 3."""
    hull = cv2.convexHull(corners_px.astype(np.float32))
    counts = []
    for dictionary in _FAMILIES:
        centres = _find_markers(picture, dictionary).outlines.mean(axis=1)
        counts.append(sum(cv2.pointPolygonTest(hull, centre, False) > 0 for centre in centres.tolist()))
    return max(counts)


def _legacy_is_wrong(markers: Sequence[Markers], own: _MarkerLayout, spec: BoardSpec) -> bool:
    """Whether the markers fit the board clearly better with the other legacy flag.

    With odd columns and even rows the two layouts differ by a shift of one square: corners are found under both, and
    only markers that wrap to the next row tell them apart.
    """
    if spec.squares_y % 2:
        return False
    rival = judge(markers, spec.squares_x, not own.on_even_squares, spec.marker_count)
    here, other = _distinctive_pairs(markers, own, rival), _distinctive_pairs(markers, rival, own)
    return other >= _PAIRS_NEEDED and here < 0.2 * other


def _searched(pictures: Sequence[np.ndarray], prefer: tuple[int, bool]) -> _Sighting | None:
    """The markers that agree best on a layout, in the pictures as they are, else mirrored or inverted."""
    for turned in ("", MIRRORED, _NEGATIVE, _BOTH):
        seen = [cv2.flip(picture, 1) for picture in pictures] if turned in (MIRRORED, _BOTH) else pictures
        seen = [255 - picture for picture in seen] if turned in (_NEGATIVE, _BOTH) else seen
        found = []
        for dictionary in _FAMILIES:
            markers = [_find_markers(picture, dictionary) for picture in seen]
            layout = _best_layout(markers, prefer)
            if layout is not None:
                found.append(_Sighting(dictionary, turned, markers, layout))
        if found:
            return max(found, key=lambda one: one.layout.agreeing)
    return None


def _find_markers(picture: np.ndarray, dictionary: str) -> Markers:
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    outlines, ids, _ = cv2.aruco.ArucoDetector(known).detectMarkers(picture)
    found = np.zeros(0, int) if ids is None else np.asarray(ids, int).ravel()
    return Markers(found, np.asarray(outlines, float).reshape(-1, 4, 2))


def _compared(sighting: _Sighting, spec: BoardSpec) -> Diagnosis | None:
    """How the board in the pictures differs from the spec."""
    fitting = _fitting_spec(sighting, spec)
    if fitting is None:
        turned = (sighting.turned,) if sighting.turned else ()
        remedy = f"print a board whose markers are of one of {DICTIONARIES[0]} … {DICTIONARIES[-1]}"
        return _mismatch((*turned, f"its markers are of {sighting.dictionary}"), remedy)
    legacy, named = (str(each.legacy_pattern).lower() for each in (fitting, spec))
    ratios = f"{sighting.layout.ratio:.2f} of a square, not {spec.marker_m / spec.square_m:.2f}"
    counts, exchanged = (spec.squares_x, spec.squares_y), (spec.squares_y, spec.squares_x)
    differences = (
        (sighting.turned != "", sighting.turned),
        (fitting.dictionary != spec.dictionary, f"dictionary: {fitting.dictionary} (not {spec.dictionary})"),
        (fitting.squares_x != spec.squares_x, f"squares_x: {fitting.squares_x} (not {spec.squares_x})"),
        (fitting.squares_y != spec.squares_y, f"squares_y is {fitting.squares_y} or more (not {spec.squares_y})"),
        (exchanged == (fitting.squares_x, fitting.squares_y) != counts, "squares_x and squares_y are exchanged"),
        (legacy != named, f"the markers stand as in legacy_pattern: {legacy} (not {named})"),
        (fitting.marker_m != spec.marker_m, f"marker_m: {fitting.marker_m:g} (markers measure {ratios})"),
    )
    causes = tuple(words for differs, words in differences if differs)
    return _mismatch(causes, f"this board fits: {spec_line(fitting)}") if causes else None


def _mismatch(causes: tuple[str, ...], remedy: str) -> Diagnosis:
    name = "mirrored_picture" if causes == (MIRRORED,) else "wrong_board"
    return Diagnosis(name, ", ".join(causes), remedy, "wrong")


def _fitting_spec(sighting: _Sighting, spec: BoardSpec) -> BoardSpec | None:
    """The spec of the board in the pictures, undetermined fields kept; None if its dictionary is not supported."""
    layout, columns, even = sighting.layout, sighting.layout.squares_x, sighting.layout.on_even_squares
    seen = layout.fits >= _PAIRS_NEEDED
    rows = int(layout.cells[seen if seen.any() else layout.fits > 0, 1].max(initial=-1)) + 1
    # the first square holds a marker only on boards with an even number of rows
    rows = max(rows + rows % 2 if even else rows, 2)
    if columns == spec.squares_x and rows <= spec.squares_y and even == spec.starts_with_marker:
        rows = spec.squares_y
    # the small dictionaries of a family are the beginnings of the large ones
    family = sighting.dictionary.rpartition("_")[0]
    enough = [f"{family}_{size}" for size in DICTIONARY_SIZES if size >= columns * rows // 2]
    if sighting.dictionary not in DICTIONARIES or not enough:
        return None
    return dataclasses.replace(
        spec,
        squares_x=columns,
        squares_y=rows,
        legacy_pattern=even or (spec.legacy_pattern and rows % 2 == 1),
        dictionary=spec.dictionary if spec.dictionary in enough else enough[0],
        marker_m=_marker_m(sighting, spec),
    )


def _marker_m(sighting: _Sighting, spec: BoardSpec) -> float:
    """The spec's marker side, or that in the pictures if it clearly differs."""
    ratio, named = sighting.layout.ratio, spec.marker_m / spec.square_m
    sides = [np.sqrt(np.abs(np.linalg.det(picture.px_per_marker))) for picture in sighting.markers if len(picture.ids)]
    side_px = float(np.median(np.concatenate(sides))) if sides else 0.0
    tolerance = max(_RATIO_OFF, _RATIO_OFF_PX * ratio / max(side_px, 1.0))
    sure = sighting.layout.agreeing >= _PAIRS_NEEDED and 0.25 < ratio < 0.98
    return float(f"{round(ratio, 2) * spec.square_m:.4g}") if sure and abs(ratio - named) > tolerance else spec.marker_m


def rows_too_many(markers: Sequence[Markers], spec: BoardSpec, image_size: tuple[int, int]) -> int:
    """Number of the spec's last rows that the board lacks: their places are in view and show no marker.

    A note rather than an error: the corners keep their ids, and the sheet may be covered there.
    """
    layout = judge(markers, spec.squares_x, spec.starts_with_marker, spec.marker_count)
    if not layout.fits.any():
        return 0
    last = int(layout.cells[np.flatnonzero(layout.fits)[-1], 1])
    vacant = [_vacant_below(picture, layout, last, image_size) for picture in markers]
    sure = sum(vacant) >= _PAIRS_NEEDED and sum(one >= 2 for one in vacant) >= min(3, len(markers))
    return spec.squares_y - 1 - last if sure else 0
