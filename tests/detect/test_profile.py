"""The measured centreline: against lines drawn here, metal and filtered pictures, colours, and plain least squares."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.profile import measure, measure_ribbon
from vbaa_calib.native import core

from .drawn_lines import SIZE, aside, background, bent, exposed, straight, tube

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


def test_a_bent_thick_line_is_not_drawn_to_the_inside_of_its_bend() -> None:
    """Profiles that run slantwise across a bend see its two flanks at different distances."""
    rng = np.random.default_rng(8)
    for turn_deg in (-70.0, 70.0):
        path = bent((30.0, 120.0 - turn_deg), turn_deg / 2.0, turn_deg)
        line = measure(exposed(background(rng, 1.0) + tube(path, 14.0, 110.0), rng), dense(path), 14.0)
        assert line.seen > 0.8
        assert abs(aside(path, line.points_px).mean()) < 0.008


def test_a_thick_line_that_comes_nearer_is_measured_in_its_middle() -> None:
    """Perspective: it grows ever faster. A profile that crosses it at a slant meets one edge where it is broader."""
    path, fine = straight(-38.0, 240.0), 4
    v, u = (np.mgrid[: fine * SIZE[0], : fine * SIZE[1]] + 0.5) / fine - 0.5
    direction = (path[1] - path[0]) / 240.0
    along = (u - path[0, 0]) * direction[0] + (v - path[0, 1]) * direction[1]
    off = np.abs((v - path[0, 1]) * direction[0] - (u - path[0, 0]) * direction[1])
    covered = (off < 9.0 / (1.0 - 0.55 * np.clip(along / 240.0, 0.0, 1.0)) / 2.0) & (along > 0.0) & (along < 240.0)
    light = cv2.GaussianBlur(60.0 + 120.0 * covered, (0, 0), 0.8 * fine)
    light = light.reshape(SIZE[0], fine, SIZE[1], fine).mean(axis=(1, 3))
    line = measure(exposed(light, np.random.default_rng(1)), path, 14.0)
    share = (line.points_px - path[0]) @ direction / 240.0
    for part in (share < 0.4, share > 0.6):
        assert abs(np.median(aside(path, line.points_px)[part])) < 0.03


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


PER_PX = 32
HALF = 9
AT = np.arange(-(HALF + 2) * PER_PX, (HALF + 2) * PER_PX + 1) / PER_PX
"""(R,) distances at which cross-sections are tabled."""


@pytest.fixture
def image() -> np.ndarray:
    rng = np.random.default_rng(3)
    v, u = np.mgrid[:90, :200]
    ridge = 90.0 * np.exp(-0.5 * ((v - 40.0 - 0.1 * u) / 1.6) ** 2)
    return rng.normal(0.0, 3.0, v.shape) + 40.0 + 0.2 * u - 0.3 * v + ridge


def across(image: np.ndarray, centre: np.ndarray) -> tuple[core.search.Crossings, np.ndarray]:
    """Profiles of a straight path, and the distances (N, T) of their pixels from a line at (N,)."""
    found = core.search.crossings(image, np.array([[12.3, 41.0], [180.0, 58.4]]), HALF, 1.0)
    return found, (found.across - centre[: len(found.along), None]) / found.stretch[:, None]


def at(table: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda distance: np.interp(distance, AT, table)


FINE = 5
Brightness = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Shares of the way (M,), places across from −1 to 1 (M,) → grey levels (M,)."""


def metal(path_px: np.ndarray, width_px: float, brightness: Brightness) -> np.ndarray:
    """(H, W) grey levels of a straight tube along path (2, 2) whose brightness is given, before an even ground."""
    v, u = (np.mgrid[: FINE * SIZE[0], : FINE * SIZE[1]] + 0.5) / FINE - 0.5
    along = (path_px[1] - path_px[0]) / np.linalg.norm(path_px[1] - path_px[0])
    offset = np.stack([u, v], axis=-1) - path_px[0]
    share = offset @ along / np.linalg.norm(path_px[1] - path_px[0])
    across = offset @ np.array([-along[1], along[0]]) / (0.5 * width_px)
    on = (np.abs(across) < 1.0) & (share > 0.0) & (share < 1.0)
    light = np.full(u.shape, 80.0)
    light[on] = brightness(share[on], across[on])
    blurred = cv2.GaussianBlur(light, (0, 0), 0.7 * FINE)
    return blurred.reshape(SIZE[0], FINE, SIZE[1], FINE).mean(axis=(1, 3))


def bright_to_dark(share: np.ndarray, across: np.ndarray) -> np.ndarray:
    """From a glare through the ground's grey to dark, and a highlight at its side that fades, too."""
    glint = np.exp(-0.5 * ((across - 0.45) / 0.25) ** 2)
    return 150.0 - 130.0 * share + 90.0 * (1.0 - share) * glint


