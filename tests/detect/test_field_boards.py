"""Boards as people have them: other ids, dictionaries, kinds and counts, several in view, pictures of several sizes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from targets.board import AprilGrid, Board, BoardSpec, corner_points
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.board_file import board_from, load_board, load_lens_board
from vbaa_calib.detect.board.corners import detect_corners, detect_folder

from .drawn_grids import CHESSBOARD
from .drawn_sheets import charuco_sheet, grid_sheet, view

SHARED = Path(__file__).parents[3] / "shared" / "data"
CHARUCO = BoardSpec(5, 7, 0.035, 0.025, "DICT_5X5_100")
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
    "ids from 18": replace(CHARUCO, first_id=18),
    "ids from 30": replace(CHARUCO, first_id=30),
    "ids in a list": replace(CHARUCO, ids=tuple(np.random.default_rng(0).permutation(60)[:17].tolist())),
    "AprilTags": replace(CHARUCO, dictionary="DICT_APRILTAG_36h11"),
    "few AprilTags": replace(CHARUCO, dictionary="DICT_APRILTAG_16h5"),
    "the first ArUco": replace(CHARUCO, dictionary="DICT_ARUCO_ORIGINAL"),
    "MIP": replace(CHARUCO, dictionary="DICT_ARUCO_MIP_36h12"),
}


@pytest.mark.parametrize("spec", OTHERS.values(), ids=OTHERS)
def test_a_charuco_board_of_other_ids_is_taken_and_proposed(tmp_path: Path, spec: BoardSpec) -> None:
    folder = written(tmp_path, [charuco_sheet(spec)])
    views = detect_folder(folder, board_from(spec.to_dict(), "here"))
    image, plane = view([charuco_sheet(spec)], 0)
    truth = cv2.perspectiveTransform(corner_points(spec)[None, :, :2], plane)[0]
    assert all(len(one.ids) == spec.corner_count for one in views)
    assert np.abs(detect_corners(image, spec).corners_px - truth).max() < 0.2
    message = refused(folder, CHARUCO)
    assert offered(message) == spec
    if spec.dictionary == CHARUCO.dictionary:
        assert f"{spec.marker_ids.min()}" in message
        assert f"{spec.marker_ids.max()}" in message


def test_of_several_boards_the_one_described_is_found(tmp_path: Path) -> None:
    other = charuco_sheet(replace(CHARUCO, first_id=17))
    for index, sheets in enumerate(([charuco_sheet(CHARUCO), other], [charuco_sheet(CHARUCO)] * 2)):
        folder = tmp_path / str(index)
        folder.mkdir()
        views = detect_folder(written(folder, sheets), CHARUCO)
        assert all(len(one.ids) == CHARUCO.corner_count for one in views)
        image, plane = view(sheets, 0)
        corners = detect_corners(image, CHARUCO).corners_px
        near = cv2.perspectiveTransform(corners[None], np.linalg.inv(plane))[0] / CHARUCO.square_m
        # of two copies it is one of them: whole squares, one next to the other
        steps = np.diff(near.reshape(-1, CHARUCO.squares_x - 1, 2), axis=1)
        np.testing.assert_allclose(steps, np.broadcast_to([1.0, 0.0], steps.shape), atol=0.05)


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
    folder = written(tmp_path, [sheet])
    exchanged, wider = replace(spec, columns=spec.rows, rows=spec.columns), replace(spec, spacing=spec.spacing + 0.06)
    for named in (CHARUCO, exchanged, wider, replace(spec, first_id=spec.first_id + 40)):
        proposed = offered(refused(folder, named))
        assert isinstance(proposed, AprilGrid)
        assert abs(proposed.spacing - spec.spacing) < 0.011
        assert replace(proposed, spacing=spec.spacing, tag_m=spec.tag_m) == spec


def test_a_part_of_an_april_grid_is_a_view() -> None:
    image, plane = view([grid_sheet(GRID)], 0, zoom=2.0)
    found = detect_corners(image, GRID)
    truth = cv2.perspectiveTransform(corner_points(GRID)[None, :, :2], plane)[0]
    assert 8 <= len(found.ids) < GRID.corner_count
    assert np.abs(found.corners_px - truth[found.ids]).max() < 0.2


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
    proposed = offered(refused(tmp_path, CHARUCO))
    assert isinstance(proposed, AprilGrid)
    assert (proposed.columns, proposed.rows, proposed.border) == (6, 6, 2)
    assert abs(proposed.spacing - 0.3) < 0.02
