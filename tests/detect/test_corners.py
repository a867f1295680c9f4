"""Corners in drawn pictures of a board, and boards that are not what the spec says."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from targets.board import BoardSpec
from targets.charuco import corner_points, opencv_board
from vbaa_calib.detect.board_diagnosis import marker_cells
from vbaa_calib.detect.corners import detect_corners, detect_files, detect_folder
from vbaa_calib.errors import InputError

SPEC = BoardSpec(squares_x=9, squares_y=6, square_m=0.012, marker_m=0.009)
SIZE = (960, 720)


def drawn(spec: BoardSpec, seed: int, size: tuple[int, int] = SIZE) -> tuple[np.ndarray, np.ndarray]:
    """A slightly tilted board, blurred and noisy, and its true corners (corner_count, 2) px."""
    rng = np.random.default_rng(seed)
    per_square = 60
    sheet = opencv_board(spec).generateImage((spec.squares_x * per_square, spec.squares_y * per_square))
    height, width = sheet.shape
    # drawn at four times the size, then shrunk: the borders are antialiased
    room = np.array(size) * 4 * 0.12
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (np.array(size) * 4 - 2 * room) + room
    corners = corners + rng.uniform(-0.06, 0.06, (4, 2)) * np.array(size) * 4
    outline = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    homography = cv2.getPerspectiveTransform(outline.astype(np.float32), corners.astype(np.float32))
    large = cv2.warpPerspective(
        sheet, homography, (size[0] * 4, size[1] * 4), flags=cv2.INTER_LINEAR, borderValue=(200.0,)
    )
    picture = cv2.resize(large, size, interpolation=cv2.INTER_AREA)
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7).astype(float) * 0.7 + 30 + rng.normal(0, 2, picture.shape)
    on_sheet = corner_points(spec)[:, :2] / spec.square_m * per_square - 0.5
    large_px = cv2.perspectiveTransform(on_sheet[None], homography)[0]
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8), (large_px + 0.5) / 4 - 0.5


def write_pictures(folder: Path, spec: BoardSpec, count: int = 3) -> Path:
    for seed in range(count):
        cv2.imwrite(str(folder / f"{seed}.png"), drawn(spec, seed)[0])
    return folder


def test_corners_are_found_to_a_twentieth_of_a_pixel_and_without_bias() -> None:
    errors = []
    for seed in range(4):
        picture, truth = drawn(SPEC, seed)
        view = detect_corners(picture, SPEC, "p")
        assert len(view.ids) == SPEC.corner_count
        assert view.image_size == SIZE
        assert view.marker_count == 27
        errors.append(view.corners_px - truth[view.ids])
    errors = np.concatenate(errors)
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) < 0.05
    assert np.abs(errors.mean(axis=0)).max() < 0.01, "pixel (0, 0) is the centre of the first pixel"


def test_a_picture_without_a_board_gives_an_empty_view() -> None:
    view = detect_corners(np.full((480, 640), 128, np.uint8), SPEC)
    assert (len(view.ids), view.marker_count, view.corners_px.shape) == (0, 0, (0, 2))


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("columns", [8, 9])
def test_marker_cells_are_opencvs(legacy: bool, columns: int) -> None:
    spec = BoardSpec(columns, 6, 0.012, 0.009, legacy_pattern=legacy)
    centres = np.array([np.mean(outline, axis=0)[:2] for outline in opencv_board(spec).getObjPoints()]) / 0.012
    np.testing.assert_allclose(marker_cells(columns, legacy, len(centres)) + 0.5, centres, atol=1e-5)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"dictionary": "DICT_5X5_100"}, "markers of DICT_4X4_50 are found"),
        ({"squares_x": 8}, r"squares_x: 9 \(not 8\)"),
        ({"squares_x": 10}, r"squares_x: 9 \(not 10\)"),
        ({"squares_y": 5}, "squares_y is 6 or more"),
        ({"squares_x": 6, "squares_y": 9}, r"squares_x: 9 \(not 6\)"),
        ({"legacy_pattern": True}, "legacy_pattern: false"),
    ],
)
def test_a_wrong_spec_is_refused_with_its_cause(tmp_path: Path, change: dict, cause: str) -> None:
    folder = write_pictures(tmp_path, SPEC)
    with pytest.raises(InputError, match=f"does not fit the pictures: .*{cause}"):
        detect_folder(folder, dataclasses.replace(SPEC, **change))


@pytest.mark.parametrize(("columns", "rows"), [(9, 6), (8, 6)])
def test_the_legacy_pattern_is_told_from_the_present_one(tmp_path: Path, columns: int, rows: int) -> None:
    legacy = BoardSpec(columns, rows, 0.012, 0.009, legacy_pattern=True)
    folder = write_pictures(tmp_path, legacy)
    assert all(len(view.ids) == legacy.corner_count for view in detect_folder(folder, legacy))
    with pytest.raises(InputError, match="legacy_pattern: true"):
        detect_folder(folder, dataclasses.replace(legacy, legacy_pattern=False))


def test_mirrored_pictures_are_named_as_the_cause(tmp_path: Path) -> None:
    for seed in range(3):
        cv2.imwrite(str(tmp_path / f"{seed}.png"), cv2.flip(drawn(SPEC, seed)[0], 1))
    with pytest.raises(InputError, match="mirrored"):
        detect_folder(tmp_path, SPEC)


def test_a_negative_board_is_named_as_the_cause(tmp_path: Path) -> None:
    for seed in range(3):
        cv2.imwrite(str(tmp_path / f"{seed}.png"), 255 - drawn(SPEC, seed)[0])
    with pytest.raises(InputError, match="black and white exchanged"):
        detect_folder(tmp_path, SPEC)


def test_pictures_without_a_board_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for index in range(2):
        cv2.imwrite(str(tmp_path / f"{index}.png"), rng.integers(0, 255, (300, 400), np.uint8))
    with pytest.raises(InputError, match="no board is found"):
        detect_folder(tmp_path, SPEC)


def test_mixed_sizes_are_refused_by_name(tmp_path: Path) -> None:
    write_pictures(tmp_path, SPEC, 2)
    cv2.imwrite(str(tmp_path / "9.png"), drawn(SPEC, 5, (800, 600))[0])
    with pytest.raises(InputError, match=r"9\.png: is 800x600 px, 0\.png is 960x720 px"):
        detect_folder(tmp_path, SPEC)


def test_a_truncated_picture_is_refused_by_name(tmp_path: Path) -> None:
    write_pictures(tmp_path, SPEC, 2)
    whole = (tmp_path / "1.png").read_bytes()
    (tmp_path / "1.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"1\.png: is truncated"):
        detect_files(sorted(tmp_path.iterdir()), SPEC)
