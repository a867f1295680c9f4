"""The lens from corners that are exactly known, from real photos beside their references, and from the command line."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from targets.board import corner_points
from vbaa_calib.calibrate.lens.board_shape import SHAPE
from vbaa_calib.calibrate.lens.bundle import BoardCorners, Bundle, refine
from vbaa_calib.calibrate.lens.choice import information, observations_of
from vbaa_calib.calibrate.lens.initialization import rough_lens
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import BoardView

from .photo_sets import detected
from .synthetic_views import SPEC, pose_towards, views_of

SIZE = (1280, 960)
LENSES = {
    "none": np.array([1500.0, 1480.0, 655.0, 470.0]),
    "radial": np.array([1500.0, 1480.0, 655.0, 470.0, -0.21, 0.08, 0.0, 0.0]),
    "opencv4": np.array([1500.0, 1480.0, 655.0, 470.0, -0.21, 0.08, 1e-3, -8e-4]),
    "opencv5": np.array([900.0, 905.0, 630.0, 485.0, -0.25, 0.1, 1e-3, -8e-4, -0.02]),
    "rational": np.array([600.0, 602.0, 645.0, 476.0, 0.3, 0.05, 4e-4, -6e-4, 0.002, 0.65, 0.12, 0.01]),
    "fisheye": np.array([520.0, 521.0, 641.0, 478.0, 0.05, -0.01, 0.003, -0.001]),
}


def views_through(name: str, seed: int, count: int = 16, sigma_px: float = 0.0) -> list[BoardView]:
    rng = np.random.default_rng(seed)
    lens = LENSES[name]
    # the board fills about half the picture's width
    distance = 0.1 * lens[0] / (0.5 * SIZE[0])
    poses = [pose_towards(rng, distance, 0.8, offset=0.3 * SIZE[0] / lens[0]) for _ in range(count)]
    return views_of(LENS_MODELS[name], lens, SIZE, poses, rng, sigma_px)


@pytest.mark.parametrize("name", LENSES)
def test_exact_corners_give_the_exact_lens(name: str) -> None:
    solution = solve_intrinsics(views_through(name, seed=1), SPEC, name)
    assert solution.rms_px < 1e-6
    np.testing.assert_allclose(solution.camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], LENSES[name][:4], rtol=1e-6)
    if name != "rational":  # numerator and denominator nearly cancel
        np.testing.assert_allclose(solution.camera.distortion, LENSES[name][4:], atol=1e-5)


@pytest.mark.parametrize("name", ["none", "radial", "fisheye", "rational"])
def test_auto_takes_a_model_that_predicts_as_well_as_the_true_one(name: str) -> None:
    solution = solve_intrinsics(views_through(name, seed=2, sigma_px=0.15), SPEC)
    held_out = {candidate.model: candidate.held_out_rms_px for candidate in solution.comparison}
    assert held_out[solution.model] <= 1.02 * held_out[name]
    assert solution.monotonic
    # a lens is not taken for centred unless the views say so
    assert LENS_MODELS[solution.model].free <= max(LENS_MODELS[name].free, LENS_MODELS["opencv4"].free)
    assert name != "rational" or solution.model == name
    assert abs(solution.camera.matrix[0, 0] / LENSES[name][0] - 1) < 0.003


@pytest.mark.slow
def test_the_true_lens_model_is_chosen() -> None:
    """Or a simpler one that is as good; lenses that need a rich model get it."""
    for name, share in (("opencv4", 0.9), ("opencv5", 0.8), ("rational", 0.8), ("fisheye", 0.8)):
        right = 0
        for seed in range(10):
            sigma_px, count = (0.05, 0.1, 0.2)[seed % 3], (12, 24)[seed % 2]
            right += solve_intrinsics(views_through(name, 50 + seed, count, sigma_px), SPEC).model == name
        assert right >= 10 * share, name


def test_predicted_standard_deviations_are_those_of_repeated_noise() -> None:
    name = "fisheye"
    rng, model, truth = np.random.default_rng(4), LENS_MODELS[name], LENSES[name]
    exact = solve_intrinsics(views_through(name, seed=5, count=10), SPEC, name)
    poses = np.array([[*v.T_camera_board.rotvec_rad, *v.T_camera_board.translation_m] for v in exact.views])
    clean = [BoardCorners(corner_points(SPEC)[v.ids], v.corners_px) for v in views_through(name, seed=5, count=10)]
    draws, predicted = [], []
    for _ in range(120):
        noisy = [BoardCorners(v.points_m, v.pixels + 0.2 * rng.normal(size=v.pixels.shape)) for v in clean]
        bundle = refine(Bundle.start(model, truth, poses), noisy)
        known = information(bundle, noisy)
        draws.append(bundle.intrinsics)
        predicted.append(np.diag(known.covariance)[:-SHAPE])
    ratio = np.std(draws, axis=0) / np.sqrt(np.mean(predicted, axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=0.15)


def test_a_gross_view_is_dropped_and_a_gross_corner_left_out() -> None:
    views = views_through("radial", seed=8, sigma_px=0.15)
    rng = np.random.default_rng(9)
    spoilt = views[3].corners_px.copy()
    spoilt[5] += 14.0
    views[3] = dataclasses.replace(views[3], corners_px=spoilt)
    views[7] = dataclasses.replace(views[7], corners_px=rng.permutation(views[7].corners_px))
    solution = solve_intrinsics(views, SPEC, "radial")
    assert [view.name for view in solution.dropped] == ["07.png"]
    assert "robust" in solution.dropped[0].reason
    assert {view.name: view.left_out for view in solution.views if view.left_out} == {"03.png": 1}
    assert solution.rms_inliers_px < 0.25
    assert abs(solution.camera.matrix[0, 0] / 1500.0 - 1) < 0.003


def test_views_that_fix_nothing_are_dropped_with_the_reason() -> None:
    views = views_through("radial", seed=12, sigma_px=0.1)
    line = np.arange(8)
    on_a_line = dataclasses.replace(views[0], name="line", ids=line, corners_px=views[0].corners_px[line])
    few = dataclasses.replace(views[1], name="few", ids=views[1].ids[:5], corners_px=views[1].corners_px[:5])
    empty = BoardView("empty", np.zeros(0, int), np.zeros((0, 2)), SIZE)
    solution = solve_intrinsics([on_a_line, few, empty, *views], SPEC, "radial")
    reasons = {view.name: view.reason for view in solution.dropped}
    assert set(reasons) == {"line", "few", "empty"}
    assert "line" in reasons["line"]
    assert "5 corners, at least 6" in reasons["few"]
    assert "not found" in reasons["empty"]


def test_views_without_tilt_are_not_answered_with_confidence() -> None:
    rng = np.random.default_rng(14)
    poses = [pose_towards(rng, 0.25, 0.06) for _ in range(8)]
    views = views_of(LENS_MODELS["none"], LENSES["none"], SIZE, poses, rng, 0.15)
    solution = solve_intrinsics(views, SPEC, "none")
    assert "focal_vague" in {one.name for one in solution.verdict.findings}
    frontal = views_of(LENS_MODELS["none"], LENSES["none"], SIZE, [pose_towards(rng, 0.25, 0.0)] * 8, rng)
    with pytest.raises(InputError, match="leave the none lens open"):
        solve_intrinsics(frontal, SPEC, "none")


# set, smallest number of corners in a view, RMS, fx, fy as its NOTES.txt gives them; the model, and whether fx = fy
REFERENCES = [
    ("realsense", 6, (0.6235, 898.74, 901.55), ("opencv5", False)),
    ("gopro", 6, (0.3010, 586.97, 586.97), ("rational", True)),
    ("ucl_left", 20, (0.571, 833.51, 909.43), ("opencv5", False)),
    ("ucl_right", 20, (0.538, 834.21, 908.66), ("opencv5", False)),
]


def assert_matches(solution: LensSolution, rms: float, fx: float, fy: float) -> None:
    assert solution.rms_px <= 1.03 * rms, "the references hold the board flat"
    assert sum(view.left_out for view in solution.views) <= 0.005 * sum(view.corners for view in solution.views)
    assert solution.camera.matrix[0, 0] == pytest.approx(fx, rel=0.008)
    assert solution.camera.matrix[1, 1] == pytest.approx(fy, rel=0.008)


@pytest.mark.parametrize(
    ("name", "min_corners", "reference", "fitting"),
    [pytest.param(*one, marks=pytest.mark.slow if one[0].startswith("ucl") else ()) for one in REFERENCES],
)
def test_the_fitting_lens_model_reproduces_the_reference(
    name: str, min_corners: int, reference: tuple[float, float, float], fitting: tuple[str, bool]
) -> None:
    views, spec = detected(name)
    model, square = fitting
    solution = solve_intrinsics(views, spec, model, min_corners, square)
    assert_matches(solution, *reference)
    assert len(solution.views) == sum(len(view.ids) >= min_corners for view in views), "no good view may be lost"


@pytest.mark.parametrize(
    ("name", "min_corners", "reference"),
    [pytest.param(*one[:3], marks=pytest.mark.slow if one[0].startswith("ucl") else ()) for one in REFERENCES],
)
def test_the_chosen_lens_model_reproduces_the_reference_and_does_not_fold(
    name: str, min_corners: int, reference: tuple[float, float, float]
) -> None:
    views, spec = detected(name)
    solution = solve_intrinsics(views, spec, "auto", min_corners)
    assert_matches(solution, *reference)
    assert solution.monotonic
    held_out = {candidate.model: candidate.held_out_rms_px for candidate in solution.comparison}
    assert held_out[solution.model] <= 1.1 * min(held_out.values())
    if name == "gopro":
        assert solution.model in ("rational", "fisheye")


def test_opencv_ends_in_the_same_minimum() -> None:
    views, spec = detected("realsense")
    observations = [dataclasses.replace(view, deformation=None) for view in observations_of(views, corner_points(spec))]
    flat = refine(rough_lens(LENS_MODELS["opencv5"], observations, views[0].image_size), observations)
    points = corner_points(spec).astype(np.float32)
    rms, matrix, distortion, *_ = cv2.calibrateCamera(
        [points[view.ids] for view in views],
        [view.corners_px.astype(np.float32) for view in views],
        views[0].image_size,
        None,
        None,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-12),
    )
    assert flat.rms_px == pytest.approx(rms, rel=1e-6)
    np.testing.assert_allclose(flat.intrinsics[:4], matrix[[0, 1, 0, 1], [0, 1, 2, 2]], atol=0.02)
    np.testing.assert_allclose(flat.intrinsics[4:], distortion.ravel(), atol=2e-3)
