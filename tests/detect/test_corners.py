"""Corners in drawn pictures of a board: places, covariances against scatter, and boards unlike their spec."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from targets.board import BoardSpec, corner_points, opencv_board
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import detect_corners, detect_folder
from vbaa_calib.detect.board.markers import Markers, marker_cells, marker_grids
from vbaa_calib.simulate.render.board import print_sheet

from .drawn_boards import Conditions, draw_board

SPEC = BoardSpec(squares_x=9, squares_y=6, square_m=0.012, marker_m=0.009)
SIZE = (960, 720)


@functools.cache
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


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("columns", [8, 9])
def test_marker_cells_are_opencvs(legacy: bool, columns: int) -> None:
    spec = BoardSpec(columns, 6, 0.012, 0.009, legacy_pattern=legacy)
    centres = np.array([np.mean(outline, axis=0)[:2] for outline in opencv_board(spec).getObjPoints()]) / 0.012
    np.testing.assert_allclose(marker_cells(np.arange(len(centres)), columns, legacy) + 0.5, centres, atol=1e-5)


def spec_in(message: str) -> BoardSpec:
    """The board that an error offers, read as the user would paste it."""
    return BoardSpec(**yaml.safe_load(message[message.index("{") : message.index("}") + 1]))


@pytest.mark.parametrize(
    ("change", "causes"),
    [
        pytest.param(
            {"dictionary": "DICT_5X5_100"}, ["dictionary: DICT_4X4_50 (not DICT_5X5_100)"], marks=pytest.mark.slow
        ),
        ({"squares_x": 8}, ["squares_x: 9 (not 8)"]),
        ({"squares_y": 5}, ["squares_y is 6 or more (not 5)"]),
        ({"squares_x": 6, "squares_y": 9}, ["squares_x: 9 (not 6)", "are exchanged"]),
        ({"legacy_pattern": True}, ["legacy_pattern: false"]),
        ({"marker_m": 0.006}, ["marker_m: 0.009 (markers measure 0.75 of a square, not 0.50)"]),
        (
            {"squares_x": 5, "squares_y": 4, "marker_m": 0.006, "dictionary": "DICT_7X7_50", "legacy_pattern": True},
            ["DICT_4X4_50", "squares_x: 9", "squares_y is 6", "legacy_pattern: false", "marker_m: 0.009"],
        ),
    ],
)
def test_a_wrong_spec_is_refused_with_its_causes_and_the_spec_that_fits(
    tmp_path: Path, change: dict, causes: list[str]
) -> None:
    folder = write_pictures(tmp_path, SPEC)
    with pytest.raises(InputError, match="does not fit the pictures") as caught:
        detect_folder(folder, dataclasses.replace(SPEC, **change))
    for cause in causes:
        assert cause in str(caught.value)
    fitting = spec_in(str(caught.value))
    # the pictures cannot tell a dictionary from a larger one of its family that begins with it
    assert fitting == dataclasses.replace(SPEC, dictionary=fitting.dictionary)
    assert fitting.dictionary in ("DICT_4X4_50", "DICT_4X4_100")
    assert all(len(view.ids) == SPEC.corner_count for view in detect_folder(folder, fitting))


@pytest.mark.parametrize("ratio", [0.5, 0.85])
def test_the_markers_share_of_a_square_is_measured(ratio: float) -> None:
    spec = BoardSpec(9, 6, 0.02, 0.02 * ratio)
    views = [detect_corners(drawn(spec, seed)[0], SPEC) for seed in range(2)]
    markers = [Markers(view.marker_ids, view.marker_corners_px) for view in views]
    assert 1.0 / marker_grids(markers)[0].unit == pytest.approx(ratio, abs=0.02)


@pytest.mark.parametrize("shape", [(0, 0), (0, 9), (1, 1), (9, 700), (300, 400)])
@pytest.mark.parametrize("darkest", [0, 255])
def test_noise_and_blank_pictures_give_empty_views(shape: tuple[int, int], darkest: int) -> None:
    view = detect_corners(np.random.default_rng(0).integers(darkest, 256, shape).astype(np.uint8), SPEC)
    assert (len(view.ids), view.corners_px.shape, view.image_size) == (0, (0, 2), shape[::-1])
    assert view.covariance_px2.shape == (0, 2, 2)
    assert view.quality.collinear


@pytest.mark.parametrize(("columns", "rows"), [(9, 6), (8, 6)])
def test_the_legacy_pattern_is_told_from_the_present_one(tmp_path: Path, columns: int, rows: int) -> None:
    legacy = BoardSpec(columns, rows, 0.012, 0.009, legacy_pattern=True)
    folder = write_pictures(tmp_path, legacy)
    assert all(len(view.ids) == legacy.corner_count for view in detect_folder(folder, legacy))
    with pytest.raises(InputError, match="legacy_pattern: true"):
        detect_folder(folder, dataclasses.replace(legacy, legacy_pattern=False))


@pytest.mark.parametrize(
    ("mirrored", "negative", "change"),
    [
        pytest.param(True, False, {}, marks=pytest.mark.slow),
        (False, True, {"squares_x": 8}),
        pytest.param(True, True, {"dictionary": "DICT_5X5_100"}, marks=pytest.mark.slow),
    ],
)
def test_turned_pictures_are_named_as_the_cause(tmp_path: Path, change: dict, mirrored: bool, negative: bool) -> None:
    for seed in range(2):
        picture = drawn(SPEC, seed)[0]
        picture = cv2.flip(picture, 1) if mirrored else picture
        cv2.imwrite(str(tmp_path / f"{seed}.png"), 255 - picture if negative else picture)
    with pytest.raises(InputError, match="does not fit the pictures") as caught:
        detect_folder(tmp_path, dataclasses.replace(SPEC, **change))
    assert ("mirrored" in str(caught.value)) == mirrored
    assert ("black and white exchanged" in str(caught.value)) == negative
    fitting = spec_in(str(caught.value))
    assert (fitting.squares_x, fitting.squares_y, fitting.marker_m) == (9, 6, 0.009)
    assert fitting.dictionary.startswith("DICT_4X4_")


SPEC_COVARIANCE = BoardSpec(6, 5, 0.02, 0.012)
SHEET = print_sheet(SPEC_COVARIANCE)


def sampled(condition: Conditions, draws: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predicted (N, 2, 2) and sampled (N, 2, 2) covariance px², and bias (N, 2) px, of the corners mostly found."""
    rng = np.random.default_rng(seed)
    board = draw_board(SHEET, condition, rng, tilt_rad=0.6)
    found, predicted = (
        np.full((draws, SPEC_COVARIANCE.corner_count, 2), np.nan),
        np.full((draws, SPEC_COVARIANCE.corner_count, 2, 2), np.nan),
    )
    for draw in range(draws):
        view = detect_corners(board.picture(rng), SPEC_COVARIANCE)
        found[draw, view.ids] = view.corners_px - board.corners_px[view.ids]
        predicted[draw, view.ids] = view.covariance_px2
    seen = np.isfinite(found[..., 0])
    whole = np.flatnonzero(seen.mean(axis=0) >= 0.95)
    assert len(whole) >= 9
    scatter = np.array([np.cov(found[seen[:, index], index].T) for index in whole])
    return np.nanmean(predicted[:, whole], axis=0), scatter, np.nanmean(found[:, whole], axis=0)


