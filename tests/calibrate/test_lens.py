"""The lens: outliers, bent boards and others' corners, its choice, and what its uncertainty is worth."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from benchmarks.boards import BOARD, Rig, draw, error_mm, rigs
from benchmarks.calibration import kept_corners, screening, solve_oracle, solve_ours
from targets.board import corner_points
from vbaa_calib import calibrate_lens
from vbaa_calib.calibrate.lens.board_shape import SHAPE
from vbaa_calib.calibrate.lens.bundle import BoardCorners, Bundle, polished, refine
from vbaa_calib.calibrate.lens.choice import _left_out_squares, _solved_squares, information, observations_of
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.calibrate.lens.uncertainty import compensate, pixel_grid, projection_jacobian, projection_uncertainty
from vbaa_calib.calibrate.pipeline import first_solved, next_lenses
from vbaa_calib.core.errors import Diagnosis, InputError

from .synthetic_views import projection

RIGS, POINTS = rigs(), corner_points(BOARD)


@pytest.mark.parametrize(
    ("rig", "draws"),
    [
        # the ratio of one draw scatters by a third
        pytest.param(rig, 20, id=rig.name, marks=pytest.mark.slow)
        if rig in RIGS[1:4]
        else pytest.param(rig, 3, id=rig.name)
        for rig in RIGS
    ],
)
def test_within_five_per_cent_of_the_oracle(rig: Rig, draws: int) -> None:
    errors, oracle = [], []
    for seed in range(21, 21 + draws):
        given = draw(rig, seed)
        solution = solve_ours(given)
        errors.append(error_mm(solution.camera, rig.camera))
        oracle.append(error_mm(solve_oracle(given), rig.camera))
        lost, caught, views = screening(kept_corners(solution, given), given)
        assert views == 0.0
        assert lost <= 0.005
        assert np.isnan(caught) or caught == 1.0
        assert bool(solution.board_shape.findings) == any(rig.sagittas_m)
    assert np.median(errors) <= 1.05 * np.median(oracle)


@pytest.mark.parametrize("name", ["opencv5", "fisheye"])
def test_the_bundle_ends_where_scipys_does(name: str) -> None:
    model, rng, views = LENS_MODELS[name], np.random.default_rng(6), 5
    lens = np.array([700.0, 705.0, 640.0, 360.0, *(0.05, -0.02, 0.002, -0.001, 0.004)[: model.distortion_count]])
    poses = np.column_stack(
        [rng.uniform(-0.5, 0.5, (views, 3)), rng.uniform(-0.1, 0.0, (views, 2)), np.full(views, 0.3)]
    )
    seen = [projection(model.camera_model, POINTS, pose, lens)[0] for pose in poses]
    seen = [pixels + 0.2 * rng.normal(size=pixels.shape) for pixels in seen]

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        own, turns = unknowns[: len(lens)], unknowns[len(lens) :].reshape(views, 6)
        pairs = zip(seen, turns, strict=True)
        return np.concatenate([(projection(model.camera_model, POINTS, p, own)[0] - px).ravel() for px, p in pairs])

    start = np.concatenate([lens, poses.ravel()])
    expected = least_squares(
        residuals, start, method="lm", x_scale=np.maximum(np.abs(start), 1e-2), ftol=1e-15, xtol=1e-15
    )
    views_px = [BoardCorners(POINTS, pixels) for pixels in seen]
    found = polished(refine(Bundle.start(model, lens * 1.01, poses), views_px), views_px)
    assert np.sum(np.concatenate(found.residuals_px) ** 2) <= 2.0 * expected.cost * (1.0 + 1e-9)
    np.testing.assert_allclose(np.concatenate(found.residuals_px).ravel(), -expected.fun, atol=5e-4)


RIG, POINTS_UNCERTAINTY = rigs()[0], corner_points(BOARD)
GRID = (5, 4)


def solved(seed: int, count: int):
    """`count` noise draws over one set of poses: intrinsics (count, 9), the mean covariance (9, 9)."""
    given, rng = draw(RIG, seed), np.random.default_rng(seed + 1)
    views = observations_of(given.views, POINTS_UNCERTAINTY)
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


@pytest.mark.parametrize("index", [0, 2])
def test_one_step_tells_what_views_left_out_would_be_missed_by(index: int) -> None:
    rig = rigs()[index]
    given = draw(rig, 46)
    views = observations_of(given.views, POINTS_UNCERTAINTY)
    bundle = refine(Bundle.start(rig.model, rig.intrinsics, given.poses), views)
    known = information(bundle, views)
    anew = _solved_squares(bundle, views)
    assert anew.sum() > known.squares.sum()
    chosen = _left_out_squares(bundle, views, known)
    np.testing.assert_allclose(chosen, anew, rtol=0.02)


def test_the_covariance_has_room_for_the_lens_that_was_passed_over() -> None:
    """A principal point off by ten deviations is within one then, and the same lens changes nothing."""
    rig = rigs()[0]
    given = draw(rig, 46)
    bundle = refine(Bundle.start(rig.model, rig.intrinsics, given.poses), observations_of(given.views, POINTS))
    known = information(bundle, observations_of(given.views, POINTS))
    assert known is not None
    corners = np.concatenate([view.corners_px for view in given.views])
    lens = camera_of(rig.model, bundle.intrinsics, rig.image_size)
    np.testing.assert_allclose(known.covariance_with(lens, lens, corners), known.covariance, rtol=1e-6)
    moved = bundle.intrinsics + 10.0 * np.sqrt(known.covariance[3, 3]) * (np.arange(len(bundle.intrinsics)) == 3)
    other = camera_of(rig.model, moved, rig.image_size)
    covariance = known.covariance_with(other, lens, corners)
    assert covariance[3, 3] == pytest.approx(101.0 * known.covariance[3, 3], rel=0.1)
    assert np.linalg.eigvalsh(covariance - known.covariance).min() > -1e-9 * np.abs(covariance).max()


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


RIG_LENS = rigs()[4]
POINTS_LENS = corner_points(BOARD)


def test_corners_of_others_give_the_lens_their_outliers_and_the_boards_shape() -> None:
    given = draw(RIG_LENS, 3)
    views = [(view.ids.tolist(), view.corners_px.tolist()) for view in given.views]
    # one view of nothing, one of another board
    views[4:4] = [([], []), (given.views[0].ids[::-1], given.views[0].corners_px)]
    solution = calibrate_lens(views, RIG_LENS.image_size, POINTS_LENS)
    assert error_mm(solution.camera, RIG_LENS.camera, from_jig=True) < 0.01
    own = [*solution.outliers[:4], *solution.outliers[6:]]
    for view, good, outliers in zip(given.views, given.good, own, strict=True):
        assert set(outliers) == set(view.ids[~good])
    assert len(solution.outliers[4]) == 0
    true_m = RIG_LENS.board_points_m
    assert np.abs(solution.board_points - true_m).max() < 0.3 * np.abs(POINTS_LENS - true_m).max()
    assert solution.camera.covariance is not None
    assert solution.trusted == (solution.grade == "trusted")


SEEN = ([0, 1, 2, 3, 10, 11, 12, 13], np.arange(16.0).reshape(8, 2) ** 1.5)


@pytest.mark.parametrize(
    ("views", "size", "points", "model"),
    [
        ([], (640, 480), POINTS_LENS, "auto"),
        ([SEEN] * 4, (640, 480), POINTS_LENS, "opencv6"),
        ([SEEN] * 4, (640, -480), POINTS_LENS, "auto"),
        ([SEEN] * 4, (640, 480), POINTS_LENS * np.nan, "auto"),
        ([SEEN] * 4, (640, 480), POINTS_LENS[:, [0, 2, 1]], "auto"),
        ([([0, 0], [[1, 2], [3, 4]])] * 4, (640, 480), POINTS_LENS, "auto"),
        ([([0, 999], [[1, 2], [3, 4]])] * 4, (640, 480), POINTS_LENS, "auto"),
        ([([0, 1], [[1, 2], [3, np.inf]])] * 4, (640, 480), POINTS_LENS, "auto"),
    ],
)
def test_senseless_corners_are_refused_in_a_line(views, size, points, model) -> None:
    with pytest.raises(InputError) as refused:
        calibrate_lens(views, size, points, model)
    assert "\n" not in str(refused.value)


VIEWS = draw(rigs()[0], 1).views


@cache
def lenses() -> tuple[LensSolution, ...]:
    first = solve_intrinsics(VIEWS, BOARD)
    return first, *next_lenses(first, VIEWS, BOARD)


def first(solve: Callable[[LensSolution], str], *causes: Diagnosis) -> str:
    return first_solved(lenses()[0], lambda: lenses()[1:], solve, lambda: causes)
