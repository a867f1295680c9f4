"""Diagnosis of a board specification that does not fit the pictures, and the one that does: measured, and proposed
only if the board is then detected."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from targets.board import DICTIONARIES, DICTIONARY_SIZES, AprilGrid, Board, BoardSpec, Chessboard, CircleGrid, spec_line
from vbaa_calib.core.arrays import spread_evenly
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import Diagnosis, InputError
from vbaa_calib.core.images import read_gray

from .grids import find_grid, find_whole_chessboard
from .markers import TURNS, MarkerGrid, Markers, find_markers, marker_cells, marker_grids
from .settings import DetectionSettings

if TYPE_CHECKING:
    from .corners import BoardView

MIRRORED = "the markers are found only in the mirror image (the pictures are mirrored: mirror them back)"
_NEGATIVE = "the markers are found only with black and white exchanged (the board is a negative: print it anew)"
_BOTH = f"{MIRRORED}; {_NEGATIVE}"
Read = Callable[[int], np.ndarray]
"""A picture (H, W) uint8 by its index."""
Detect = Callable[[np.ndarray, Board], tuple[np.ndarray, np.ndarray]]
"""Ids (N,) and pixels (N, 2) of the corners of a board in a picture (H, W) uint8."""


def _families() -> dict[str, tuple[int, ...]]:
    """Marker dictionaries that contain all others, with the widths of the black borders with which they are printed."""
    wide = [name for name in DICTIONARIES if name.rpartition("_")[2] not in map(str, DICTIONARY_SIZES[:-1])]
    return {name: (1, 2) if "APRILTAG_36" in name else (1,) for name in wide}


@dataclass(frozen=True, eq=False)
class _Sighting:
    """Markers per picture with their relative positions, and whether the pictures are mirrored or inverted ("" for
    neither)."""

    dictionary: str
    border: int
    turned: str
    markers: Sequence[Markers]
    grids: Sequence[MarkerGrid]

    @property
    def votes(self) -> int:
        return int(self.grids[0].votes.sum()) if self.grids else 0


def _refuse(found: tuple[str, str] | None, paths: Sequence[Path]) -> None:
    """Raises InputError with the mismatch and its remedy, where one was found."""
    if found is not None:
        place = Path(paths[0]).parent if len(paths) > 1 else paths[0]
        raise InputError(f"the board spec does not fit the pictures: {found[0]}", where=place, remedy=found[1])


def refuse_wrong_spec(paths: Sequence[Path], views: Sequence[BoardView] | None, spec: Board, detect: Detect) -> None:
    """Raises InputError where a specification does not fit the pictures, or none contains a board: what is wrong,
    and the specification that fits. Unused entries and missing rows are printed.

    views : None before the search for corners, which is slow for a chessboard: only mismatches that show without it are
        refused.
    """

    def read(index: int) -> np.ndarray:
        return read_gray(paths[index])

    if views is None:
        if isinstance(spec, Chessboard):
            _refuse(_other_than_chessboard(read, len(paths), spec, detect), paths)
        return
    place = Path(paths[0]).parent if len(paths) > 1 else paths[0]
    visible = sum(len(view.ids) > 0 for view in views)
    markers = [Markers(view.marker_ids, view.marker_corners_px) for view in views]
    if isinstance(spec, BoardSpec | AprilGrid):
        found = sum(len(view.ids) >= DetectionSettings.few_corners for view in views) >= DetectionSettings.found * len(
            views
        )
        mismatch = explain_mismatch(read, markers, spec, found, detect)
        _refuse(None if mismatch is None else (mismatch.words, mismatch.remedy), paths)
    if not isinstance(spec, BoardSpec | AprilGrid) or not visible:
        _refuse(_other_kind(read, [view.corners_px for view in views], spec, detect), paths)
    if not visible:
        what, needed = "no board is found in any picture", "whole markers are in view"
        if not isinstance(spec, BoardSpec | AprilGrid):
            what, needed = f"{what}: without ids it counts only where it is seen whole", "the whole board is in view"
        elif words := _markers_in_words(markers, spec, read):
            remedy = "describe the board that is in the pictures, its first_id and dictionary too, or show more of it"
            raise InputError(f"{what}: {words}", where=place, remedy=remedy)
        raise InputError(what, where=place, remedy=f"check that the board is sharp, lit, large enough and {needed}")
    if not isinstance(spec, BoardSpec | AprilGrid):
        if visible < len(views):
            of = f"{len(views) - visible} of {len(views)} pictures"
            why = "without ids a part counts only where a picture of the whole board tells which it is"
            say(f"{place}: {of} do not show the whole board, and are of no use: {why}")
    elif isinstance(spec, BoardSpec) and (missing := _rows_too_many(markers, spec, views[0].image_size)):
        say(
            f"{place}: the pictures show room for the board's last {missing} rows and no marker there: is squares_y "
            f"{spec.squares_y - missing}, not {spec.squares_y}? The corners are the same."
        )


def explain_mismatch(
    read: Read,
    markers: Sequence[Markers],
    spec: BoardSpec | AprilGrid,
    found: bool,
    detect: Detect,
) -> Diagnosis | None:
    """What is wrong with the specification; None if nothing is, or if that cannot be determined.

    Parameters
    ----------
    read : reads a picture (H, W) uint8 by its index.
    markers : markers of the spec's dictionary in each picture.
    found : whether the board's corners are found in enough pictures.
    detect : with it a proposed spec is tried.
    """
    own = _Sighting(spec.dictionary, getattr(spec, "border", 1), "", markers, marker_grids(markers))
    grids = sorted(own.grids, key=lambda grid: -_agreement(grid, spec)[0])
    fits = found and not (grids and _contradicted(grids[0], spec))
    if fits and grids:
        beyond = _agreement(grids[0], spec)[0] > 0 and max(grids[0].cells) > spec.marker_ids.max()
        resized = isinstance(spec, AprilGrid) or _marker_m(own, grids[0], spec)
        grids = grids[:1] if beyond or resized else []
    if fits and not grids:
        return None
    pictures = [read(index) for index in _rich(markers)]
    if fits and isinstance(spec, AprilGrid) and _found(pictures, own, spec, detect) == spec:
        return None
    for grid in grids:
        if grid.votes.sum() >= DetectionSettings.votes and (seen := _proposed(own, grid, spec, pictures, detect)):
            return seen
    return None if found else _searched(pictures, spec, detect)


def _rich(markers: Sequence[Markers]) -> list[int]:
    """Indices of the pictures to try: evenly spaced, or those with most markers."""
    counts = np.array([len(picture.ids) for picture in markers])
    if counts.any():
        return np.argsort(-counts, kind="stable")[: DetectionSettings.tried].tolist()
    return spread_evenly(len(markers), DetectionSettings.tried).tolist()


def _markers_in_words(markers: Sequence[Markers], spec: BoardSpec | AprilGrid, read: Read) -> str:
    """A sentence on the markers in pictures without a board, and why they form none; "" without any."""
    dictionary = spec.dictionary
    if not any(len(picture.ids) for picture in markers):
        pictures = [read(index) for index in _rich(markers)]
        best = max(_sightings(pictures, ("",)), key=lambda one: one.votes, default=None)
        if best is None or best.votes < DetectionSettings.clear:
            return ""
        dictionary, markers = best.dictionary, best.markers
    ids = np.unique(np.concatenate([picture.ids for picture in markers]))
    own = np.sort(spec.marker_ids)
    seen = f"{len(ids)} marker{'s' if len(ids) > 1 else ''} of {dictionary} {'are' if len(ids) > 1 else 'is'} read"
    needed = f"the board has {_ranges(own)} of {spec.dictionary}"
    on_board = np.isin(ids, own) if dictionary == spec.dictionary else np.zeros(len(ids), bool)
    if not on_board.any():
        why = needed
    elif not any(grid.votes.sum() >= DetectionSettings.clear for grid in marker_grids(markers)):
        why = f"no two of them stand as neighbours on a board, and {needed}"
    else:
        why = f"they do not stand as on that board: {needed}"
    return f"{seen} ({_ranges(ids)}); {why}"


def _ranges(ids: np.ndarray) -> str:
    """Ids in words, such as "0 to 16, 20"."""
    runs = np.split(np.sort(ids), np.flatnonzero(np.diff(np.sort(ids)) > 1) + 1)
    words = [f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs]
    return ", ".join(words if len(words) < 6 else [*words[:4], "…", words[-1]])


def _sightings(pictures: Sequence[np.ndarray], turns: Sequence[str]) -> Iterator[_Sighting]:
    """The markers of each dictionary that form grids, most pairs first, in the pictures as they are, else as `turns`
    changes them."""
    families = [(dictionary, border) for dictionary, borders in _families().items() for border in borders]
    for turned in turns:
        seen = [cv2.flip(picture, 1) for picture in pictures] if turned in (MIRRORED, _BOTH) else pictures
        seen = [255 - picture for picture in seen] if turned in (_NEGATIVE, _BOTH) else seen
        likely, most = _likely(seen[: DetectionSettings.glances] if turned else seen, families), 0
        # the others only where the likely ones are not it, or markers may be too small for a glance
        small = not turned and max((picture.size for picture in seen), default=0) > DetectionSettings.glance_px
        for some in (likely, [one for one in families if one not in likely] if likely or small else []):
            every = []
            for dictionary, border in some:
                markers = [find_markers(picture, dictionary, border) for picture in seen]
                every.append(_Sighting(dictionary, border, turned, markers, marker_grids(markers)))
            # a wide border holds a narrower one
            every = sorted((one for one in every if one.votes), key=lambda one: -one.votes * one.border)
            yield from every
            most = max([most, *(one.votes for one in every)])
        if most >= DetectionSettings.votes:
            return


def _likely(pictures: Sequence[np.ndarray], families: Sequence[tuple[str, int]]) -> list[tuple[str, int]]:
    """The families with neighbouring markers in the first picture, reduced, that contains any."""
    for picture in pictures:
        scale = min(1.0, float(np.sqrt(DetectionSettings.glance_px / max(picture.size, 1))))
        shape = [max(round(scale * side), 1) for side in picture.shape[::-1]]
        small = picture if scale == 1.0 else cv2.resize(picture, shape, interpolation=cv2.INTER_AREA)
        found = [one for one in families if marker_grids([find_markers(small, *one)])]
        if found:
            return found
    return []


def _searched(pictures: Sequence[np.ndarray], spec: BoardSpec | AprilGrid, detect: Detect) -> Diagnosis | None:
    for sighting in _sightings(pictures, ("", MIRRORED, _NEGATIVE, _BOTH)):
        for grid in sighting.grids[:1]:
            if sighting.votes >= DetectionSettings.votes and (
                seen := _proposed(sighting, grid, spec, pictures, detect)
            ):
                return seen
    return None


def _proposed(
    sighting: _Sighting, grid: MarkerGrid, spec: BoardSpec | AprilGrid, pictures: Sequence[np.ndarray], detect: Detect
) -> Diagnosis | None:
    """Diagnosis with the first board that fits the grid, differs from the specification and is detected in the
    pictures, and with the differences; None without one."""
    for fitting in _fitting(sighting, grid, spec):
        if fitting == spec and not sighting.turned:
            continue
        found = _found(pictures, sighting, fitting, detect)
        if isinstance(found, AprilGrid) and isinstance(spec, AprilGrid):
            close = abs(found.spacing - spec.spacing) <= 2.0 * DetectionSettings.gap
            found = dataclasses.replace(found, spacing=spec.spacing) if close else found
            if found == spec and not sighting.turned:
                return None  # the described board fits: what others seem to fit is no news
        if found is not None and (causes := _causes(sighting, grid, found, spec)):
            name = "mirrored_picture" if causes == (MIRRORED,) else "wrong_board"
            return Diagnosis(name, ", ".join(causes), f"this board fits: {spec_line(found)}", "wrong")
    return None


def _found(pictures: Sequence[np.ndarray], sighting: _Sighting, fitting: Board, detect: Detect) -> Board | None:
    """The board, if it is detected in half of the pictures with its markers; an AprilGrid with the measured gap
    between tags."""
    works, gaps = list[bool](), [np.zeros(0)]
    for picture in pictures:
        seen = cv2.flip(picture, 1) if sighting.turned in (MIRRORED, _BOTH) else picture
        seen = 255 - seen if sighting.turned in (_NEGATIVE, _BOTH) else seen
        count = len(find_markers(seen, sighting.dictionary, sighting.border).ids)
        if count > 1:
            ids, corners_px = detect(seen, fitting)
            works.append(len(ids) >= max(DetectionSettings.corners * count, 1))
            if isinstance(fitting, AprilGrid):
                gaps.append(_gaps(ids, corners_px, fitting.corner_columns))
    if not works or sum(works) < 0.5 * len(works):
        return None
    measured = np.concatenate(gaps)
    if (
        isinstance(fitting, AprilGrid)
        and len(measured)
        and abs(np.median(measured) - fitting.spacing) > DetectionSettings.gap
    ):
        return dataclasses.replace(fitting, spacing=round(float(np.median(measured)), 2))
    return fitting


def _gaps(ids: np.ndarray, corners_px: np.ndarray, columns: int) -> np.ndarray:
    """Gaps between the tags of an AprilGrid, relative to the adjacent tags' sides, from corners in order."""
    runs = ids[3:] - ids[:-3] == 3
    runs &= (ids[:-3] % 2 == 0) & (ids[:-3] // columns == ids[3:] // columns)
    left, gap, right = (np.linalg.norm(np.diff(corners_px, axis=0), axis=1)[i : len(ids) - 3 + i] for i in range(3))
    return np.asarray(2.0 * gap[runs] / (left + right)[runs])


def _fitting(sighting: _Sighting, grid: MarkerGrid, spec: Board) -> Iterator[Board]:
    """Candidate boards with the markers of a grid, the likeliest first; lengths and unseen properties as specified."""
    if grid.diagonal:
        named = spec if isinstance(spec, BoardSpec) else BoardSpec(3, 3, spec.pitch_m, 0.75 * spec.pitch_m)
        yield from _charuco_boards(sighting, grid, named)
    else:
        yield from _april_grids(sighting, grid, spec)


def _april_grids(sighting: _Sighting, grid: MarkerGrid, spec: Board) -> Iterator[AprilGrid]:
    """Candidate AprilGrids: ids increase by one to the right and by `columns` upwards, with the tags in any
    rotation."""
    side_m = {BoardSpec: "marker_m", AprilGrid: "tag_m"}.get(type(spec))
    tag_m = getattr(spec, side_m) if side_m else float(f"{spec.pitch_m:.4g}")
    ids, cells = np.array(list(grid.cells)), np.array(list(grid.cells.values()))
    by_id = grid.pairs[:, 1] - grid.pairs[:, 0]
    for about in TURNS:
        (right, down), placed = (grid.steps @ about).T, cells @ about
        up = by_id[down == -1]
        columns = int(np.median(up)) if len(up) else int(np.ptp(placed[:, 0])) + 1
        agree = by_id == right - columns * down
        if columns < 1 or grid.votes[~agree].sum() > DetectionSettings.wrong * grid.votes.sum():
            continue
        column, row = (placed - placed.min(axis=0)).T
        first = int(np.median(ids - column - columns * (row.max() - row)))
        if np.ptp(column) + 1 < columns or first < 0:  # a part is seen: which, the ids tell
            first = 0
        if (
            isinstance(spec, AprilGrid)
            and (first - spec.first_id) % columns == 0
            and np.isin(ids, spec.marker_ids).all()
        ):
            first = spec.first_id
        rows = (int(ids.max()) - first) // columns + 1
        if isinstance(spec, AprilGrid) and (columns, first) == (spec.columns, spec.first_id):
            rows = max(rows, spec.rows)
        side_px = _side_px(sighting)
        # contours may run so much inside small tags
        spacings = [round(grid.unit * side_px / (side_px + short_px) - 1.0, 2) for short_px in (0.0, 2.0, 4.0)]
        for spacing in spacings:
            with suppress(ValueError):  # more tags than the dictionary has
                yield AprilGrid("aprilgrid", columns, rows, tag_m, spacing, sighting.dictionary, sighting.border, first)


def _agreement(grid: MarkerGrid, spec: BoardSpec | AprilGrid) -> tuple[int, int]:
    """Numbers of a grid's marker pairs that agree and disagree with the specified board."""
    if isinstance(spec, BoardSpec) != grid.diagonal:
        return 0, 0
    turns = TURNS[1:2] if isinstance(spec, BoardSpec) else TURNS
    ids, cells = spec.marker_ids, _cells_of(spec)
    order = np.argsort(ids)
    places = np.minimum(np.searchsorted(ids[order], grid.pairs), len(order) - 1)
    known = (ids[order][places] == grid.pairs).all(axis=1)
    between = np.diff(cells[order[places]], axis=1)[:, 0]
    agree = max(((grid.steps @ turn == between).all(axis=-1) for turn in turns), key=lambda one: one @ grid.votes)
    return int(grid.votes[known & agree].sum()), int(grid.votes[known & ~agree].sum())


def _cells_of(spec: BoardSpec | AprilGrid) -> np.ndarray:
    """(M, 2) column and row of each marker of a board."""
    if isinstance(spec, BoardSpec):
        return marker_cells(np.arange(spec.marker_count), spec.squares_x, spec.starts_with_marker)
    row, column = np.divmod(np.arange(len(spec.marker_ids)), spec.columns)
    return np.stack([column, row], axis=1)


def _contradicted(grid: MarkerGrid, spec: BoardSpec | AprilGrid) -> bool:
    """Whether the markers clearly contradict the specified layout."""
    agreeing, wrong = _agreement(grid, spec)
    if not isinstance(spec, BoardSpec):
        return wrong > DetectionSettings.contradicted * (agreeing + wrong)
    least = next((layout[0] for layout in _sequences(grid, spec)), 0)
    clear = wrong >= DetectionSettings.clear if not least else wrong >= DetectionSettings.votes
    return clear and least < DetectionSettings.contradicted * wrong


def _sequences(grid: MarkerGrid, spec: BoardSpec) -> Iterator[tuple[int, int, bool, int]]:
    """Layouts with consecutive ids that agree with the pairs, the best first: disagreeing pairs, squares_x, whether
    the first square contains a marker, and the first id up to whole pairs of rows."""
    found = []
    for width in range(2, DetectionSettings.widest + 1):
        index = grid.pairs - np.arange(width)[:, None, None] + width
        for even in (False, True):
            cells = marker_cells(index, width, even)
            wrong = ((cells[:, :, 1] - cells[:, :, 0] != grid.steps).any(axis=-1) * grid.votes).sum(axis=1)
            for first in np.flatnonzero(wrong <= DetectionSettings.wrong * grid.votes.sum()).tolist():
                own = (width, even, first) == (spec.squares_x, spec.starts_with_marker, spec.first_id % width)
                found.append(((int(wrong[first]), not own, first != 0, width != spec.squares_x), (width, even, first)))
    for (wrong, *_), layout in sorted(found):
        yield wrong, *layout


def _charuco_boards(sighting: _Sighting, grid: MarkerGrid, spec: BoardSpec) -> Iterator[BoardSpec]:
    """Candidate ChArUco boards with the markers of a grid: consecutive ids from 0 or another number on, or listed
    ids."""
    ids = np.array(sorted(grid.cells))
    fields = {"marker_m": _marker_m(sighting, grid, spec) or spec.marker_m}
    layouts, boards = list(_sequences(grid, spec)), list[BoardSpec]()
    for _, columns, even, rest in [one for one in layouts if one[0] == layouts[0][0]]:
        last = int(ids.min() - (ids.min() - rest) % columns)
        own = columns == spec.squares_x and even == spec.starts_with_marker
        for first in {spec.first_id if spec.first_id % columns == rest else -1, rest, last}:
            if not 0 <= first <= ids.min():
                continue
            rows = int(marker_cells(ids - first, columns, even)[:, 1].max()) + 1
            # the first square holds a marker only on boards with an even number of rows
            rows = max(rows + rows % 2 if even else rows, 2)
            rows = spec.squares_y if own and rows <= spec.squares_y else rows
            legacy = even or (spec.legacy_pattern and rows % 2 == 1)
            named = fields | {"squares_x": columns, "squares_y": rows, "legacy_pattern": legacy}
            board = _named(sighting, spec, named | {"first_id": first, "ids": None})
            boards += [] if board is None else [board]

    def unlike(board: BoardSpec) -> tuple[bool, ...]:
        keys = ("squares_x", "squares_y", "first_id", "legacy_pattern")
        other = [getattr(board, key) != getattr(spec, key) for key in keys]
        return other[0] or other[1], board.first_id != 0, *other[2:]

    yield from sorted(boards, key=unlike)[: DetectionSettings.tried]
    cells = {cell: number for number, cell in grid.cells.items()}
    columns, rows = np.max(list(cells), axis=0) + 1
    listed = [cells.get((column, row), -1) for row in range(rows) for column in range(columns) if (row + column) % 2]
    if not layouts and -1 not in listed and len(listed) == columns * rows // 2 == len(cells):
        named = fields | {"squares_x": int(columns), "squares_y": int(rows), "legacy_pattern": False}
        board = _named(sighting, spec, named | {"first_id": 0, "ids": tuple(listed)})
        if board is not None:
            yield board


def _named(sighting: _Sighting, spec: BoardSpec, fields: dict[str, Any]) -> BoardSpec | None:
    """The specification with other fields, and with its own dictionary if that contains the markers, else the
    smallest that does; None where there is none."""
    # the small dictionaries of a family are the beginnings of the large ones
    family = sighting.dictionary.rpartition("_")[0]
    small = [f"{family}_{size}" for size in DICTIONARY_SIZES if f"{family}_{size}" in DICTIONARIES]
    for name in dict.fromkeys([spec.dictionary] * (spec.dictionary in small) + (small or [sighting.dictionary])):
        try:
            return dataclasses.replace(spec, dictionary=name, **fields)
        except ValueError:
            continue
    return None


def _causes(sighting: _Sighting, grid: MarkerGrid, fitting: Board, spec: BoardSpec | AprilGrid) -> tuple[str, ...]:
    """Differences of the board in the pictures from the specification, in words."""
    turned = (sighting.turned,) if sighting.turned else ()
    if type(fitting) is not type(spec):
        kinds = {BoardSpec: "a ChArUco board", AprilGrid: "an AprilGrid"}
        return (*turned, f"{kinds[type(fitting)]} is in the pictures, the board spec says {kinds[type(spec)]}")
    here, there = (dict[str, Any](first_id=0, ids=None) | board.to_dict() for board in (fitting, spec))
    counts = [name for name in ("squares_x", "squares_y", "columns", "rows") if name in here]
    causes = [
        _cause(name, here[name], there[name], f"{1.0 / grid.unit:.2f} of a square, not {_share(spec):.2f}")
        for name in here
        if name not in ("square_m", "tag_m") and here[name] != there[name]
    ]
    if here["first_id"] != there["first_id"] or here["ids"] != there["ids"]:
        causes.append(f"the ids {_ranges(np.array(list(grid.cells)))} are read")
    if [here[name] for name in counts] == [there[name] for name in counts][::-1] != [there[name] for name in counts]:
        causes.append(f"{' and '.join(counts)} are exchanged")
    return (*turned, *causes)


def _share(spec: Board) -> float:
    return spec.marker_m / spec.square_m if isinstance(spec, BoardSpec) else float("nan")


def _cause(name: str, here: Any, there: Any, measured: str) -> str:
    """A sentence on one key in which the pictures' board and the specification differ."""
    match name:
        case "squares_y" | "rows":
            return f"{name} is {here} or more (not {there})"
        case "legacy_pattern":
            return f"the markers stand as in legacy_pattern: {str(here).lower()} (not {str(there).lower()})"
        case "marker_m":
            return f"marker_m: {here:g} (markers measure {measured})"
        case "ids":
            return "its ids stand in another order" if here else "its ids stand in sequence"
    return f"{name}: {here} (not {there})"


def _marker_m(sighting: _Sighting, grid: MarkerGrid, spec: BoardSpec) -> float | None:
    """The marker side measured in the pictures if it clearly differs from the specified one; None otherwise."""
    ratio, named = 1.0 / grid.unit, spec.marker_m / spec.square_m
    tolerance = max(DetectionSettings.ratio, DetectionSettings.ratio_px * ratio / _side_px(sighting))
    sure = grid.votes.sum() >= DetectionSettings.votes and 0.25 < ratio < 0.98
    return float(f"{round(ratio, 2) * spec.square_m:.4g}") if sure and abs(ratio - named) > tolerance else None


def _side_px(sighting: _Sighting) -> float:
    """The median marker's side."""
    sides = [np.sqrt(np.abs(np.linalg.det(picture.px_per_marker))) for picture in sighting.markers if len(picture.ids)]
    return max(float(np.median(np.concatenate(sides))), 1.0) if sides else 1.0


def _rows_too_many(markers: Sequence[Markers], spec: BoardSpec, image_size: tuple[int, int]) -> int:
    """Number of the specification's last rows that the board lacks: their places are in view and contain no marker.

    A note rather than an error: the corners keep their ids, and the sheet may be covered there.
    """
    cells = dict(zip(spec.marker_ids.tolist(), _cells_of(spec), strict=True))
    linked = {number for grid in marker_grids(markers) for number in grid.cells if number in cells}
    last = max((int(cells[number][1]) for number in linked), default=spec.squares_y - 1)
    vacant = [
        _vacant_below(picture, {n: int(cell[0]) for n, cell in cells.items() if cell[1] == last}, spec, image_size)
        for picture in markers
    ]
    sure = sum(vacant) >= DetectionSettings.votes and sum(one >= 2 for one in vacant) >= min(3, len(markers))
    return spec.squares_y - 1 - last if sure else 0


def _vacant_below(picture: Markers, columns: dict[int, int], spec: BoardSpec, image_size: tuple[int, int]) -> int:
    """Number of places for markers of the next row well inside the picture, from markers of a row in known columns."""
    row = picture.picked(np.isin(picture.ids, list(columns)))
    column = np.array([columns[int(number)] for number in row.ids])
    centres, per_square = row.outlines.mean(axis=1), row.px_per_marker * (spec.square_m / spec.marker_m)
    size_px, vacant = np.linalg.norm(per_square, axis=(1, 2)), 0
    for side in (-1, 1):
        where = centres + per_square @ np.array([side, 1.0])
        room = np.minimum(where, np.array(image_size) - 1 - where).min(axis=1)
        vacant += int(((room > size_px) & (column + side >= 0) & (column + side < spec.squares_x)).sum())
    return vacant


def _other_than_chessboard(read: Read, count: int, spec: Chessboard, detect: Detect) -> tuple[str, str] | None:
    """The kind of board in a few of the pictures, in words, and a remedy; a chessboard counts where two pictures
    have it."""
    own, seen, pictures = sorted((spec.squares_x, spec.squares_y)), list[tuple[int, ...]](), list[np.ndarray]()
    for index in spread_evenly(count, DetectionSettings.tried).tolist():
        inner = find_whole_chessboard(picture := read(index), thorough=False)
        counts = (0, 0) if inner is None else inner.shape[:2]
        columns, rows = sorted((1 + each for each in counts), reverse=spec.squares_x >= spec.squares_y)
        if sorted((columns, rows)) == own:
            return None
        other = dataclasses.replace(spec, squares_x=max(columns, 4), squares_y=max(rows, 4))
        if np.greater_equal(sorted((columns, rows)), own).all() and find_grid(picture, other) is not None:
            seen.append((columns, rows))
            if seen.count((columns, rows)) >= min(2, count):
                return _larger(other, spec)
        pictures.append(picture)
    if seen or any(find_grid(picture, spec, thorough=False) is not None for picture in pictures):
        return None
    return _with_ids(pictures, spec, detect)


def _larger(other: Chessboard, spec: Chessboard) -> tuple[str, str]:
    if _inner(other, spec):
        other = dataclasses.replace(other, squares_x=spec.squares_x + 1, squares_y=spec.squares_y + 1)
    counts = f"{other.squares_x}x{other.squares_y}"
    what, remedy = _mistaken(_in_words(other), other, spec)
    if _inner(other, spec):
        what = f"{spec.squares_x}x{spec.squares_y} are inner corners: {counts} squares"
    return what, f"{remedy}; all squares are counted, not the corners between them: --squares {counts}"


def _inner(other: Chessboard, spec: Chessboard) -> bool:
    """Whether the specification gives the number of inner corners in place of that of squares."""
    return sorted((other.squares_x, other.squares_y)) == sorted((spec.squares_x + 1, spec.squares_y + 1))


def _other_kind(read: Read, found: Sequence[np.ndarray], spec: Board, detect: Detect) -> tuple[str, str] | None:
    """The other board in the pictures, in words, and a remedy; None if that cannot be determined.

    Parameters
    ----------
    read : reads a picture (H, W) uint8 by its index.
    found : (N, 2) px marks of the spec's board in each picture.
    detect : with it a board is tried before it is proposed.
    """
    with_ids = isinstance(spec, BoardSpec | AprilGrid)
    visible = [index for index, corners in enumerate(found) if len(corners)]
    if visible and with_ids:
        return None
    if visible and _markers_within(read(visible[0]), found[visible[0]]) >= DetectionSettings.markers_amid:
        return _with_ids([read(index) for index in visible[: DetectionSettings.tried]], spec, detect)
    if visible:  # a part of a larger board may have been found
        rest = [index for index, corners in enumerate(found) if not len(corners)][: DetectionSettings.tried]
        return (
            _as_chessboard([read(index) for index in rest], spec, True)
            if isinstance(spec, Chessboard) and rest
            else None
        )
    chosen = spread_evenly(len(found), DetectionSettings.tried)
    pictures = [read(int(index)) for index in chosen]
    marked = None if with_ids else _with_ids(pictures, spec, detect)
    return marked or _as_circles(pictures, spec) or _as_chessboard(pictures, spec)


def _mistaken(what: str, fitting: Board, spec: Board) -> tuple[str, str]:
    remedy = f"this board fits, if its lengths are right: {spec_line(fitting)}"
    return f"{what} is in the pictures, the board spec says {_in_words(spec)}", remedy


def _in_words(spec: Board) -> str:
    """The kind of a board, with its counts if it has no ids."""
    if isinstance(spec, BoardSpec):
        return "a ChArUco board"
    if isinstance(spec, AprilGrid):
        return "an AprilGrid"
    if isinstance(spec, Chessboard):
        return f"a plain chessboard of {spec.squares_x} x {spec.squares_y} squares"
    return _circles_in_words(spec)


def _circles_in_words(spec: CircleGrid) -> str:
    kind = "an asymmetric grid" if spec.type == "asymmetric_circles" else "a grid"
    return f"{kind} of {spec.columns} columns and {spec.rows} rows of circles"


def _with_ids(pictures: Sequence[np.ndarray], spec: Board, detect: Detect) -> tuple[str, str] | None:
    fitting = _fitting_board(pictures, spec.pitch_m, detect)
    return None if fitting is None else _mistaken(_in_words(fitting), fitting, spec)


def _as_circles(pictures: Sequence[np.ndarray], spec: Board) -> tuple[str, str] | None:
    """A grid of circles of the other kind, or with columns and rows exchanged, that is in the pictures."""
    if not isinstance(spec, CircleGrid):
        return None
    for kind in ("circles", "asymmetric_circles"):
        for columns, rows in ((spec.columns, spec.rows), (spec.rows, spec.columns)):
            other = dataclasses.replace(spec, type=kind, columns=columns, rows=rows)
            if other != spec and any(find_grid(picture, other) is not None for picture in pictures):
                return _mistaken(_circles_in_words(other), other, spec)
    return None


def _as_chessboard(pictures: Sequence[np.ndarray], spec: Board, found: bool = False) -> tuple[str, str] | None:
    """A plain chessboard of another size in the pictures: the largest that two pictures agree on, or the one in a
    single picture; a larger one where the specified board was found in other pictures."""
    sizes = list[list[int]]()
    for thorough in (False, True):
        grids = [find_whole_chessboard(picture, thorough) for picture in pictures]
        sizes = [sorted(grid.shape[:2])[::-1] for grid in grids if grid is not None]
        if sizes and sizes.count(max(sizes, key=np.prod)) == len(pictures) > 1:
            break
    own = sorted((spec.squares_x - 1, spec.squares_y - 1))[::-1] if isinstance(spec, Chessboard) else [0, 0]
    least = 2 if len(pictures) > 1 or any(np.greater_equal(own, max(sizes, default=own))) else 1
    agreed = [size for size in sizes if np.prod(size) >= DetectionSettings.least_corners and sizes.count(size) >= least]
    columns, rows = (corners + 1 for corners in max(agreed, key=np.prod, default=own))
    if not agreed or [columns - 1, rows - 1] == own or (found and min(columns - 1 - own[0], rows - 1 - own[1]) < 0):
        return None
    fitting = Chessboard("chessboard", columns, rows, spec.pitch_m)
    if not any(find_grid(picture, fitting) is not None for picture in pictures):
        return None
    return _larger(fitting, spec) if isinstance(spec, Chessboard) else _mistaken(_in_words(fitting), fitting, spec)


def _fitting_board(pictures: Sequence[np.ndarray], pitch_m: float, detect: Detect) -> Board | None:
    """The board with ids in pictures (H, W) uint8, scaled to squares of side `pitch_m`."""
    named = BoardSpec(3, 3, pitch_m, float(f"{0.75 * pitch_m:.4g}"))
    for sighting in _sightings(pictures, ("",)):
        for fitting in _fitting(sighting, sighting.grids[0], named):
            found = _found(pictures, sighting, fitting, detect)
            if found is not None:
                return found
    return None


def _markers_within(picture: np.ndarray, corners_px: np.ndarray) -> int:
    """Largest number of markers of one dictionary within the hull of corners (N, 2) px, N ≥ 3."""
    hull = cv2.convexHull(corners_px.astype(np.float32))
    counts = []
    for dictionary in _families():
        centres = find_markers(picture, dictionary).outlines.mean(axis=1)
        counts.append(sum(cv2.pointPolygonTest(hull, centre, False) > 0 for centre in centres.tolist()))
    return max(counts)
