"""Detection of a board's corners in pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from targets.board import AprilGrid, Board, BoardSpec, Chessboard, CircleGrid, opencv_board
from vbaa_calib.core.console import progress, say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import sha256
from vbaa_calib.core.images import list_images, picture_size, read_gray

from .circles import circle_centres
from .covariance import corner_covariances
from .diagnosis import refuse_wrong_spec
from .grids import find_grid
from .markers import OUTLINE, TURNS, Markers, find_markers
from .parts import place_part
from .settings import DetectionSettings
from .view_quality import ViewQuality, measure_quality


@dataclass(frozen=True, eq=False)
class BoardView:
    """The board's detected corners in one picture.

    Attributes
    ----------
    name : the picture's name.
    ids : (N,) corner ids in OpenCV's order.
    corners_px : (N, 2) their pixels; (0, 0) is the centre of the first pixel.
    image_size : (width, height) px.
    marker_ids : (M,) ids of all markers of the dictionary, also of those that are not on the board.
    marker_corners_px : (M, 4, 2) their outlines.
    covariance_px2 : (N, 2, 2) of each corner, from the picture's noise alone (`corner_covariance`).
    quality : blur, saturation and contrast (`view_quality`).
    left_out : why the picture was not searched, in words; empty where it was.
    """

    name: str
    ids: np.ndarray
    corners_px: np.ndarray
    image_size: tuple[int, int]
    marker_ids: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    marker_corners_px: np.ndarray = field(default_factory=lambda: np.zeros((0, 4, 2)))
    covariance_px2: np.ndarray | None = None
    quality: ViewQuality | None = None
    left_out: str = ""

    @property
    def marker_count(self) -> int:
        return len(self.marker_ids)

    def picked(self, which: np.ndarray) -> BoardView:
        """The view with only the corners of a mask or of indices."""
        covariance = None if self.covariance_px2 is None else self.covariance_px2[which]
        return replace(self, ids=self.ids[which], corners_px=self.corners_px[which], covariance_px2=covariance)


def require_corners(ids: np.ndarray, pixels: np.ndarray, count: int, where: str) -> None:
    """Raises InputError unless `ids` (N,) are different ids below `count` and `pixels` (N, 2) are finite."""
    shaped = ids.ndim == 1 and pixels.shape == (len(ids), 2) and np.isfinite(pixels).all()
    if not shaped or len(np.unique(ids)) < len(ids) or not np.isin(ids, np.arange(count)).all():
        what = f"the corners are not (N,) different ids from 0 to {count - 1} and (N, 2) finite pixels"
        raise InputError(what, where=where, remedy="is this the board?")


def detect_corners(image: np.ndarray, spec: Board, name: str = "") -> BoardView:
    """Detect the board's corners in a picture (H, W) uint8; an empty view without a board. Boards without ids must
    be complete."""
    return _KINDS[type(spec)](image, spec, name)


def _detect_charuco(image: np.ndarray, spec: BoardSpec, name: str) -> BoardView:
    """Detects a ChArUco board without OpenCV's marker refinement: on the real photo sets each kind of it changes the
    reprojection error by a few per cent, up or down. Corners next to a single marker are left out, since they
    are grossly wrong on partly covered boards. Of several copies of the board the most visible one is taken."""
    # OpenCV refuses a picture without pixels
    seen = image if image.size else np.zeros((1, 1), np.uint8)
    detector, size = cv2.aruco.CharucoDetector(opencv_board(spec)), DetectionSettings.threshold_px
    every = detector.getDetectorParameters()
    one = cv2.aruco.DetectorParameters()
    one.adaptiveThreshWinSizeMin = one.adaptiveThreshWinSizeMax = size
    # one threshold finds most boards whole, in two fifths of the time of OpenCV's three
    for options in (one, every):
        detector.setDetectorParameters(options)
        corners, ids, outlines, marker_ids = _arrays(*detector.detectBoard(seen))
        markers = Markers(marker_ids.ravel().astype(int), outlines.reshape(-1, 4, 2))
        if not _lacks_markers(markers, detector.getBoard(), image):
            break
    copy = markers.one_copy(spec)
    if len(copy.ids) < len(markers.ids):
        own = copy.outlines.astype(np.float32)[:, None], copy.ids.astype(np.int32)
        corners, ids, *_ = _arrays(*detector.detectBoard(seen, markerCorners=list(own[0]), markerIds=own[1]))
    ids = ids.ravel().astype(int)
    corners = corners.reshape(-1, 2)
    smooth = _smoothed(image, corners) if len(ids) else image
    sharpened, windows = _between_markers(smooth, corners, markers, spec)
    return BoardView(
        name,
        ids,
        sharpened,
        (image.shape[1], image.shape[0]),
        markers.ids,
        markers.outlines,
        corner_covariances(image, smooth, sharpened, windows),
        measure_quality(image, ids, sharpened, spec),
    )


def _lacks_markers(found: Markers, board: cv2.aruco.CharucoBoard, image: np.ndarray) -> bool:
    """Whether a marker is missing among those found that must be whole in the picture (H, W), by the others' homography
    to the board's plane."""
    outlines = dict(zip(np.ravel(board.getIds()).tolist(), np.asarray(board.getObjPoints())[..., :2], strict=True))
    own = [index for index, one in enumerate(found.ids.tolist()) if one in outlines]
    if len(own) < 2:
        return True
    plane = np.concatenate([outlines.pop(one, np.zeros((0, 2))) for one in found.ids[own].tolist()])
    if not outlines:
        return False
    if len(plane) < 4 * len(own):  # there are copies of the board
        return True
    turn, _ = cv2.findHomography(plane, found.outlines[own].reshape(-1, 2))
    if turn is None:
        return True
    missing = cv2.perspectiveTransform(np.stack(list(outlines.values())), turn)
    room = DetectionSettings.least_room_px
    inside = (missing > room) & (missing < np.array(image.shape[::-1]) - 1 - room)
    return bool(inside.all(axis=(1, 2)).any())


