"""Boards drawn in pictures: sharp or blurred, smeared, in any light."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import AprilGrid, BoardSpec, BoardWithIds, corner_points
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.board import Sheet, board_patches, print_sheet
from vbaa_calib.simulate.render.picture import Studio, digitise, expose
from vbaa_calib.simulate.scene.lens import Lens, project, ray_map
from vbaa_calib.simulate.scene.scene import PictureSpec

SPEC = BoardSpec(7, 5, 0.02, 0.014)
TILT_RAD = np.radians(45.0)
BEHIND = 0.35
ROOM = 1.12
FOCAL_PER_SIDE = 1.6
FAR = 1e12


@dataclass(frozen=True)
class Conditions:
    """How a picture is taken.

    square_px : side of a square, or a tag, at the board's middle, seen face on.
    blur_px : standard deviation of the lens's Gaussian blur; the pixel's own area comes on top.
    noise : standard deviation of the grey levels (of 255).
    exposure : 1 puts the paper at about 210 of 255; from 1.2 on the paper saturates.
    """

    square_px: float
    blur_px: float
    noise: float = 2.0
    exposure: float = 1.0


@dataclass(frozen=True, eq=False)
class DrawnBoard:
    """A board before noise: grey (H, W) float, its true corners (corner_count, 2) px, and how it was taken."""

    grey: np.ndarray
    corners_px: np.ndarray
    conditions: Conditions

    def picture(self, rng: np.random.Generator) -> np.ndarray:
        """(H, W) uint8 with fresh noise."""
        return digitise(_picture_spec(self.conditions), self.grey, rng)


def draw_board(
    sheet: Sheet, conditions: Conditions, rng: np.random.Generator, tilt_rad: float = TILT_RAD
) -> DrawnBoard:
    """The whole board through an ideal lens: random tilt up to `tilt_rad`, roll and place on the pixel grid."""
    spec = sheet.spec
    diagonal = float(np.hypot(*(np.array(spec.size_m) / side_m(spec) + 1.0)))
    side = int(np.ceil(ROOM * diagonal * conditions.square_px))
    focal, middle = FOCAL_PER_SIDE * side, (side - 1) / 2
    lens = Lens("opencv", (side, side), np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]]), np.zeros(0))
    pose = _pose(spec, focal, conditions.square_px, rng, tilt_rad)
    ones = np.ones((side, side), np.float32)
    place = Studio(_picture_spec(conditions), ray_map(lens), np.float32(conditions.exposure) * ones, ones[:2, :2])
    # seen straight down, so that the board is lit alike in every picture
    seen = board_patches(place, sheet, pose, np.diag([1.0, -1.0, -1.0]))
    grey = expose(place, np.float32(BEHIND) * ones, seen)
    return DrawnBoard(grey, project(lens, pose @ corner_points(spec)), conditions)


def side_m(spec: BoardWithIds) -> float:
    """Of a square, or of a tag."""
    return spec.tag_m if isinstance(spec, AprilGrid) else spec.square_m


def _pose(spec: BoardWithIds, focal: float, square_px: float, rng: np.random.Generator, tilt_rad: float) -> Pose:
    around, roll = rng.uniform(0.0, 2 * np.pi, 2)
    tilt = Rotation.from_rotvec(rng.uniform(0.0, tilt_rad) * np.array([np.cos(around), np.sin(around), 0.0]))
    rotation = (tilt * Rotation.from_rotvec([0.0, 0.0, roll])).as_matrix()
    distance = focal * side_m(spec) / square_px
    shift = np.append(rng.uniform(-1.0, 1.0, 2) * side_m(spec) / square_px, distance)
    return Pose(rotation, shift - rotation[:, :2] @ spec.outline_m.mean(axis=0))


def _picture_spec(conditions: Conditions) -> PictureSpec:
    return PictureSpec(conditions.blur_px, conditions.noise, FAR, 0.0, 0.0, BEHIND, 0.0, 0.0, 0.0, 0.0)


GOOD = Conditions(55, 0.8)

_sheet = functools.cache(print_sheet)


@functools.cache
def drawn(seed: int, conditions: Conditions = GOOD, spec: BoardWithIds = SPEC) -> DrawnBoard:
    return draw_board(_sheet(spec), conditions, np.random.default_rng(seed), tilt_rad=0.6)


def picture(board: DrawnBoard, seed: int = 0) -> np.ndarray:
    return board.picture(np.random.default_rng(seed))


def smeared(board: DrawnBoard, motion_px: np.ndarray) -> DrawnBoard:
    """The picture of a camera that moved by (u, v) px at constant speed."""
    shifts = np.linspace(-0.5, 0.5, 41)[:, None] * motion_px
    size, keep = board.grey.shape[::-1], cv2.BORDER_REPLICATE
    moved = [cv2.warpAffine(board.grey, np.array([[1, 0, u], [0, 1, v]]), size, borderMode=keep) for u, v in shifts]
    return dataclasses.replace(board, grey=np.mean(moved, axis=0))
