"""Predicted corner covariance against the scatter of corners in many noisy pictures of the same board."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.special import erf

from targets.board import BoardSpec
from vbaa_calib.detect.board.corners import detect_corners
from vbaa_calib.detect.board.covariance import QUANTISATION, corner_covariances
from vbaa_calib.detect.board.covariance import _measure_noise as measure_noise
from vbaa_calib.simulate.render.board import print_sheet

from .drawn_boards import Conditions, draw_board

SPEC = BoardSpec(6, 5, 0.02, 0.012)
SHEET = print_sheet(SPEC)
STOP = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-4)


def sampled(condition: Conditions, draws: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predicted (N, 2, 2) and sampled (N, 2, 2) covariance px², and bias (N, 2) px, of the corners mostly found."""
    rng = np.random.default_rng(seed)
    board = draw_board(SHEET, condition, rng, tilt_rad=0.6)
    found, predicted = np.full((draws, SPEC.corner_count, 2), np.nan), np.full((draws, SPEC.corner_count, 2, 2), np.nan)
    for draw in range(draws):
        view = detect_corners(board.picture(rng), SPEC)
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


def test_bias_outweighs_noise_in_sharp_pictures() -> None:
    """What the covariance leaves out, as its docstring says: corners are off by the same in every picture."""
    predicted, _, bias = sampled(Conditions(60, 0.5, 1.0), 8)
    std_px = np.sqrt(np.trace(predicted, axis1=1, axis2=2).mean())
    bias_px = np.sqrt((bias**2).sum(axis=1).mean())
    assert 0.008 < bias_px < 0.02
    assert std_px < bias_px


def crossing(angle_rad: float, turn_rad: float, centre: np.ndarray, blur_px: float) -> np.ndarray:
    """(81, 81) grey levels where two straight edges cross at an angle, drawn without the simulator."""
    grid = np.stack(np.meshgrid(np.arange(81.0), np.arange(81.0)), axis=-1) - centre
    sides = []
    for direction in (turn_rad - angle_rad / 2, turn_rad + angle_rad / 2):
        distance = grid @ np.array([-np.sin(direction), np.cos(direction)])
        sides.append(erf(distance / (blur_px * np.sqrt(2.0))))
    return 120.0 + 80.0 * sides[0] * sides[1]


@pytest.mark.parametrize("turn_rad", [0.3, 2.5])
def test_an_acute_corner_is_uncertain_along_its_point(turn_rad: float) -> None:
    rng, centre, window = np.random.default_rng(0), np.array([40.3, 39.8]), 8
    grey = crossing(np.radians(50.0), turn_rad, centre, 1.2)
    found, predicted = [], []
    for _ in range(400):
        picture = np.clip(np.rint(grey + rng.normal(0.0, 3.0, grey.shape)), 0, 255).astype(np.uint8)
        start = centre.astype(np.float32).reshape(1, 1, 2)
        corner = cv2.cornerSubPix(picture, start, (window, window), (-1, -1), STOP).reshape(1, 2).astype(float)
        found.append(corner[0])
        predicted.append(corner_covariances(picture, corner, np.array([window]))[0])
    seen, mean = np.cov(np.array(found).T), np.mean(predicted, axis=0)
    np.testing.assert_allclose(np.linalg.eigvalsh(mean), np.linalg.eigvalsh(seen), rtol=0.25)
    longest = np.linalg.eigh(mean)[1][:, 1]
    assert abs(longest @ [np.cos(turn_rad), np.sin(turn_rad)]) > 0.98
    assert np.linalg.eigvalsh(mean)[1] > 2.5 * np.linalg.eigvalsh(mean)[0]


def test_noise_is_measured_in_black_and_in_white() -> None:
    rng, centre = np.random.default_rng(0), np.array([[40.3, 39.8]])
    grey = crossing(np.radians(85.0), 0.4, centre[0], 1.0)
    variance = 1.0 + 0.08 * grey
    noisy = (grey + rng.normal(size=grey.shape) * np.sqrt(variance) for _ in range(12))
    pictures = [np.clip(np.rint(each), 0, 255).astype(np.uint8) for each in noisy]
    measured = [measure_noise(picture, centre, np.array([10])) for picture in pictures]
    levels, variances = np.mean(measured, axis=0)
    assert levels == pytest.approx([40.0, 200.0], abs=2.5)
    assert variances == pytest.approx(1.0 + 0.08 * np.array([40.0, 200.0]) + QUANTISATION, rel=0.25)


def test_a_picture_without_noise_is_still_rounded() -> None:
    centre = np.array([[40.3, 39.8]])
    picture = np.rint(crossing(np.radians(85.0), 0.4, centre[0], 1.0)).astype(np.uint8)
    assert measure_noise(picture, centre, np.array([8]))[1] == pytest.approx(QUANTISATION, rel=0.5)
    covariance = corner_covariances(picture, centre, np.array([8]))[0]
    assert 0.0 < np.sqrt(np.trace(covariance)) < 0.01


def test_windows_without_a_corner_give_their_own_size() -> None:
    flat = np.full((60, 60), 90, np.uint8)
    edge = flat.copy()
    edge[:, 30:] = 200
    for picture in (flat, edge):
        covariance = corner_covariances(picture, np.array([[29.5, 30.0], [0.0, 59.0]]), np.array([6, 3]))
        assert np.isfinite(covariance).all()
        assert np.linalg.eigvalsh(covariance)[:, 1] == pytest.approx([36.0, 9.0], rel=1e-6)
    assert corner_covariances(flat, np.zeros((0, 2)), np.zeros(0, int)).shape == (0, 2, 2)
