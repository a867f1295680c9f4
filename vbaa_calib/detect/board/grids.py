"""Detection of complete boards without ids: chessboards and grids of circles. For parts of a chessboard see `parts`."""

from __future__ import annotations

from itertools import product
from typing import Any

import cv2
import numpy as np

from targets.board import Chessboard, CircleGrid

from .settings import DetectionSettings

# flags of a thorough search, tried in turn
_SEARCHES = (cv2.CALIB_CB_EXHAUSTIVE, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE)


def _grid_readings(spec: Chessboard | CircleGrid) -> np.ndarray:
    """(K, corner_count) possible orders of the points, by quarter turns and mirroring."""
    centred = 2 * spec.lattice - spec.lattice.min(axis=0) - spec.lattice.max(axis=0)
    index = {tuple(place): number for number, place in enumerate(centred.tolist())}
    found = []
    turns = [np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), quarters) for quarters in range(4)]
    for turn, mirror in product(turns, (np.diag([1, 1]), np.diag([1, -1]))):
        order = [index.get(tuple(place)) for place in (centred @ (mirror @ turn).T).tolist()]
        if None not in order:
            found.append(order)
    return np.array(found)


def find_grid(image: np.ndarray, spec: Chessboard | CircleGrid, thorough: bool = True) -> np.ndarray | None:
    """(corner_count, 2) px of all points in a picture (H, W) uint8, unrefined; None if not all are found.

    Of several possible numberings, the one with its x axis nearest to the picture's. thorough : looks for a chessboard
    longer, which takes seconds where there is none.
    """
    small, scale = _searchable(image)
    if min(small.shape) < DetectionSettings.least_side_px:
        return None
    marks = _chessboard(small, spec, thorough) if isinstance(spec, Chessboard) else _circles(small, spec)
    if marks is None or not _regular(marks, spec):
        return None
    return _upright((marks + 0.5) / scale - 0.5, image, spec)


def _chessboard(image: np.ndarray, spec: Chessboard, thorough: bool) -> np.ndarray | None:
    size = (spec.squares_x - 1, spec.squares_y - 1)
    for flags in _SEARCHES if thorough else (0,):
        found, corners = cv2.findChessboardCornersSB(image, size, flags=flags)
        if found:
            return np.asarray(corners, float).reshape(-1, 2)
    if not thorough:
        return None
    classic = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(image, size, flags=classic)
    return np.asarray(corners, float).reshape(-1, 2) if found else None


def find_whole_chessboard(image: np.ndarray, thorough: bool = True) -> np.ndarray | None:
    """(rows, columns, 2) px, unrefined, of the inner corners of the largest chessboard in a picture (H, W) uint8; None
    without one.

    thorough : searches twice, and longer.
    """
    small, scale = _searchable(image)
    if min(small.shape) < DetectionSettings.least_side_px:
        return None
    grids = list[np.ndarray]()
    for flags in _SEARCHES if thorough else (0,):
        # it sometimes finds only a part of the board
        found, corners, meta = cv2.findChessboardCornersSBWithMeta(small, (3, 3), flags | cv2.CALIB_CB_LARGER)
        grids += [np.asarray(corners, float).reshape(*meta.shape[:2], 2)] if found else []
    largest = max(grids, key=np.size, default=None)
    return None if largest is None else (largest + 0.5) / scale - 0.5


def _searchable(image: np.ndarray) -> tuple[np.ndarray, float]:
    """The picture, reduced if it is large, and the scale factor."""
    scale = min(1.0, float(np.sqrt(DetectionSettings.search_px / max(image.size, 1))))
    shrunk = image if scale == 1.0 else cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return shrunk, scale


