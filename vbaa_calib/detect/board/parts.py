"""Identification of the visible part of a chessboard, by another picture of the whole board.

The part's surroundings (the rest of the squares, the board's rim, markers and print next to it) are compared with the
same places on the whole board, for each part that it could be. A sheet of the rim's colour over a part of the board
passes for the rim.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from targets.board import Chessboard

from .grids import find_whole_chessboard
from .settings import DetectionSettings


def place_part(
    image: np.ndarray, spec: Chessboard, whole: np.ndarray, corners_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Ids (N,) and pixels (N, 2), unrefined, of a part of the board in a picture (H, W) uint8; None without a part,
    or where it cannot be identified.

    whole : a picture (H, W) of the whole board by the same camera. corners_px : (corner_count, 2) in it.
    """
    found = find_whole_chessboard(image, thorough=False)
    part = None if found is None else _trimmed(image, found)
    if part is None or not DetectionSettings.part_corners <= part[..., 0].size < spec.corner_count:
        return None
    grid = corners_px.reshape(spec.squares_y - 1, -1, 2)
    aim = _laid_flat(whole, grid, *_board(spec))
    readings = sorted(_readings(image, part, spec, aim), key=lambda one: -one[0])
    # a corner of the board on plain ground may be any of them, but pictures are turned less than that
    near = [one for one in readings if _turn_rad(one[2], grid) < np.pi / 4.0]
    if not near or near[0][0] < DetectionSettings.part_alike or (len(near) > 1 and not _lacks(near[1][0], near[0][0])):
        return None
    if _lacks(near[0][0], readings[0][0]):
        return None
    return near[0][1], near[0][2].reshape(-1, 2)


def _lacks(alike: float, other: float) -> bool:
    """Whether one correlation is clearly less than another."""
    return 1.0 - alike > DetectionSettings.part_lead * (1.0 - other) + DetectionSettings.part_lead_least