def std_ratio(predicted: np.ndarray, seen: np.ndarray) -> float:
    return float(np.sqrt(np.trace(predicted.sum(axis=0)) / np.trace(seen.sum(axis=0))))


# 25 draws of 20 corners, two coordinates: the sampled standard deviation is good to 2.5 %
@pytest.mark.parametrize("condition", [Conditions(40, 0.5, 2.0), Conditions(60, 1.0, 6.0), Conditions(70, 1.8, 0.7)])
def test_predicted_and_sampled_standard_deviations_agree(condition: Conditions) -> None:
    predicted, seen, _ = sampled(condition, 25)
    assert std_ratio(predicted, seen) == pytest.approx(1.0, abs=0.12)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.7, 2.0, 6.0])
@pytest.mark.parametrize(("square_px", "blur_px"), [(40, 0.5), (40, 1.0), (60, 0.5), (60, 1.0), (90, 2.0)])
def test_they_agree_at_every_noise_blur_and_size(square_px: float, blur_px: float, noise: float) -> None:
    predicted, seen, bias = sampled(Conditions(square_px, blur_px, noise), 100)
    assert std_ratio(predicted, seen) == pytest.approx(1.0, abs=0.1)
    assert np.sqrt((bias**2).sum(axis=1).mean()) < 0.05
