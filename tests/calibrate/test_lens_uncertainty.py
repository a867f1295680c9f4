"""Projection uncertainty against sampled noise, and what halves of the views say of each other."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.boards import BOARD, draw, rigs
from benchmarks.calibration.methods import solve_ours
from targets.board import corner_points
from vbaa_calib.calibrate.lens.board_shape import SHAPE
from vbaa_calib.calibrate.lens.bundle import BoardCorners, Bundle, refine
from vbaa_calib.calibrate.lens.choice import (
    _compare_split_half,
    _held_out_squares,
    _solved_squares,
    information,
    observations_of,
)
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.calibrate.lens.settings import LensSettings
from vbaa_calib.calibrate.lens.uncertainty import (
    compensate,
    pixel_grid,
    projection_jacobian,
    projection_uncertainty,
)

RIG, POINTS = rigs()[0], corner_points(BOARD)
GRID = (5, 4)


def solved(seed: int, count: int):
    """`count` noise draws over one set of poses: intrinsics (count, 9), the mean covariance (9, 9)."""
    given, rng = draw(RIG, seed), np.random.default_rng(seed + 1)
    views = observations_of(given.views, POINTS)
    exact = refine(Bundle.start(RIG.model, RIG.intrinsics, given.poses).poses_only, views)
    clean = [view.pixels - residual for view, residual in zip(views, exact.residuals_px, strict=True)]
    found, covariances = [], []
    for _ in range(count):
        noisy = [
            BoardCorners(view.points_m, pixels + 0.15 * rng.normal(size=pixels.shape))
            for view, pixels in zip(views, clean, strict=True)
        ]
        # poses solved for the noisy corners: the exact ones would be the truth only where no corner moved
        bundle = refine(Bundle.start(RIG.model, RIG.intrinsics, exact.poses), noisy)
        found.append(bundle.intrinsics)
        covariances.append(information(bundle, noisy).covariance[:-SHAPE, :-SHAPE])
    return np.array(found), np.mean(covariances, axis=0)


@pytest.fixture(scope="module")
def samples():
    """Enough draws for a standard deviation to 6 %."""
    return solved(41, 120)


@pytest.mark.parametrize("compensated", [False, True])
def test_predicted_uncertainty_is_that_of_repeated_noise(samples, compensated: bool) -> None:
    """Over the picture, root mean square of the standard deviation within 15 %."""
    found, covariance = samples
    truth = RIG.camera
    camera = dataclasses.replace(truth, covariance=covariance)
    pixels, covariance_px2, _ = projection_uncertainty(camera, compensated, GRID)
    rays, _ = truth.unproject(pixels)
    shifts = []
    for intrinsics in found:
        shift = camera_of(RIG.model, intrinsics, RIG.image_size).project(rays)[0] - pixels
        shifts.append(compensate(truth, pixels, shift[..., None])[..., 0] if compensated else shift)
    sampled = np.sqrt(np.mean(np.var(shifts, axis=0).sum(axis=-1)))
    expected = np.sqrt(np.mean(np.trace(covariance_px2, axis1=-2, axis2=-1)))
    assert sampled / expected == pytest.approx(1.0, abs=0.15)
    each = np.sqrt(np.var(shifts, axis=0).sum(axis=-1) / np.trace(covariance_px2, axis1=-2, axis2=-1))
    assert np.all(np.abs(each - 1.0) < 0.3), "nowhere far off"


def test_pixels_without_a_ray_have_no_uncertainty() -> None:
    folding = np.array([898.7, 901.5, 640.0, 360.0, 0.0101, 0.7388, 0.0005, -0.0005, -2.503])
    camera = dataclasses.replace(camera_of(LENS_MODELS["opencv5"], folding, (1280, 720)), covariance=1e-4 * np.eye(9))
    std = projection_uncertainty(camera)[2]
    assert np.isnan(std[0, 0])
    assert np.isfinite(std[6, 8])


def halves_of(views: list[BoardCorners], poses: np.ndarray) -> tuple[float | None, float | None]:
    """Deviations and p-value."""
    bundle = refine(Bundle.start(RIG.model, RIG.intrinsics, poses), views)
    known = information(bundle, views)
    assert known is not None
    return _compare_split_half(RIG.model, bundle.intrinsics, known, RIG.image_size)


def test_halves_of_two_cameras_do_not_agree() -> None:
    """The second half is shown through a lens of another focal length, zoomed in between."""
    given = draw(RIG, 44)
    views = observations_of(given.views, POINTS)
    deviations, p_value = halves_of(views, given.poses)
    assert p_value > LensSettings.halves_agree
    zoomed = [
        view if index % 2 else BoardCorners(view.points_m, view.pixels + 6e-3 * (view.pixels - RIG.intrinsics[2:4]))
        for index, view in enumerate(views)
    ]
    spoilt, chance = halves_of(zoomed, given.poses)
    assert chance < LensSettings.halves_agree
    assert spoilt > 2.0 * deviations
    assert halves_of(views[:5], given.poses[:5]) == (None, None)


@pytest.mark.slow
def test_halves_of_good_views_differ_as_often_as_chance_has_it() -> None:
    """P-values are uniform, and the deviations' mean square is one."""
    drawn = [draw(RIG, seed) for seed in range(500, 540)]
    found = [halves_of(observations_of(given.views, POINTS), given.poses) for given in drawn]
    deviations, p_values = np.array(found).T
    # forty draws: the share below one half has a standard deviation of 0.08
    assert np.mean(p_values < 0.5) == pytest.approx(0.5, abs=0.2)
    assert np.mean(deviations**2) == pytest.approx(1.0, abs=0.5)
    assert p_values.min() > LensSettings.halves_agree


@pytest.mark.parametrize("index", [0, 2])
def test_one_step_tells_what_views_left_out_would_be_missed_by(index: int) -> None:
    rig = rigs()[index]
    given = draw(rig, 46)
    views = observations_of(given.views, POINTS)
    bundle = refine(Bundle.start(rig.model, rig.intrinsics, given.poses), views)
    known = information(bundle, views)
    anew = _solved_squares(bundle, views)
    assert anew.sum() > known.squares.sum()
    chosen = _held_out_squares(bundle, views, known)
    np.testing.assert_allclose(chosen, anew, rtol=0.02)


@pytest.mark.parametrize(
    ("index", "count", "allowed"),
    [pytest.param(index, 150, 0.05, marks=pytest.mark.slow) for index in range(len(rigs()))],
)
def test_95_per_cent_regions_cover_the_true_projection(index: int, count: int, allowed: float) -> None:
    """Poses, noise, outliers and all drawn anew. Points of one draw hang together, so the share is none too sharp."""
    rig = rigs()[index]
    truth, pixels = rig.camera, pixel_grid(rig.image_size, GRID)
    rays, _ = truth.unproject(pixels)
    covered = []
    for seed in range(3000, 3000 + count):
        camera = solve_ours(draw(rig, seed)).camera
        found = camera.project(rays)[0]
        jacobian = projection_jacobian(camera, found)
        covariance = jacobian @ camera.covariance @ np.swapaxes(jacobian, -1, -2)
        off = (found - pixels)[..., None]
        squares = (np.swapaxes(off, -1, -2) @ np.linalg.solve(covariance, off))[..., 0, 0]
        covered.append(np.mean(squares <= chi2.ppf(0.95, 2)))
    assert np.mean(covered) == pytest.approx(0.95, abs=allowed)
