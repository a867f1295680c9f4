"""The board's corners in pictures."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from targets.board import Board, BoardSpec, Chessboard, CircleGrid, opencv_board
from vbaa_calib.core.console import progress, say
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import list_images, read_gray

from .circles import circle_centres
from .covariance import corner_covariances
from .diagnosis import Markers, explain_mismatch, px_per_square, rows_too_many
from .grids import find_grid
from .other_kinds import explain_other_kind
from .view_quality import ViewQuality, measure_quality

_WORKERS = 2
_FEW_CORNERS = 6
_FOUND_SHARE = 0.3
_WINDOW_PER_GAP = 0.9
_SMALLEST_WINDOW_PX = 4
_LARGEST_WINDOW_PX = 10
_FURTHEST_PX = 1.5
_OF_A_SQUARE = 0.6
_STOP = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)


@dataclass(frozen=True, eq=False)
class BoardView:
    """The board in one picture.

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
    """

    name: str
    ids: np.ndarray
    corners_px: np.ndarray
    image_size: tuple[int, int]
    marker_ids: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    marker_corners_px: np.ndarray = field(default_factory=lambda: np.zeros((0, 4, 2)))
    covariance_px2: np.ndarray | None = None
    quality: ViewQuality | None = None

    @property
    def marker_count(self) -> int:
        return len(self.marker_ids)

    def picked(self, which: np.ndarray) -> BoardView:
        """With only the corners of a mask or of indices."""
        covariance = None if self.covariance_px2 is None else self.covariance_px2[which]
        return replace(self, ids=self.ids[which], corners_px=self.corners_px[which], covariance_px2=covariance)


def require_corners(ids: np.ndarray, pixels: np.ndarray, count: int, where: str) -> None:
    """Raises InputError unless `ids` (N,) are different ids below `count` and `pixels` (N, 2) are finite."""
    shaped = ids.ndim == 1 and pixels.shape == (len(ids), 2) and np.isfinite(pixels).all()
    if not shaped or len(np.unique(ids)) < len(ids) or not np.isin(ids, np.arange(count)).all():
        what = f"the corners are not (N,) different ids from 0 to {count - 1} and (N, 2) finite pixels"
        raise InputError(what, where=where, remedy="is this the board?")


def detect_corners(image: np.ndarray, spec: Board, name: str = "") -> BoardView:
    """Find the board's corners in a picture (H, W) uint8; none gives an empty view. Boards without ids must be whole.

    OpenCV's settings for ChArUco boards are kept: on the real photo sets each marker refinement changes the
    reprojection error by a few per cent, up or down. Corners next to a single marker are left out, since they are
    grossly wrong on partly covered boards.
    """
    if not isinstance(spec, BoardSpec):
        return _detect_grid(image, spec, name)
    # OpenCV refuses a picture without pixels
    seen = image if image.size else np.zeros((1, 1), np.uint8)
    corners, ids, outlines, marker_ids = (
        np.asarray([] if found is None else found, float)
        for found in cv2.aruco.CharucoDetector(opencv_board(spec)).detectBoard(seen)
    )
    outlines, ids = outlines.reshape(-1, 4, 2), ids.ravel().astype(int)
    sharpened, windows = _between_markers(image, corners.reshape(-1, 2), outlines, spec)
    return BoardView(
        name,
        ids,
        sharpened,
        (image.shape[1], image.shape[0]),
        marker_ids.ravel().astype(int),
        outlines,
        corner_covariances(image, sharpened, windows),
        measure_quality(image, ids, sharpened, spec),
    )


def _detect_grid(image: np.ndarray, spec: Chessboard | CircleGrid, name: str) -> BoardView:
    size = (image.shape[1], image.shape[0])
    found = find_grid(image, spec)
    if found is None:
        return BoardView(name, np.zeros(0, int), np.zeros((0, 2)), size)
    if isinstance(spec, CircleGrid):
        ids, centres, covariances, _ = circle_centres(image, found, spec)
        return BoardView(name, ids, centres, size, covariance_px2=covariances)
    grid = found.reshape(spec.squares_y - 1, spec.squares_x - 1, 2)
    across, down = (np.linalg.norm(np.diff(grid, axis=axis), axis=-1) for axis in (1, 0))
    # a square's shorter side or the half of its shorter diagonal: to the next edge that is not the corner's own
    gap_px = np.full(grid.shape[:2], np.inf)
    for lengths, before, after in (
        (across, np.s_[:, 1:], np.s_[:, :-1]),
        (down, np.s_[1:], np.s_[:-1]),
    ):
        gap_px[before], gap_px[after] = np.minimum(gap_px[before], lengths), np.minimum(gap_px[after], lengths)
    ids = np.arange(spec.corner_count)
    corners, windows = _sharpened(image, found, _OF_A_SQUARE * gap_px.ravel(), np.full(len(ids), _SMALLEST_WINDOW_PX))
    covariances, quality = corner_covariances(image, corners, windows), measure_quality(image, ids, corners, spec)
    return BoardView(name, ids, corners, size, covariance_px2=covariances, quality=quality)


def _between_markers(
    image: np.ndarray, corners: np.ndarray, outlines: np.ndarray, spec: BoardSpec
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (N, 2) refined again in windows that end before the markers, and these half windows (N,).

    In drawn pictures OpenCV's window, which reaches the markers, gives errors of 0.14 px rms and up to 0.6 px, this one
    of 0.03 px; on the real photo sets the reprojection error changes by less than 1 %. OpenCV's corner is kept where
    the gap between corner and markers is too narrow.
    """
    if not len(corners) or not len(outlines):
        return corners, np.full(len(corners), _SMALLEST_WINDOW_PX)
    ratio = spec.marker_m / spec.square_m
    smallest = np.linalg.svd(px_per_square(outlines, ratio), compute_uv=False)[:, 1]
    nearest = np.argsort(np.linalg.norm(outlines.mean(axis=1)[None] - corners[:, None], axis=-1), axis=1)[:, :2]
    gap_px = smallest[nearest].min(axis=1) * (1.0 - ratio) / 2.0
    # OpenCV's windows end two pixels before the nearest marker corner
    to_marker = np.linalg.norm(outlines.reshape(1, -1, 2) - corners[:, None], axis=-1).min(axis=1)
    return _sharpened(image, corners, gap_px, np.clip((to_marker - 2.0).astype(int), 1, 10))


