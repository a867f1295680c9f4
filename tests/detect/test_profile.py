"""The measured centreline against lines drawn here: bias, honest deviations, gaps, edges, and no line at all."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.detect.whisker.profile import measure

from .drawn_lines import SIZE, aside, background, bent, exposed, straight, trace, tube

WIDTH_PX = 2.3


def dense(path_px: np.ndarray) -> np.ndarray:
    """(K, 2) a polyline with a point every two pixels."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path_px, axis=0), axis=1))])
    at = np.arange(0.0, along[-1], 2.0)
    return np.stack([np.interp(at, along, path_px[:, axis]) for axis in (0, 1)], axis=1)


def measured(path_px: np.ndarray, rng: np.random.Generator, off_px: float = 0.7, **changes: float) -> Centreline:
    """A line drawn on clutter and measured along a guide that lies a little aside."""
    picture = background(rng, changes.get("clutter", 2.0)) + tube(path_px, WIDTH_PX, changes.get("height", 110.0))
    return measure(exposed(picture, rng, changes.get("noise", 1.5)), dense(path_px) + np.array([0.0, off_px]), WIDTH_PX)


@pytest.mark.parametrize("angle_deg", [0.4, 7.0, 30.0, 45.0, 60.0, 90.0, 133.0, 180.0, 271.0])
def test_straight_lines_at_any_angle(angle_deg: float) -> None:
    line = measured(straight(angle_deg), np.random.default_rng(int(angle_deg * 10)))
    assert line.found
    assert line.seen > 0.9
    error = aside(straight(angle_deg), line.points_px)
    assert abs(error.mean()) < 0.02
    assert np.abs(error).max() < 0.25
    along = line.points_px @ np.diff(straight(angle_deg), axis=0)[0]
    assert (np.diff(along) > 0).all(), "ordered from clamp to tip"


def test_bias_and_spread_over_many_lines() -> None:
    """No bias, and the deviations that are claimed, also where the line's own light brings the noise."""
    rng = np.random.default_rng(1)
    errors, claims = [], []
    for index in range(12):
        path = bent((40.0, 60.0 + rng.uniform(0, 1)), rng.uniform(-5, 20), rng.uniform(0, 50))
        light = background(rng, 1.0) + tube(path, WIDTH_PX, rng.uniform(60, 150))
        shot = np.sqrt(1.0 + light / 25.0) if index % 2 else 1.8
        line = measure(exposed(light + rng.normal(0, 1, SIZE) * shot, rng, 0.0), dense(path) + 0.5, WIDTH_PX)
        assert line.found
        errors.append(aside(path, line.points_px))
        claims.append(line.sigma_px)
    assert abs(np.concatenate(errors).mean()) < 0.005
    ratio = [np.std(error) / np.sqrt((claim**2).mean()) for error, claim in zip(errors, claims, strict=True)]
    assert min(ratio) > 0.7
    assert max(ratio) < 1.3
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.1)
    assert np.sqrt((np.concatenate(claims) ** 2).mean()) < 0.06


@pytest.mark.parametrize("width_px", [1.2, 4.0, 8.0, 16.0])
def test_thin_and_thick_lines(width_px: float) -> None:
    """A thick tube is no Gaussian: its cross-section is learned, and the deviations are right within 20 %."""
    rng = np.random.default_rng(2)
    path = bent((40.0, 60.0), 5.0, 30.0)
    line = measure(exposed(background(rng, 1.0) + tube(path, width_px, 110.0), rng), dense(path) + 0.5, width_px)
    assert line.seen > 0.9
    assert line.breadth == pytest.approx(1.1, abs=0.2)
    error = aside(path, line.points_px)
    assert abs(error.mean()) < 0.02
    assert 0.8 < np.std(error) / line.sigma_px.mean() < 1.2


def test_a_dark_line_on_a_bright_ground() -> None:
    rng = np.random.default_rng(3)
    path = straight(20.0)
    picture = exposed(background(rng, 1.0) + 120.0 - tube(path, WIDTH_PX, 90.0), rng)
    line = measure(picture, dense(path) + 0.5, WIDTH_PX, bright=False)
    assert line.seen > 0.9
    assert abs(aside(path, line.points_px).mean()) < 0.02
    assert not measure(picture, dense(path) + 0.5, WIDTH_PX, bright=True).found


