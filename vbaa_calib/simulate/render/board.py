"""The board as the camera sees it: the ray of every sub-pixel is intersected with the printed sheet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from targets.board import AprilGrid, BoardWithIds, opencv_board
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core
from vbaa_calib.simulate.scene.lens import project

from .picture import LAMP_WORLD, ImagePatch, Studio, frame_around
from .settings import PAINT


@dataclass(frozen=True, eq=False)
class Sheet:
    """A printed board with its white margin.

    Attributes
    ----------
    paper : (rows, columns) uint32, 1 where a texel is paper, 0 where it is ink.
    blocks : (rows + 3, columns + 3) uint32, two by two of them in one number as the core reads them, none of them paper
        beyond the sheet.
    texels_per_m : resolution.
    margin_m : from the sheet's edges to the board frame's origin, and as far on the other side: the white margin, of an
        AprilGrid with the squares at its rim.
    """

    spec: BoardWithIds
    paper: np.ndarray
    blocks: np.ndarray
    texels_per_m: float
    margin_m: float


def print_sheet(spec: BoardWithIds) -> Sheet:
    """Draw the board at a resolution at which squares, markers and their bits begin at whole texels."""
    if isinstance(spec, AprilGrid):
        sides = range(10 * spec.modules, 21 * spec.modules, spec.modules)
        tag = min(sides, key=lambda texels: round(abs(spec.spacing * texels - round(spec.spacing * texels)), 6))
        margin = round(PAINT.margin_squares * tag)
        drawing = np.pad(spec.drawing(tag), margin, constant_values=255)
        return _printed(spec, drawing, tag / spec.tag_m, margin / tag * spec.tag_m + spec.pitch_m)
    ratio = spec.marker_m / spec.square_m

    def misfit(texels: int) -> float:
        module, gap = texels * ratio / spec.modules, texels * (1 - ratio) / 2
        return abs(module - round(module)) * spec.modules + abs(gap - round(gap))

    square = min(range(72, 132, 2), key=lambda texels: (round(misfit(texels), 6), abs(texels - 90)))
    margin = round(PAINT.margin_squares * square)
    size = (spec.squares_x * square + 2 * margin, spec.squares_y * square + 2 * margin)
    drawing = opencv_board(spec).generateImage(size, marginSize=margin, borderBits=1)
    return _printed(spec, drawing, square / spec.square_m, margin / square * spec.square_m)


def _printed(spec: BoardWithIds, drawing: np.ndarray, texels_per_m: float, margin_m: float) -> Sheet:
    """The sheet from a drawing (rows, columns) uint8."""
    paper = (drawing > 127).astype(np.uint32)
    around = np.pad(paper, 2)
    upper, lower = (rows[:, :-1] + 2 * rows[:, 1:] for rows in (around[:-1], around[1:]))
    return Sheet(spec, paper, upper + 4 * lower, texels_per_m, margin_m)


def outline(sheet: Sheet) -> np.ndarray:
    """(n, 3) points around the sheet's edge, board frame, m."""
    rows, columns = sheet.paper.shape
    corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows], [0, 0]]) / sheet.texels_per_m - sheet.margin_m
    steps = np.linspace(0.0, 1.0, 12, endpoint=False)[:, None]
    sides = [a + steps * (b - a) for a, b in pairwise(corners)]
    return np.pad(np.concatenate(sides), ((0, 0), (0, 1)))


def board_patches(
    place: Studio, sheet: Sheet, T_camera_board: Pose, R_world_camera: np.ndarray, rows: int = PAINT.board_rows
) -> Iterator[ImagePatch]:
    """The sheet's picture, `rows` of its pixels at a time: none outside the picture or seen from behind.

    R_world_camera : (3, 3), for the light on it.
    """
    rotation, shift = T_camera_board.rotation, T_camera_board.translation_m
    if rotation[:, 2] @ shift <= 0:
        return
    left, top, right, bottom = frame_around(place, project(place.rays.lens, T_camera_board @ outline(sheet)))
    if right <= left:
        return
    board_from_ray = np.linalg.inv(np.stack([rotation[:, 0], rotation[:, 1], shift], axis=1))
    scale, factor = sheet.texels_per_m, PAINT.board_subpixels
    texel_from_board = np.array(
        [[scale, 0, scale * sheet.margin_m - 0.5], [0, scale, scale * sheet.margin_m - 0.5], [0, 0, 1]]
    )
    light = 0.6 + 0.4 * max(-(R_world_camera @ rotation[:, 2]) @ LAMP_WORLD, 0.0)
    texel_from_ray, print_ = texel_from_board @ board_from_ray, (light * PAINT.ink, light * PAINT.paper)
    for first in range(top, bottom, rows):
        last = min(first + rows, bottom)
        begin = max(first - place.room_px, 0)
        window = left, begin, right - left, min(last + place.room_px, len(place.light)) - begin, factor
        inked = first - begin, last - begin
        fine = core.simulate.sheet_pixels(place.rays.padded, window, texel_from_ray, sheet.blocks, print_, inked)
        yield ImagePatch(left, begin, factor, *fine)