def _arrays(*found: Sequence[np.ndarray] | np.ndarray | None) -> list[np.ndarray]:
    return [np.asarray([] if one is None else one, float) for one in found]


def _detect_april_grid(image: np.ndarray, spec: AprilGrid, name: str) -> BoardView:
    """Detects corners of the tags that have neighbours on the grid, which show how the tags are rotated."""
    markers = find_markers(image, spec.dictionary, spec.border)
    order = np.argsort(spec.marker_ids)
    tags = markers.picked(np.isin(markers.ids, spec.marker_ids))
    row, column = np.divmod(order[np.searchsorted(spec.marker_ids[order], tags.ids)], spec.columns)
    cells = np.stack([column, row], axis=1)
    pairs, steps = tags.neighbours(False, 1.0 + spec.spacing)
    between = cells[pairs[:, 1]] - cells[pairs[:, 0]]
    readings = [(((steps @ turn) == between).all(axis=1), turn) for turn in TURNS]
    agree, about = max(readings, key=lambda one: int(one[0].sum()))
    kept = np.zeros(0, int)
    for group in tags.groups(pairs[agree]):
        if len(group) > 1 and not np.isin(tags.ids[group], tags.ids[kept]).any():
            kept = np.append(kept, group)
    place = 2 * cells[kept, None] + (OUTLINE @ about + 0.5).astype(int)
    ids = (place[..., 1] * spec.corner_columns + place[..., 0]).ravel()
    places, corners = spec.lattice[ids].reshape(-1, 4, 2), tags.at_pitch(1.0 + spec.spacing)[kept].reshape(-1, 2)
    side_px = np.linalg.svd(tags.px_per_marker[kept], compute_uv=False)[:, 1].repeat(4)
    gap_px, windows = min(spec.border / spec.modules, spec.spacing) * side_px, 0 * ids
    # large tags stray farther from the homography of their neighbours: by the lens's distortion
    furthest_px = (
        max(DetectionSettings.furthest_px, DetectionSettings.of_a_gap * float(np.median(gap_px))) if len(ids) else 0.0
    )
    smooth = _smoothed(image) if len(ids) else image
    for _ in range(DetectionSettings.rounds):
        start = _by_neighbours(places, corners.reshape(-1, 4, 2), cells[kept])
        within = ((start > 0) & (start < np.array(image.shape[::-1]) - 1)).all(axis=1)
        corners, windows = start.copy(), np.zeros(len(ids), int)
        corners[within], windows[within] = _sharpened(
            smooth, start[within], gap_px[within], 0 * ids[within], furthest_px
        )
    found = np.flatnonzero(windows)
    found = found[np.argsort(ids[found])]
    ids, corners, windows = ids[found], corners[found], windows[found]
    covariances = corner_covariances(image, smooth, corners, windows)
    quality = measure_quality(image, ids, corners, spec)
    size = (image.shape[1], image.shape[0])
    return BoardView(name, ids, corners, size, markers.ids, markers.outlines, covariances, quality)


