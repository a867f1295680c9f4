"""The board's picture puts its corners where the lens says they are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from targets.board import BoardSpec, corner_points, opencv_board
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.plan import board_poses
from vbaa_calib.simulate.render.board import board_patch, outline, print_sheet
from vbaa_calib.simulate.render.picture import digitise, expose, surroundings
from vbaa_calib.simulate.render.settings import PAINT
from vbaa_calib.simulate.scene.lens import project
from vbaa_calib.simulate.scene.scene import IntrinsicsSpec

from .studios import LENSES, place

BOARD = BoardSpec(11, 8, 0.015, 0.011)
DOWNWARD = np.diag([1.0, -1.0, -1.0])


def _corner_errors(lens: str, nearness: float, tilt_rad: float) -> np.ndarray:
    scene = place(lens)
    sheet, detector = print_sheet(BOARD), cv2.aruco.CharucoDetector(opencv_board(BOARD))
    spec = IntrinsicsSpec(5, (0.23 / nearness, 0.40 / nearness), (0.14, tilt_rad))
    errors = []
    for pose in board_poses(scene.rays.lens, BOARD, spec, np.random.default_rng(1)):
        patch = board_patch(scene, sheet, pose, DOWNWARD)
        grey = expose(scene, surroundings(scene, DOWNWARD), [patch])
        picture = digitise(scene.spec, grey, np.random.default_rng(0))
        found, ids, _, _ = detector.detectBoard(picture)
        true = project(scene.rays.lens, pose @ corner_points(BOARD))[ids.ravel()]
        errors.append(found.reshape(-1, 2) - true)
    return np.concatenate(errors)


@pytest.mark.parametrize(
    ("lens", "nearness", "tilt_rad"),
    # OpenCV's detector itself is a pixel off where small squares are strongly bent
    [
        ("pinhole", 1, 0.66),
        ("brown", 1, 0.66),
        pytest.param("rational", 2, 0.4, marks=pytest.mark.slow),
        ("fisheye", 2, 0.4),
    ],
)
def test_detected_corners_lie_on_the_projected_ones(lens: str, nearness: float, tilt_rad: float) -> None:
    errors = _corner_errors(lens, nearness, tilt_rad)
    assert len(errors) > 250
    assert np.linalg.norm(errors, axis=1).mean() < 0.05
    assert np.abs(errors.mean(axis=0)).max() < 0.03


@pytest.mark.parametrize(
    "spec", [BOARD, BoardSpec(9, 6, 0.012, 0.009, "DICT_5X5_250"), BoardSpec(5, 8, 0.02, 0.0147, legacy_pattern=True)]
)
def test_squares_begin_at_whole_texels(spec: BoardSpec) -> None:
    sheet = print_sheet(spec)
    square, margin = spec.square_m * sheet.texels_per_m, sheet.margin_m * sheet.texels_per_m
    assert square == pytest.approx(round(square), abs=1e-9)
    assert margin == pytest.approx(round(margin), abs=1e-9)
    step = round(square)
    # the ink of a whole black square ends exactly at its border
    corner = (0, 0) if sheet.texture[round(margin) + 1, round(margin) + 1, 0] < 30000 else (0, 1)
    top, left = round(margin) + corner[0] * step, round(margin) + corner[1] * step
    black = sheet.texture[top : top + step, left : left + step, 0]
    assert (black == black[0, 0]).all()
    assert black[0, 0] < 0.1 * 65535
    assert sheet.texture[top - 1, left + 5, 0] == pytest.approx(PAINT.paper * 65535, abs=1)


def test_the_sheet_covers_the_pixels_inside_its_outline() -> None:
    scene, sheet = place("brown"), print_sheet(BOARD)
    pose = Pose.from_rotvec(np.array([0.4, -0.3, 0.2]), np.array([-0.08, -0.05, 0.32]))
    patch = board_patch(scene, sheet, pose, DOWNWARD)
    border = project(scene.rays.lens, pose @ outline(sheet))
    area = cv2.contourArea(border.astype(np.float32).reshape(-1, 1, 2))
    assert patch.alpha.sum() / patch.factor**2 == pytest.approx(area, rel=1e-3)


def test_the_back_of_the_board_is_not_drawn() -> None:
    scene, sheet = place("brown"), print_sheet(BOARD)
    turned = Pose.from_rotvec(np.array([0.0, np.pi, 0.0]), np.array([0.08, -0.05, 0.3]))
    assert board_patch(scene, sheet, turned, DOWNWARD) is None
    beside = Pose.from_rotvec(np.zeros(3), np.array([3.0, 0.0, 0.3]))
    assert board_patch(scene, sheet, beside, DOWNWARD) is None


@pytest.mark.parametrize("lens", sorted(LENSES))
def test_hand_held_poses_spread_over_the_picture(lens: str) -> None:
    poses = board_poses(LENSES[lens], BOARD, IntrinsicsSpec(20, (0.2, 0.4), (0.1, 0.7)), np.random.default_rng(3))
    pixels = np.concatenate([project(LENSES[lens], pose @ corner_points(BOARD)) for pose in poses])
    width, height = LENSES[lens].image_size
    inside = ((pixels >= 0) & (pixels < [width, height])).all(axis=1)
    cells = {(int(u * 6 / width), int(v * 5 / height)) for u, v in pixels[inside]}
    assert inside.mean() > 0.8
    assert len(cells) >= 26
