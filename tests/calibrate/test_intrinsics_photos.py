"""The lens from real photos against the reference results that came with them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from targets.board import corner_points
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics

from .photo_sets import detected

# set, smallest number of corners in a view, RMS, fx, fy as its NOTES.txt gives them; the model, and whether fx = fy
REFERENCES = [
    ("realsense", 6, (0.6235, 898.74, 901.55), ("opencv5", False)),
    ("gopro", 6, (0.3010, 586.97, 586.97), ("rational", True)),
    ("ucl_left", 20, (0.571, 833.51, 909.43), ("opencv5", False)),
    ("ucl_right", 20, (0.538, 834.21, 908.66), ("opencv5", False)),
]


def assert_matches(solution: LensSolution, rms: float, fx: float, fy: float) -> None:
    assert solution.rms_px == pytest.approx(rms, rel=0.03)
    assert sum(view.left_out for view in solution.views) <= 0.005 * sum(view.corners for view in solution.views)
    assert solution.camera.matrix[0, 0] == pytest.approx(fx, rel=0.005)
    assert solution.camera.matrix[1, 1] == pytest.approx(fy, rel=0.005)


@pytest.mark.parametrize(("name", "min_corners", "reference", "fitting"), REFERENCES)
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
    [pytest.param(*one[:3], marks=pytest.mark.slow if one[0] == "ucl_left" else ()) for one in REFERENCES],
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
    solution = solve_intrinsics(views, spec, "opencv5")
    points = corner_points(spec).astype(np.float32)
    rms, matrix, distortion, *_ = cv2.calibrateCamera(
        [points[view.ids] for view in views],
        [view.corners_px.astype(np.float32) for view in views],
        views[0].image_size,
        None,
        None,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-12),
    )
    assert solution.rms_px == pytest.approx(rms, rel=1e-6)
    np.testing.assert_allclose(solution.camera.matrix, matrix, atol=0.02)
    np.testing.assert_allclose(solution.camera.distortion, distortion.ravel(), atol=2e-3)
