"""Outlier corners, bent boards and lenses that would fold: found where they are, left alone where they are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from benchmarks.boards import BOARD, Rig, draw, error_mm, rigs
from benchmarks.calibration.methods import kept_corners, screening, solve_oracle, solve_ours
from targets.board import corner_points
from vbaa_calib.calibrate.lens.board_shape import ShapePrior
from vbaa_calib.calibrate.lens.bundle import BoardCorners, Bundle, polished, refine
from vbaa_calib.calibrate.lens.choice import information, observations_of
from vbaa_calib.calibrate.lens.homography import homography
from vbaa_calib.calibrate.lens.initialization import rough_lens, unfolded, widened
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of, is_monotonic, rational_like
from vbaa_calib.calibrate.lens.models import _corner_radius as corner_radius

from .synthetic_views import projection

RIGS, POINTS = rigs(), corner_points(BOARD)
SPOILT = RIGS[4]
WIDE_PRIOR = ShapePrior(np.zeros(5), np.array([0.1, 0.1, 0.1, 1.0, 1.0]))


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
        assert caught in (None, 1.0)
        assert bool(solution.board_shape.findings) == any(rig.sagittas_m)
    assert np.median(errors) <= 1.05 * np.median(oracle)


def test_outliers_and_bend_are_reported() -> None:
    given = draw(SPOILT, 31)
    solution = solve_ours(given, "auto")
    shape = solution.board_shape
    assert np.all(np.abs(shape.parameters - [*SPOILT.sagittas_m, 0.0, 0.0, 0.0]) < 4 * shape.std)
    assert np.all(shape.std[:3] < 5e-5)
    assert len(shape.findings) == 1
    for view, good, used in zip(given.views, given.good, solution.views, strict=True):
        assert set(view.ids[~good]) == set(used.outlier_ids)
        assert used.left_out == len(used.outlier_ids)
        assert used.corners == good.sum()
    assert "bowed along x" in solution.verdict.words
    assert solution.rms_inliers_px == pytest.approx(0.15 * np.sqrt(2), rel=0.05)


def test_the_shape_scatters_as_predicted() -> None:
    given, rng = draw(RIGS[0], 35), np.random.default_rng(36)
    start = Bundle.start(RIGS[0].model, RIGS[0].intrinsics, given.poses)
    clean = observations_of(given.views, POINTS)
    exact = refine(start.poses_only, clean)
    base = [v.pixels - r for v, r in zip(clean, exact.residuals_px, strict=True)]
    found, predicted = [], []
    for _ in range(60):
        noisy = [
            BoardCorners(v.points_m, pixels + 0.15 * rng.normal(size=pixels.shape), v.deformation)
            for v, pixels in zip(clean, base, strict=True)
        ]
        bundle = refine(start.freed(square_pixels=False, prior=WIDE_PRIOR), noisy)
        known = information(bundle, noisy)
        found.append(bundle.shape)
        predicted.append(np.diag(known.covariance)[-5:])
    assert np.std(found, axis=0) / np.sqrt(np.mean(predicted, axis=0)) == pytest.approx(np.ones(5), abs=0.3)


def test_a_lens_that_folds_among_the_corners_stays() -> None:
    """No pull is strong enough to hide that a model is wrong."""
    given = draw(RIGS[2], 2)
    model, observations = LENS_MODELS["opencv5"], observations_of(given.views, POINTS)
    bundle = refine(rough_lens(model, observations, RIGS[2].image_size), observations)
    assert not is_monotonic(model, bundle.intrinsics, RIGS[2].image_size)
    again = unfolded(bundle, observations, RIGS[2].image_size)
    assert again is bundle


WIDE = rigs()[2]
FISHEYE = np.array([520.0, 521.0, 641.0, 358.0, 0.05, -0.01, 0.003, -0.001])


def test_a_homography_is_found_under_outliers() -> None:
    rng = np.random.default_rng(4)
    points = POINTS[:, :2]
    truth = np.array([[0.9, 0.1, 0.02], [-0.2, 1.1, 0.05], [0.3, -0.4, 1.0]])
    image = np.column_stack([points, np.ones(len(points))]) @ truth.T
    image = image[:, :2] / image[:, 2:]
    image[rng.permutation(len(points))[: int(0.4 * len(points))]] += rng.uniform(0.05, 0.2, 2)
    found = homography(points, image)
    np.testing.assert_allclose(found[0] / found[0][2, 2], truth, atol=1e-9)
    assert homography(points[:3], image[:3]) is None


def test_a_rational_lens_follows_a_fisheye_over_the_picture() -> None:
    size = (1280, 720)
    alike = rational_like(LENS_MODELS["fisheye"], FISHEYE, size)
    assert alike is not None
    assert is_monotonic(LENS_MODELS["rational"], alike, size)
    # richer ones begin as that, although their next simpler lens is a rational one
    wide = widened(LENS_MODELS["fisheye"], FISHEYE, LENS_MODELS["tilted"], size)
    np.testing.assert_array_equal(wide, [*alike, *np.zeros(6)])
    given, like = camera_of(LENS_MODELS["fisheye"], FISHEYE, size), camera_of(LENS_MODELS["rational"], alike, size)
    corners = np.array([[0.0, 0.0], [1279.0, 719.0], [640.0, 0.0], [900.0, 500.0]])
    rays, valid = given.unproject(corners)
    assert valid.all()
    assert np.abs(like.project(rays)[0] - corners).max() < 3.0
    assert corner_radius(FISHEYE, size) > np.hypot(640.0, 360.0) / 521.0
    too_wide = FISHEYE * np.array([0.4, 0.4, 1, 1, 1, 1, 1, 1])
    assert rational_like(LENS_MODELS["fisheye"], too_wide, size) is None


@pytest.mark.parametrize(
    "seed", [1, 102, pytest.param(104, marks=pytest.mark.slow), pytest.param(115, marks=pytest.mark.slow)]
)
def test_draws_whose_plain_fit_folds_are_solved_without(seed: int) -> None:
    given = draw(WIDE, seed)
    assert solve_oracle(given).valid_region().image_fraction < 1.0
    solution = solve_ours(given)
    assert solution.camera.valid_region().image_fraction == 1.0
    # as good as the fit that folds, but for what a few parameters explain
    assert solution.rms_px < 0.15 * np.sqrt(2.0) * 1.02


def test_a_homography_is_the_least_squares_one() -> None:
    rng, points = np.random.default_rng(5), POINTS[:, :2]
    image = np.column_stack([points, np.ones(len(points))]) @ np.array(
        [[0.9, 0.1, 0.0], [-0.2, 1.1, 0.1], [0.3, -0.4, 1]]
    )
    image = image[:, :2] / image[:, 2:] + 1e-4 * rng.uniform(-1.0, 1.0, (len(points), 2))

    def normalised(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        scale = np.sqrt(2.0 / np.mean(np.sum((where - where.mean(axis=0)) ** 2, axis=1)))
        by = np.array([[scale, 0.0, 0.0], [0.0, scale, 0.0], [0.0, 0.0, 1.0]])
        by[:2, 2] = -scale * where.mean(axis=0)
        return np.column_stack([where, np.ones(len(where))]) @ by.T, by

    (board, by_board), (seen, by_image) = normalised(points), normalised(image)
    zero = np.zeros_like(board)
    design = np.vstack(
        [np.hstack([board, zero, -seen[:, :1] * board]), np.hstack([zero, board, -seen[:, 1:2] * board])]
    )
    expected = np.linalg.inv(by_image) @ np.linalg.svd(design)[2][-1].reshape(3, 3) @ by_board
    found = homography(points, image)
    assert found is not None
    np.testing.assert_allclose(found[0] / found[0][2, 2], expected / expected[2, 2], rtol=1e-7, atol=1e-9)


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