def _trimmed(image: np.ndarray, grid: np.ndarray) -> np.ndarray | None:
    """Corners (rows, columns, 2) px without outer rows and columns that contain a false one: around a corner two
    squares are black and two white."""
    across, down = (np.gradient(grid, axis=axis) for axis in (1, 0))
    places = [
        grid + DetectionSettings.part_into * (x * across + y * down) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    inside = np.all([((one > 0) & (one < np.array(image.shape[::-1]) - 1)).all(axis=-1) for one in places], axis=0)
    maps = (one.astype(np.float32) for one in places)
    grey = [cv2.remap(image, one, np.empty(0), cv2.INTER_LINEAR).astype(float) for one in maps]
    rise = 0.25 * (grey[0] - grey[1] + grey[2] - grey[3])
    differ = np.maximum(np.abs(grey[0] - grey[2]), np.abs(grey[1] - grey[3]))
    sign = np.where(np.indices(rise.shape).sum(axis=0) % 2 == 0, 1.0, -1.0)
    usual = float(np.median(sign * rise))
    real = inside & (sign * rise * np.sign(usual) > 0.5 * abs(usual)) & (differ < abs(usual))
    while not real.all():
        rims = {(axis, at): real.take(at, axis=axis).mean() for axis in (0, 1) for at in (0, -1)}
        axis, at = min(rims, key=lambda one: rims[one])
        kept = np.s_[1:] if at == 0 else np.s_[:-1]
        grid, real = (each[kept] if axis == 0 else each[:, kept] for each in (grid, real))
        if min(real.shape) < 3:
            return None
    return grid


def _board(spec: Chessboard) -> tuple[float, float, int, int]:
    """First column and row, in corners, of the compared area, and its numbers of texels across and down."""
    beyond, texels = DetectionSettings.part_beyond, DetectionSettings.part_texels
    across, down = (round((count - 2 + 2 * beyond) * texels) for count in (spec.squares_x, spec.squares_y))
    return -beyond, -beyond, across, down


def _laid_flat(
    image: np.ndarray, grid: np.ndarray, column: float, row: float, across: int, down: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rectified grey levels (down, across) around a grid of corners (rows, columns, 2) px, in texels from a column
    and row on, and the mask of those in the picture."""
    rows, columns = grid.shape[:2]
    lattice = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(float)
    onto, _ = cv2.findHomography(lattice, grid.reshape(-1, 2), 0)
    step = 1.0 / DetectionSettings.part_texels
    onto = onto @ np.array([[step, 0.0, column + step / 2], [0.0, step, row + step / 2], [0.0, 0.0, 1.0]])
    slope = np.linalg.lstsq(lattice - lattice.mean(axis=0), (grid - grid.mean(axis=(0, 1))).reshape(-1, 2), rcond=None)[
        0
    ]
    square_px = float(np.sqrt(abs(np.linalg.det(slope))))
    smooth = cv2.GaussianBlur(image, (0, 0), max(0.7 * square_px * step, 0.3))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    flat = cv2.warpPerspective(smooth, onto, (across, down), flags=flags).astype(np.float32)
    seen = cv2.warpPerspective(np.full_like(image, 255), onto, (across, down), flags=flags) == 255
    v, u = np.indices((down, across))
    depth = onto[2, 0] * u + onto[2, 1] * v + onto[2, 2]
    return flat, seen & (depth * np.sign(depth[down // 2, across // 2]) > 0)


def _readings(
    image: np.ndarray, part: np.ndarray, spec: Chessboard, aim: tuple[np.ndarray, np.ndarray]
) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Every placement of a part on the board: the correlation of its surroundings, ids (N,) of its corners, and
    their pixels (rows, columns, 2)."""
    right, down = part[0, -1] - part[0, 0], part[-1, 0] - part[0, 0]
    upright = part if right[0] * down[1] - right[1] * down[0] > 0 else part[:, ::-1]
    _, _, across_px, down_px = _board(spec)
    texels, beyond = DetectionSettings.part_texels, DetectionSettings.part_beyond
    for turns in range(4):
        grid = np.ascontiguousarray(np.rot90(upright, turns))
        rows, columns = grid.shape[:2]
        free_x, free_y = spec.squares_x - 1 - columns, spec.squares_y - 1 - rows
        if min(free_x, free_y) < 0:
            continue
        size = across_px + free_x * texels, down_px + free_y * texels
        flat, seen = _laid_flat(image, grid, -beyond - free_x, -beyond - free_y, *size)
        # the part itself is alike wherever black is on black; far from it, its homography is not the lens's
        x, y = (round((beyond + free) * texels) for free in (free_x, free_y))
        reach, inside = round(DetectionSettings.part_reach * texels), np.zeros(seen.shape, bool)
        inside[y : y + (rows - 1) * texels, x : x + (columns - 1) * texels] = True
        near = np.zeros(seen.shape, bool)
        near[
            max(y - reach, 0) : y + (rows - 1) * texels + reach, max(x - reach, 0) : x + (columns - 1) * texels + reach
        ] = True
        around = seen & near & ~inside
        for row in range(free_y + 1):
            for column in range(free_x + 1):
                window = np.s_[(free_y - row) * texels :, (free_x - column) * texels :]
                own, own_around, own_inside = (each[window][:down_px, :across_px] for each in (flat, around, inside))
                if _correlation(own, aim[0], own_inside & aim[1]) > 0.0:
                    lines = (row + np.arange(rows))[:, None] * spec.corner_columns
                    ids = (lines + column + np.arange(columns)).ravel()
                    yield _correlation(own, aim[0], own_around & aim[1]), ids, grid


def _correlation(first: np.ndarray, second: np.ndarray, where: np.ndarray) -> float:
    if where.sum() < DetectionSettings.part_squares * DetectionSettings.part_texels**2:
        return 0.0
    a, b = first[where] - first[where].mean(), second[where] - second[where].mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else 0.0


def _turn_rad(grid: np.ndarray, other: np.ndarray) -> float:
    """Angle between the x axes of two grids (rows, columns, 2) px."""
    a, b = ((each[:, -1] - each[:, 0]).mean(axis=0) @ np.array([1.0, 1.0j]) for each in (grid, other))
    return abs(float(np.angle(a * np.conj(b))))