def _sharpened(
    image: np.ndarray, corners: np.ndarray, gap_px: np.ndarray, unrefined: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (N, 2) refined in windows smaller than `gap_px` (N,), and the half windows (N,).

    unrefined : (N,) half windows of corners that are kept, since the gap is too small or the step too large.
    """
    windows = np.minimum(_WINDOW_PER_GAP * gap_px, _LARGEST_WINDOW_PX).astype(int)
    refined, used = corners.copy(), unrefined.copy()
    for window in np.unique(windows[windows >= _SMALLEST_WINDOW_PX]).tolist():
        chosen = np.flatnonzero(windows == window)
        start = corners[chosen].astype(np.float32).reshape(-1, 1, 2)
        better = cv2.cornerSubPix(image, start, (window, window), (-1, -1), _STOP).reshape(-1, 2)
        near = np.linalg.norm(better - corners[chosen], axis=1) < _FURTHEST_PX
        refined[chosen[near]] = better[near]
        used[chosen[near]] = window
    return refined, used


def detect_folder(folder: Path, spec: Board) -> list[BoardView]:
    """As `detect_files`, for all pictures of a folder."""
    return detect_files(list_images(folder), spec)


def detect_files(paths: Sequence[Path], spec: Board) -> list[BoardView]:
    """The board in each picture.

    Raises InputError for damaged pictures, for pictures of different sizes, and for a board spec that does not fit the
    pictures (kind of board, dictionary, legacy pattern, number of squares, size of markers), with the causes and the
    fitting spec where they can be found.
    """
    with ThreadPoolExecutor(_WORKERS) as pool:
        found = pool.map(lambda path: detect_corners(read_gray(path), spec, Path(path).name), paths)
        views = list(progress(found, "detecting the board", len(paths)))
    for path, view in zip(paths, views, strict=True):
        if view.image_size != views[0].image_size:
            own, first = (f"{one.image_size[0]}x{one.image_size[1]} px" for one in (view, views[0]))
            remedy = "calibrate from pictures of one camera at one resolution"
            raise InputError(f"is {own}, {views[0].name} is {first}", where=path, remedy=remedy)
    _refuse_wrong_spec(paths, views, spec)
    return views


def _refuse_wrong_spec(paths: Sequence[Path], views: Sequence[BoardView], spec: Board) -> None:
    place = Path(paths[0]).parent if len(paths) > 1 else paths[0]
    shown = sum(len(view.ids) > 0 for view in views)

    def read(index: int) -> np.ndarray:
        return read_gray(paths[index])

    markers = [Markers(view.marker_ids, view.marker_corners_px) for view in views]
    if isinstance(spec, BoardSpec):
        found = sum(len(view.ids) >= _FEW_CORNERS for view in views) >= _FOUND_SHARE * len(views)
        mismatch = explain_mismatch(read, markers, spec, found)
        if mismatch is not None:
            what = f"the board spec does not fit the pictures: {mismatch.words}"
            raise InputError(what, where=place, remedy=mismatch.remedy)
    if not isinstance(spec, BoardSpec) or not shown:
        other = explain_other_kind(read, [view.corners_px for view in views], spec)
        if other is not None:
            raise InputError(f"the board spec does not fit the pictures: {other[0]}", where=place, remedy=other[1])
    if not shown:
        what, needed = "no board is found in any picture", "whole markers are in view"
        if not isinstance(spec, BoardSpec):
            what, needed = f"{what}: without ids it counts only where it is seen whole", "the whole board is in view"
        raise InputError(what, where=place, remedy=f"check that the board is sharp, lit, large enough and {needed}")
    if not isinstance(spec, BoardSpec):
        if shown < len(views):
            of = f"{len(views) - shown} of {len(views)} pictures"
            say(f"{place}: {of} do not show the whole board, and are of no use: without ids a part could be any part")
    elif missing := rows_too_many(markers, spec, views[0].image_size):
        say(
            f"{place}: the pictures show room for the board's last {missing} rows and no marker there: is squares_y "
            f"{spec.squares_y - missing}, not {spec.squares_y}? The corners are the same."
        )