def _circles(image: np.ndarray, spec: CircleGrid) -> np.ndarray | None:
    options = cv2.SimpleBlobDetector.Params()
    options.minArea = DetectionSettings.least_blob_px2
    options.maxArea = max(
        DetectionSettings.widest_blob * image.size / spec.corner_count, 2.0 * DetectionSettings.least_blob_px2
    )
    options.minDistBetweenBlobs = 4.0
    options.minThreshold, options.maxThreshold = DetectionSettings.blob_levels
    image = cv2.normalize(image, np.empty(0), 0, 255, cv2.NORM_MINMAX)
    search: Any = cv2.findCirclesGrid  # its stubs know nothing of a grid in given spots
    detector = cv2.SimpleBlobDetector.create(options)
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if spec.type == "asymmetric_circles" else cv2.CALIB_CB_SYMMETRIC_GRID
    for picture in (image, 255 - image):
        # its search takes minutes among hundreds of spots
        spots = sorted(detector.detect(picture), key=lambda spot: -spot.size)[
            : DetectionSettings.most_spots * spec.corner_count
        ]
        points = np.array([spot.pt for spot in spots], np.float32).reshape(-1, 1, 2)
        for clustered in (0, cv2.CALIB_CB_CLUSTERING) if len(points) >= spec.corner_count else ():
            size, usual = (spec.columns, spec.rows), cv2.CirclesGridFinderParameters()
            found, centres = search(points, size, kind | clustered, None, usual)
            if found and not _goes_on(marks := np.asarray(centres, float).reshape(-1, 2), points[:, 0], spec):
                return marks
    return None


def _rows_of_three(spec: Chessboard | CircleGrid) -> np.ndarray:
    """(T, 3) indices of three points in a row, along the board's ±x and ±y; the last is −1 at the border."""
    index = {tuple(place): number for number, place in enumerate(spec.lattice.tolist())}
    wide = 2 if isinstance(spec, CircleGrid) and spec.type == "asymmetric_circles" else 1
    return np.array(
        [
            (index[x - dx, y - dy], number, index.get((x + dx, y + dy), -1))
            for dx, dy in ((wide, 0), (-wide, 0), (0, wide), (0, -wide))
            for (x, y), number in index.items()
            if (x - dx, y - dy) in index
        ]
    )


def _goes_on(marks: np.ndarray, spots: np.ndarray, spec: CircleGrid) -> bool:
    """Whether the grid continues beyond its points: detected spots (S, 2) px lie where the next ones would."""
    rows = _rows_of_three(spec)
    before, last = marks[rows[rows[:, 2] < 0, :2].T]
    miss = np.linalg.norm((2.0 * last - before)[:, None] - spots, axis=-1).min(axis=1)
    return bool(
        np.mean(miss < DetectionSettings.irregular * np.linalg.norm(last - before, axis=1)) > DetectionSettings.goes_on
    )


def _regular(marks: np.ndarray, spec: Chessboard | CircleGrid) -> bool:
    """Whether points lie midway between their neighbours, within the limits of perspective and distortion."""
    rows = _rows_of_three(spec)
    before, middle, after = marks[rows[rows[:, 2] >= 0].T]
    miss = np.linalg.norm(middle - (before + after) / 2.0, axis=1)
    return bool((miss < DetectionSettings.irregular * np.linalg.norm(after - before, axis=1) / 2.0).all())


def _upright(marks: np.ndarray, image: np.ndarray, spec: Chessboard | CircleGrid) -> np.ndarray:
    """The points in order: not mirrored, black square first, and as upright as possible."""
    places = spec.lattice - spec.lattice.mean(axis=0)
    readings = [marks[order] for order in _grid_readings(spec)]
    slopes = [np.linalg.lstsq(places, reading - reading.mean(axis=0), rcond=None)[0].T for reading in readings]
    seen = [
        (abs(_angle(slope)), reading)
        for slope, reading in zip(slopes, readings, strict=True)
        if np.linalg.det(slope) > 0
    ]
    if isinstance(spec, Chessboard):
        black = [one for one in seen if _begins_black(image, one[1], spec)]
        seen = black or seen
    return min(seen, key=lambda one: one[0])[1] if seen else marks


def _angle(slope: np.ndarray) -> float:
    return float(np.arctan2(slope[1, 0] - slope[0, 1], slope[0, 0] + slope[1, 1]))


def _begins_black(image: np.ndarray, corners: np.ndarray, spec: Chessboard) -> bool:
    """Whether the square between the first four corners is black."""
    grid = corners.reshape(spec.squares_y - 1, spec.squares_x - 1, 2)
    middles = (grid[:-1, :-1] + grid[1:, 1:] + grid[:-1, 1:] + grid[1:, :-1]) / 4.0
    column, row = np.clip(np.rint(middles).astype(int), 0, np.array(image.shape[::-1]) - 1).reshape(-1, 2).T
    grey = image[row, column].astype(float).reshape(middles.shape[:2])
    black = np.indices(grey.shape).sum(axis=0) % 2 == 0
    return bool(grey[black].mean() < grey[~black].mean())