def at_its_side(share: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Grey, with a highlight at one side all along it."""
    return 30.0 + 0.0 * share + 150.0 * np.exp(-0.5 * ((across - 0.5) / 0.3) ** 2)


@pytest.mark.parametrize(
    ("brightness", "width_px"), [(bright_to_dark, 3.5), (bright_to_dark, 6.0), (at_its_side, 2.5), (at_its_side, 3.5)]
)
def test_bare_metal_is_measured_between_its_edges(brightness: Brightness, width_px: float) -> None:
    """A symmetric shape that is bright everywhere would lie on the highlight."""
    rng, path = np.random.default_rng(2), straight(12.0, 220.0)
    guide = dense(path) + np.array([0.0, 0.15 * width_px])
    errors, claims, seen = [], [], []
    for _ in range(4):
        line = measure(exposed(metal(path, width_px, brightness), rng), guide, width_px, None)
        assert line.found
        errors.append(aside(path, line.points_px))
        claims.append(line.sigma_px)
        seen.append(line.seen)
    error, claim = np.concatenate(errors), np.concatenate(claims)
    assert np.mean(seen) > 0.8
    assert abs(error.mean()) < 0.06 * width_px
    assert np.sqrt((error**2).mean()) < 1.2 * np.sqrt((claim**2).mean())


@pytest.mark.parametrize("width_px", [2.3, 6.0])
def test_filters_of_a_camera_are_in_the_deviations(width_px: float) -> None:
    """Noise that a filter has made smooth moves neighbours alike, and by more than residuals seem to say."""
    rng, alone, together = np.random.default_rng(5), [], []
    for index in range(8):
        path = straight(4.0 + 7.0 * index, 200.0)
        light = 60.0 + tube(path, width_px, 110.0)
        noise = 4.0 * cv2.GaussianBlur(rng.normal(0.0, 1.0, SIZE), (0, 0), 1.0)
        line = measure(np.rint(light + noise), dense(path) + 0.5, width_px)
        error = aside(path, line.points_px)
        alone.append((error**2).mean() / (line.sigma_px**2).mean())
        runs = len(error) // 20 * 20
        of_runs = error[:runs].reshape(-1, 20).mean(axis=1)
        expected = (line.effective_px[:runs] ** 2).reshape(-1, 20).mean(axis=1) / 20.0
        together.append((of_runs**2).mean() / expected.mean())
        assert (line.effective_px >= line.sigma_px).all()
    assert np.sqrt(np.mean(alone)) == pytest.approx(1.0, abs=0.15)
    assert 0.5 < np.sqrt(np.mean(together)) < 1.25


def in_colour(cover: np.ndarray, ground: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) of an antenna of one colour that covers so much (H, W) of a ground (H, W, 3)."""
    light = ground + cover[..., None] * (np.array([150.0, 120.0, 90.0]) - ground)
    return np.stack([exposed(channel, rng, 1.5) for channel in np.moveaxis(light, -1, 0)], axis=-1)


@pytest.mark.parametrize("width_px", [2.5, 4.0, 9.0])
@pytest.mark.parametrize("patched", [False, True])
def test_lines_are_where_and_as_sure_as_they_say(width_px: float, patched: bool) -> None:
    """Before one background, and before patches here darker, there brighter, on either side their own."""
    rng, errors, claims = np.random.default_rng(int(10 * width_px)), [], []
    for _ in range(4):
        path = bent((40.0, 100.0 + rng.uniform(0, 1)), rng.uniform(-5, 10), rng.uniform(0, 30))
        ground = np.full((*SIZE, 3), 60.0)
        if patched:
            for begin in range(0, SIZE[1], 45):
                ground[:, begin : begin + 45] = rng.uniform(20.0, 230.0, 3)
        picture = in_colour(tube(path, width_px, 1.0), ground, rng)
        line = measure_ribbon(picture, dense(path) + 0.4, width_px)
        assert line.found
        assert line.seen > 0.9
        errors.append(aside(path, line.points_px))
        claims.append(line.sigma_px)
    error, claim = np.concatenate(errors), np.concatenate(claims)
    assert np.sqrt((error**2).mean()) < 0.05
    assert 0.4 < np.sqrt((error**2).mean() / (claim**2).mean()) < 1.4


@pytest.mark.parametrize("brightness", [bright_to_dark, at_its_side])
def test_a_highlight_at_its_side_does_not_pull_the_line(brightness) -> None:
    rng, path, width_px = np.random.default_rng(2), straight(12.0, 220.0), 5.0
    light = metal(path, width_px, brightness)
    picture = np.stack([exposed(light, rng) for _ in range(3)], axis=-1)
    line = measure_ribbon(picture, dense(path) + np.array([0.0, 0.15 * width_px]), width_px)
    assert line.found
    assert abs(aside(path, line.points_px).mean()) < 0.04 * width_px


def test_what_hides_it_leaves_a_gap() -> None:
    rng, path = np.random.default_rng(4), straight(10.0)
    picture = in_colour(tube(path, 4.0, 1.0), np.full((*SIZE, 3), 60.0), rng)
    picture[:, 140:175] = np.rint(90.0 + rng.normal(0.0, 1.5, (SIZE[0], 35, 3)))
    u = measure_ribbon(picture, dense(path) + 0.5, 4.0).points_px[:, 0]
    assert not ((u > 142) & (u < 173)).any()
    assert ((u < 135).sum() > 50) & ((u > 180).sum() > 50)


@pytest.mark.parametrize("transposed", [False, True])
def test_noise_of_whole_rows_is_in_the_deviations_of_a_line_along_them(transposed: bool) -> None:
    """A row's noise moves all points on it alike: the mean of a line is as far off as its deviations say, no less."""
    rng, ratios = np.random.default_rng(8), []
    for index in range(16):
        path = straight(0.25 + 0.25 * (index % 8), 200.0)
        noise = rng.normal(0.0, 1.5, SIZE) + rng.normal(0.0, 1.5, (SIZE[0], 1))
        light, guide = np.rint(60.0 + tube(path, WIDTH_PX, 110.0) + noise), dense(path) + 0.2
        line = measure(light.T.copy() if transposed else light, guide[:, ::-1] if transposed else guide, WIDTH_PX)
        error = aside(path, line.points_px[:, ::-1] if transposed else line.points_px)
        weight = np.hypot(line.effective_px, line.row_px) ** -2.0
        ratios.append(error @ weight / np.sqrt(weight.sum()))
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5