@pytest.mark.parametrize("brightness", [20.0, 180.0])
def test_what_hides_the_antenna_leaves_a_gap_and_draws_nothing_aside(brightness: float) -> None:
    rng = np.random.default_rng(4)
    path = straight(10.0)
    picture = background(rng, 1.0) + tube(path, WIDTH_PX, 110.0)
    picture[:, 140:175] = brightness
    line = measure(exposed(picture, rng), dense(path) + 0.5, WIDTH_PX)
    u = line.points_px[:, 0]
    assert not ((u > 140) & (u < 174)).any()
    assert ((u < 135).sum() > 50) & ((u > 180).sum() > 50)
    assert np.abs(aside(path, line.points_px)).max() < 0.25


def test_noise_and_clutter_are_no_antenna() -> None:
    """The whole way, path and measurement, over pictures of everything but an antenna."""
    found = []
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        picture = exposed(background(rng, rng.uniform(0.0, 20.0)), rng, rng.uniform(0.5, 4.0))
        axis = dense(straight(rng.uniform(-30, 30), 230.0))
        where = Corridor(axis, 8.0 + 0.6 * np.linspace(0.0, 230.0, len(axis)), WIDTH_PX)
        line = measure(picture, trace(picture, where), WIDTH_PX)
        if line.found:
            found.append((seed, line.seen))
    assert not found


def test_a_bent_thick_line_is_not_drawn_to_the_inside_of_its_bend() -> None:
    """Profiles that run slantwise across a bend see its two flanks at different distances."""
    rng = np.random.default_rng(8)
    for turn_deg in (-70.0, 70.0):
        path = bent((30.0, 120.0 - turn_deg), turn_deg / 2.0, turn_deg)
        line = measure(exposed(background(rng, 1.0) + tube(path, 14.0, 110.0), rng), dense(path), 14.0)
        assert line.seen > 0.8
        assert abs(aside(path, line.points_px).mean()) < 0.008


def test_one_phase_on_the_pixel_grid_does_not_shift_the_line() -> None:
    """Every profile alike: a free shape could explain any shift."""
    rng = np.random.default_rng(9)
    for offset in (0.0, 0.2, 0.4, 0.6, 0.8):
        path = straight(0.0, middle=(158.0, 119.0 + offset))
        picture = background(rng, 0.0) + tube(path, WIDTH_PX, 110.0, blur_px=1.2)
        line = measure(exposed(picture, rng), dense(path) + np.array([0.0, 0.4]), WIDTH_PX)
        assert abs(aside(path, line.points_px).mean()) < 0.02


@pytest.mark.parametrize("beside_px", [-1.0, 2.0])
def test_an_objects_edge_along_the_antenna_is_doubt(beside_px: float) -> None:
    """It draws all points along it the same way, which the profiles' residuals hardly show."""
    rng = np.random.default_rng(17)
    path = straight(4.0)
    along = np.diff(path, axis=0)[0] / np.linalg.norm(np.diff(path, axis=0))
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    offset = np.stack([u, v], axis=-1) - path.mean(axis=0)
    behind, half_way = offset @ np.array([-along[1], along[0]]) > beside_px, offset @ along > 0.0
    light = 60.0 + cv2.GaussianBlur(np.where(behind & half_way, 12.0, 0.0), (0, 0), 0.8)
    runs = []
    for _ in range(6):
        picture = exposed(light + tube(path, WIDTH_PX, 110.0), rng, 2.5)
        line = measure(picture, dense(path) + 0.5, WIDTH_PX)
        error = aside(path, line.points_px)
        beside = (line.points_px - path.mean(axis=0)) @ along
        runs.append([(error[where], line.sigma_px[where]) for where in (beside < -15.0, beside > 15.0)])
    clear, along_edge = ([np.concatenate([run[place][kind] for run in runs]) for kind in (0, 1)] for place in (0, 1))
    assert np.std(clear[0]) / clear[1].mean() == pytest.approx(1.0, abs=0.1)
    assert len(along_edge[0]) > 300
    assert abs(along_edge[0].mean()) < along_edge[1].mean()


def test_a_line_that_an_inclined_camera_sees_broader_at_one_end_is_as_good_as_it_says() -> None:
    """Three to five px wide, from one end to the other."""
    rng, path = np.random.default_rng(11), dense(straight(5.0))
    starts = range(0, len(path) - 1, 3)
    widths = np.linspace(3.0, 5.0, len(starts))
    pieces = [tube(path[start : start + 4], width, 150.0) for start, width in zip(starts, widths, strict=True)]
    line = measure(exposed(60.0 + np.max(pieces, axis=0), rng), path, 4.0)
    error = aside(straight(5.0), line.points_px)
    assert line.seen > 0.93
    assert 0.75 < np.sqrt(np.mean((error / line.sigma_px) ** 2)) < 1.25