def _by_neighbours(places: np.ndarray, outlines: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(4M, 2) px corners of tags, each by the homography of the tag and its neighbours.

    places : (M, 4, 2) on the board. outlines : (M, 4, 2) px, cut off where the tags meet black squares, by up to some
    pixels. cells : (M, 2) column and row.
    """
    predicted = outlines.copy()
    for tag, cell in enumerate(cells):
        near = np.abs(cells - cell).max(axis=1) <= 1
        found, _ = cv2.findHomography(places[near].reshape(-1, 2), outlines[near].reshape(-1, 2), cv2.LMEDS)
        if found is not None:
            predicted[tag] = cv2.perspectiveTransform(places[tag][None], found)[0]
    return predicted.reshape(-1, 2)


def _detect_circles(image: np.ndarray, spec: CircleGrid, name: str) -> BoardView:
    size = (image.shape[1], image.shape[0])
    found = find_grid(image, spec)
    if found is None:
        return BoardView(name, np.zeros(0, int), np.zeros((0, 2)), size)
    ids, centres, covariances, _ = circle_centres(image, found, spec)
    return BoardView(name, ids, centres, size, covariance_px2=covariances)


def _detect_chessboard(image: np.ndarray, spec: Chessboard, name: str) -> BoardView:
    size = (image.shape[1], image.shape[0])
    found = find_grid(image, spec)
    if found is None:
        return BoardView(name, np.zeros(0, int), np.zeros((0, 2)), size)
    return _chessboard_view(image, spec, name, np.arange(spec.corner_count), found)


def _chessboard_view(image: np.ndarray, spec: Chessboard, name: str, ids: np.ndarray, found: np.ndarray) -> BoardView:
    """View from corner ids (N,) in rows and columns and their pixels (N, 2), which are refined."""
    grid = found.reshape(len(np.unique(ids // spec.corner_columns)), -1, 2)
    across, down = (np.linalg.norm(np.diff(grid, axis=axis), axis=-1) for axis in (1, 0))
    # a square's shorter side or the half of its shorter diagonal: to the next edge that is not the corner's own
    gap_px = np.full(grid.shape[:2], np.inf)
    for lengths, before, after in (
        (across, np.s_[:, 1:], np.s_[:, :-1]),
        (down, np.s_[1:], np.s_[:-1]),
    ):
        gap_px[before], gap_px[after] = np.minimum(gap_px[before], lengths), np.minimum(gap_px[after], lengths)
    smooth = _smoothed(image)
    corners, windows = _sharpened(
        smooth,
        found,
        DetectionSettings.of_a_square * gap_px.ravel(),
        np.full(len(ids), DetectionSettings.smallest_window_px),
    )
    covariances = corner_covariances(image, smooth, corners, windows)
    quality = measure_quality(image, ids, corners, spec)
    size = (image.shape[1], image.shape[0])
    return BoardView(name, ids, corners, size, covariance_px2=covariances, quality=quality)


_KINDS: dict[type[Board], Callable[[np.ndarray, Any, str], BoardView]] = {
    BoardSpec: _detect_charuco,
    AprilGrid: _detect_april_grid,
    Chessboard: _detect_chessboard,
    CircleGrid: _detect_circles,
}
"""How each kind of board is detected."""


def _smoothed(image: np.ndarray, corners: np.ndarray | None = None) -> np.ndarray:
    """The picture (H, W) in which corners are refined; only around these corners (N, 2) if they are known, zero
    elsewhere."""
    sigma = DetectionSettings.smoothing_px
    if corners is None or not np.isfinite(corners).all():
        return cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma) if image.size else image
    kernel = int(np.ceil(4.0 * sigma)) + 1
    room = 2 * DetectionSettings.largest_window_px + int(np.ceil(DetectionSettings.furthest_px)) + 4
    size = np.array(image.shape[::-1])
    first = np.clip(np.floor(corners.min(axis=0)).astype(int) - room, 0, size - 1)
    last = np.clip(np.ceil(corners.max(axis=0)).astype(int) + room, first + 1, size)
    before = np.minimum(first, kernel)
    outer = slice(first[1] - before[1], last[1] + kernel), slice(first[0] - before[0], last[0] + kernel)
    part = cv2.GaussianBlur(image[outer].astype(np.float32), (0, 0), sigma)
    smooth = np.zeros(image.shape, np.float32)
    smooth[first[1] : last[1], first[0] : last[0]] = part[
        before[1] : before[1] + last[1] - first[1], before[0] : before[0] + last[0] - first[0]
    ]
    return smooth


def _between_markers(
    smooth: np.ndarray, corners: np.ndarray, markers: Markers, spec: BoardSpec
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (N, 2) refined again in windows that end before the markers, and the half windows (N,).

    In drawn pictures OpenCV's window, which reaches the markers, gives errors of 0.14 px rms and up to 0.6 px, this one
    of 0.03 px, and in a smoothed picture half of it; on the real photo sets the reprojection error changes by less than
    1 %. OpenCV's corner is kept where
    the gap between corner and markers is too narrow.
    """
    outlines = markers.outlines
    if not len(corners) or not len(outlines):
        return corners, np.full(len(corners), DetectionSettings.smallest_window_px)
    ratio = spec.marker_m / spec.square_m
    smallest = np.linalg.svd(markers.px_per_square(ratio), compute_uv=False)[:, 1]
    nearest = np.argsort(np.linalg.norm(outlines.mean(axis=1)[None] - corners[:, None], axis=-1), axis=1)[:, :2]
    gap_px = smallest[nearest].min(axis=1) * (1.0 - ratio) / 2.0
    # OpenCV's windows end two pixels before the nearest marker corner
    to_marker = np.linalg.norm(outlines.reshape(1, -1, 2) - corners[:, None], axis=-1).min(axis=1)
    return _sharpened(smooth, corners, gap_px, np.clip((to_marker - 2.0).astype(int), 1, 10))


def _sharpened(
    smooth: np.ndarray,
    corners: np.ndarray,
    gap_px: np.ndarray,
    unrefined: np.ndarray,
    furthest_px: float = DetectionSettings.furthest_px,
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (N, 2) refined in windows smaller than `gap_px` (N,), and the half windows (N,).

    unrefined : (N,) half windows of corners that are kept, since the gap is too small or the step longer than
    `furthest_px`.
    """
    windows = np.minimum(DetectionSettings.window_per_gap * gap_px, DetectionSettings.largest_window_px).astype(int)
    refined, used = corners.copy(), unrefined.copy()
    for window in np.unique(windows[windows >= DetectionSettings.smallest_window_px]).tolist():
        chosen = np.flatnonzero(windows == window)
        start = corners[chosen].astype(np.float32).reshape(-1, 1, 2)
        better = cv2.cornerSubPix(
            smooth, start, (window, window), (-1, -1), (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
        ).reshape(-1, 2)
        near = np.linalg.norm(better - corners[chosen], axis=1) < furthest_px
        refined[chosen[near]] = better[near]
        used[chosen[near]] = window
    return refined, used


def detect_folder(folder: Path, spec: Board) -> list[BoardView]:
    """As `detect_files`, for all pictures of a folder."""
    return detect_files(list_images(folder), spec)


def detect_files(paths: Sequence[Path], spec: Board) -> list[BoardView]:
    """The board in each picture; a few pictures of another size than the others, and copies of one, are left out.

    Raises InputError for damaged pictures, for pictures of different sizes, and for a board spec that does not fit the
    pictures (kind of board, dictionary, ids, legacy pattern, number of squares, size of markers), with the causes and
    the fitting spec where they can be found.
    """
    sizes = [picture_size(path) for path in paths]
    usual = _one_size(paths, sizes)
    searched = [path for path, size in zip(paths, sizes, strict=True) if size == usual]
    firsts = dict[str, str]()
    same = [firsts.setdefault(sha256(path), Path(path).name) for path in paths]
    refuse_wrong_spec(searched, None, spec, _found_corners)

    def view(path: Path, size: tuple[int, int], first: str) -> BoardView:
        name = Path(path).name
        left_out = f"it is the same picture as {first}" if first != name else ""
        if size != usual:
            left_out = f"it is {_in_px(size)}, the others are {_in_px(usual)}"
        if left_out:
            return BoardView(name, np.zeros(0, int), np.zeros((0, 2)), usual, left_out=left_out)
        return detect_corners(read_gray(path), spec, name)

    with ThreadPoolExecutor(DetectionSettings.workers) as pool:
        views = list(progress(pool.map(view, paths, sizes, same), "detecting the board", len(paths)))
    if isinstance(spec, Chessboard):
        views = _with_parts(views, paths, spec)
    refuse_wrong_spec(searched, [one for one in views if not one.left_out], spec, _found_corners)
    return views


def _with_parts(views: list[BoardView], paths: Sequence[Path], spec: Chessboard) -> list[BoardView]:
    """The views, including parts of a chessboard where the nearest pictures of the whole one identify the part."""
    whole, found = [index for index, one in enumerate(views) if len(one.ids)], list(views)
    for index, one in enumerate(views):
        if len(one.ids) or one.left_out or not whole:
            continue
        image = read_gray(paths[index])
        for other in sorted(whole, key=lambda each: abs(each - index))[: DetectionSettings.references]:
            part = place_part(image, spec, read_gray(paths[other]), views[other].corners_px)
            if part is not None:
                found[index] = _chessboard_view(image, spec, one.name, *part)
                break
    return found


def _one_size(paths: Sequence[Path], sizes: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """The pictures' common size, with a few exceptions. Raises InputError where too many differ."""
    usual, count = Counter(sizes).most_common(1)[0]
    other = [(path, size) for path, size in zip(paths, sizes, strict=True) if size != usual]
    if not other:
        return usual
    few = len(sizes) >= DetectionSettings.fewest and len(other) <= max(DetectionSettings.other_sizes * len(sizes), 1)
    if not few:
        remedy = "calibrate from pictures of one camera at one resolution"
        first = Path(paths[sizes.index(usual)]).name
        what = f"is {_in_px(other[0][1])}, {first} is {_in_px(usual)}, as {count} of {len(sizes)} are"
        raise InputError(what, where=other[0][0], remedy=remedy)
    names = ", ".join(Path(path).name for path, _ in other)
    say(f"left out: {names}, {'is' if len(other) == 1 else 'are'} {_in_px(other[0][1])}, the others {_in_px(usual)}")
    return usual


def _in_px(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]} px"


def _found_corners(image: np.ndarray, spec: Board) -> tuple[np.ndarray, np.ndarray]:
    view = detect_corners(image, spec)
    return view.ids, view.corners_px
