"""Boards without ids, and boards as people have them: other dictionaries, kinds and counts, several in view."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from targets.board import AprilGrid, Board, BoardSpec, Chessboard, CircleGrid, corner_points
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.lens_from_views import solve_lens
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.board_file import board_from, load_board, load_lens_board
from vbaa_calib.detect.board.corners import BoardView, detect_corners, detect_files, detect_folder
from vbaa_calib.detect.board.grids import find_grid
from vbaa_calib.detect.board.parts import place_part

from .drawn_grids import ASYMMETRIC, CHESSBOARD, CIRCLES, MATRIX, drawn, picture, pose
from .drawn_sheets import charuco_sheet, grid_sheet, view

DATA = Path(__file__).parents[3] / "shared" / "data"
ENDOSCOPE, LAPAROSCOPE = DATA / "ucl_axis_tests_charuco" / "ExtractedFrames_L", DATA / "ucl_laparoscope_chess_points"
_Plain = Chessboard | CircleGrid


@functools.cache
def seen(spec: _Plain, seed: int, tilt: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    grey, truth = drawn(spec, *pose(seed, spec, tilt))
    return picture(grey, seed=seed), truth


@pytest.mark.parametrize(
    "spec", [CHESSBOARD, CIRCLES, pytest.param(ASYMMETRIC, marks=pytest.mark.slow)], ids=lambda spec: spec.type
)
def test_marks_are_found_where_they_are_and_no_less_surely_than_stated(spec: _Plain) -> None:
    views = [(detect_corners(seen(spec, seed)[0], spec), seen(spec, seed)[1]) for seed in (0, 2)]
    errors = np.concatenate([view.corners_px - truth[view.ids] for view, truth in views])
    assert sum(len(view.ids) for view, _ in views) >= 0.9 * 2 * spec.corner_count
    assert np.sqrt((errors**2).sum(axis=1).mean()) < (0.05 if spec == CHESSBOARD else 0.02)
    assert np.abs(errors.mean(axis=0)).max() < 0.01
    if spec != CHESSBOARD:  # cv2.cornerSubPix has a bias that the covariance leaves out
        covariances = np.concatenate([view.covariance_px2 for view, _ in views if view.covariance_px2 is not None])
        squares = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
        assert 0.6 < squares.mean() / 2.0 < 2.0


@pytest.mark.parametrize("spec", [CHESSBOARD, CIRCLES, ASYMMETRIC], ids=lambda spec: spec.type)
def test_a_turned_picture_is_read_as_the_marks_tell_or_else_upright(spec: _Plain) -> None:
    image, _ = seen(spec, 0)
    upright = find_grid(image, spec)
    turned = find_grid(np.ascontiguousarray(image[::-1, ::-1]), spec)
    assert upright is not None
    back = np.array(image.shape[::-1]) - 1 - turned
    told = spec != CIRCLES  # 9 x 6 squares and 11 rows are not the same when turned by half
    np.testing.assert_allclose(back if told else back[::-1], upright, atol=0.5)


@functools.cache
def seen_in_part(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rvec, shift = pose(seed, CHESSBOARD, 0.4)
    way = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi)
    grey, truth = drawn(CHESSBOARD, rvec, shift + np.array([0.09 * np.cos(way), 0.07 * np.sin(way), 0.0]))
    return picture(grey, seed=seed), truth


def test_a_part_is_placed_by_a_picture_of_the_whole_board_or_not_at_all() -> None:
    """On plain ground, where but the board's own rim tells; whole square for whole square, or nothing."""
    whole, _ = seen(CHESSBOARD, 0)
    corners_px, placed = detect_corners(whole, CHESSBOARD).corners_px, 0
    for seed in (10, 11, 14, 16, 17, 20, 28):
        image, truth = seen_in_part(seed)
        part = place_part(image, CHESSBOARD, whole, corners_px)
        if part is not None:
            placed += 1
            assert np.abs(part[1] - truth[part[0]]).max() < 0.15 * np.linalg.norm(truth[1] - truth[0])
    assert placed >= 4


def test_parts_go_into_the_lens_and_wrong_ones_do_not(tmp_path: Path) -> None:
    for seed in (0, 2, 3, 4, 5, 6):
        cv2.imwrite(str(tmp_path / f"{seed:02d}.png"), seen(CHESSBOARD, seed, 0.5)[0])
    for seed in (11, 14):
        cv2.imwrite(str(tmp_path / f"{seed:02d}.png"), seen_in_part(seed)[0])
    views = detect_folder(tmp_path, CHESSBOARD)
    whole = views[:6]
    parts = [view for view in views[6:] if len(view.ids)]
    assert len(parts) >= 2
    assert all(len(view.ids) < CHESSBOARD.corner_count for view in parts)
    lens = solve_lens(views, CHESSBOARD)
    assert not lens.dropped
    assert lens.rms_px < 1.3 * solve_lens(whole, CHESSBOARD).rms_px
    assert abs(lens.camera.matrix[0, 0] - MATRIX[0, 0]) < 4.0 * np.sqrt(lens.camera.covariance[0, 0])
    # another part is the board elsewhere, which is nothing to the lens; what is no part of it is named
    columns = parts[0].ids % CHESSBOARD.corner_columns
    elsewhere = replace(parts[0], ids=parts[0].ids + (1 if columns.max() < columns.size else -1))
    assert elsewhere.ids.max() < CHESSBOARD.corner_count


@pytest.mark.skipif(not ENDOSCOPE.is_dir(), reason="the real endoscope pictures are not here")
def test_a_chessboard_inset_among_markers_is_found_in_real_pictures() -> None:
    paths = sorted(ENDOSCOPE.glob("*.jpg"))[3::20]
    views = detect_files(paths, Chessboard("chessboard", 9, 14, 0.003))
    assert [len(view.ids) for view in views] == [104] * len(paths)


@pytest.mark.skipif(not LAPAROSCOPE.is_dir(), reason="the points of the real laparoscope are not here")
def test_the_lens_from_a_real_chessboard_is_its_authors() -> None:
    """Their test has an rms of 0.57759896 px, by OpenCV's lens of five coefficients and a flat board."""
    paths = sorted(LAPAROSCOPE.glob("left-*.txt"))
    views = [BoardView(path.name, np.arange(140), np.loadtxt(path), (1920, 1080)) for path in paths]
    board = Chessboard("chessboard", 15, 11, 0.003)
    np.testing.assert_allclose(
        corner_points(board) - board.square_m * np.array([1, 1, 0]),
        1e-3 * np.loadtxt(LAPAROSCOPE / "chessboard_14_10_3.txt"),
        atol=1e-12,
    )
    solution = solve_intrinsics(views, board, "opencv5")
    assert solution.rms_px <= 0.57759896, "theirs holds the board flat"
    assert abs(solution.camera.matrix[0, 0] - 2007.32) < 3.0 * np.sqrt(solution.camera.covariance[0, 0])


SHARED = Path(__file__).parents[3] / "shared" / "data"
CHARUCO_BOARDS = BoardSpec(5, 7, 0.035, 0.025, "DICT_5X5_100")
GRID = AprilGrid("aprilgrid", 4, 3, 0.035, 0.3)


def written(folder: Path, sheets: list[tuple[np.ndarray, float]], count: int = 3, zoom: float = 1.0) -> Path:
    for seed in range(count):
        cv2.imwrite(str(folder / f"{seed}.png"), view(sheets, seed, zoom)[0])
    return folder


def offered(message: str) -> Board:
    """The board that a refusal proposes, as the user would paste it."""
    return board_from(yaml.safe_load(message[message.index("{") : message.rindex("}") + 1]), "the message")


def refused(folder: Path, spec: Board) -> str:
    with pytest.raises(InputError) as caught:
        detect_folder(folder, spec)
    return str(caught.value)


OTHERS = {
    "ids from 18": replace(CHARUCO_BOARDS, first_id=18),
    "ids from 30": replace(CHARUCO_BOARDS, first_id=30),
    "ids in a list": replace(CHARUCO_BOARDS, ids=tuple(np.random.default_rng(0).permutation(60)[:17].tolist())),
    "AprilTags": replace(CHARUCO_BOARDS, dictionary="DICT_APRILTAG_36h11"),
    "few AprilTags": replace(CHARUCO_BOARDS, dictionary="DICT_APRILTAG_16h5"),
    "the first ArUco": replace(CHARUCO_BOARDS, dictionary="DICT_ARUCO_ORIGINAL"),
    "MIP": replace(CHARUCO_BOARDS, dictionary="DICT_ARUCO_MIP_36h12"),
}


@pytest.mark.parametrize("spec", OTHERS.values(), ids=OTHERS)
def test_a_charuco_board_of_other_ids_is_taken_and_proposed(tmp_path: Path, spec: BoardSpec) -> None:
    folder = written(tmp_path, [charuco_sheet(spec)])
    views = detect_folder(folder, board_from(spec.to_dict(), "here"))
    image, plane = view([charuco_sheet(spec)], 0)
    truth = cv2.perspectiveTransform(corner_points(spec)[None, :, :2], plane)[0]
    assert all(len(one.ids) == spec.corner_count for one in views)
    assert np.abs(detect_corners(image, spec).corners_px - truth).max() < 0.2
    message = refused(folder, CHARUCO_BOARDS)
    assert offered(message) == spec
    if spec.dictionary == CHARUCO_BOARDS.dictionary:
        assert f"{spec.marker_ids.min()}" in message
        assert f"{spec.marker_ids.max()}" in message


GRIDS = {
    "Kalibr's": (GRID, 2),
    "upright tags": (GRID, 0),
    "tags on their side": (replace(GRID, columns=3, rows=4), 3),
    "narrow border": (replace(GRID, border=1), 2),
    "from 5 on": (replace(GRID, first_id=5, spacing=0.25), 2),
}


@pytest.mark.parametrize(("spec", "turns"), GRIDS.values(), ids=GRIDS)
def test_an_april_grid_is_found_and_proposed(tmp_path: Path, spec: AprilGrid, turns: int) -> None:
    sheet = grid_sheet(spec, turns)
    errors = []
    for seed in range(3):
        image, plane = view([sheet], seed)
        found = detect_corners(image, spec)
        truth = cv2.perspectiveTransform(corner_points(spec)[None, :, :2], plane)[0]
        assert len(found.ids) >= 0.95 * spec.corner_count
        errors.append(found.corners_px - truth[found.ids])
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.04
    folder = written(tmp_path, [sheet], 1)
    exchanged, wider = replace(spec, columns=spec.rows, rows=spec.columns), replace(spec, spacing=spec.spacing + 0.06)
    wrong = (CHARUCO_BOARDS, exchanged, wider, replace(spec, first_id=spec.first_id + 40))
    for named in wrong if spec == GRID and turns else wrong[turns - 2 :][:1]:
        proposed = offered(refused(folder, named))
        assert isinstance(proposed, AprilGrid)
        assert abs(proposed.spacing - spec.spacing) < 0.011
        assert replace(proposed, spacing=spec.spacing, tag_m=spec.tag_m) == spec


def test_kalibrs_targets_are_boards(tmp_path: Path) -> None:
    path = tmp_path / "target.yaml"
    for text, board in (
        ("target_type: aprilgrid\ntagCols: 4\ntagRows: 3\ntagSize: 0.035\ntagSpacing: 0.3\n", GRID),
        (
            "target_type: checkerboard\ntargetCols: 8\ntargetRows: 5\nrowSpacingMeters: 0.02\ncolSpacingMeters: 0.02\n",
            CHESSBOARD,
        ),
    ):
        path.write_text(text)
        assert load_lens_board(path) == board
        if isinstance(board, AprilGrid):
            assert load_board(path) == board
            continue
        with pytest.raises(InputError, match="a ChArUco board or an AprilGrid"):
            load_board(path)
    for text, words in (("target_type: dots\n", "target_type is 'dots'"), ("target_type: aprilgrid\n", "tagCols is")):
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            load_lens_board(path)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the real photographs are not here")
def test_a_real_april_grid_is_found_and_proposed(tmp_path: Path) -> None:
    for path in sorted((SHARED / "aprilgrid_photos").glob("*.jpg")):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(tmp_path / f"{path.stem}.png"), small)
        assert len(detect_corners(image, AprilGrid("aprilgrid", 6, 6, 0.088, 0.3)).ids) > 120
    proposed = offered(refused(tmp_path, CHARUCO_BOARDS))
    assert isinstance(proposed, AprilGrid)
    assert (proposed.columns, proposed.rows, proposed.border) == (6, 6, 2)
    assert abs(proposed.spacing - 0.3) < 0.02
