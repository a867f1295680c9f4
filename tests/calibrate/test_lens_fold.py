"""Lenses held from folding: the radial curve's derivatives, the smooth start of a rational lens, and real draws."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.boards import draw, rigs
from benchmarks.calibration.methods import solve_oracle, solve_ours
from vbaa_calib.calibrate.lens.models import (
    LENS_MODELS,
    camera_of,
    corner_radius,
    is_monotonic,
    radial_curve,
    rational_like,
)

WIDE = rigs()[2]
FISHEYE = np.array([520.0, 521.0, 641.0, 358.0, 0.05, -0.01, 0.003, -0.001])


@pytest.mark.parametrize("name", ["opencv5", "rational", "fisheye"])
def test_the_curve_is_the_projection_and_its_derivatives_are_finite_differences(name: str) -> None:
    model, rng = LENS_MODELS[name], np.random.default_rng(1)
    distortion = 0.1 * rng.normal(size=model.distortion_count)
    distortion[2:4] = 0.0 if name != "fisheye" else distortion[2:4]
    radii = np.linspace(0.01, 0.9, 7)
    curve, slope, by_distortion = radial_curve(model, distortion, radii)
    camera = camera_of(model, np.concatenate([[1.0, 1.0, 0.0, 0.0], distortion]), (4, 4))
    ideal = np.tan(radii) if name == "fisheye" else radii
    pixels, _ = camera.project(np.column_stack([ideal, np.zeros(7), np.ones(7)]))
    np.testing.assert_allclose(curve, pixels[:, 0], rtol=1e-9)
    ahead, behind = (radial_curve(model, distortion, radii + step)[0] for step in (1e-6, -1e-6))
    np.testing.assert_allclose(slope, (ahead - behind) / 2e-6, rtol=1e-6)
    for number, step in enumerate(1e-6 * np.eye(len(distortion))):
        moved = (
            radial_curve(model, distortion + step, radii)[1] - radial_curve(model, distortion - step, radii)[1]
        ) / 2e-6
        np.testing.assert_allclose(by_distortion[:, number], moved, rtol=1e-4, atol=1e-7)


def test_a_rational_lens_follows_a_fisheye_over_the_picture() -> None:
    size = (1280, 720)
    alike = rational_like(LENS_MODELS["fisheye"], FISHEYE, size)
    assert alike is not None
    assert is_monotonic(LENS_MODELS["rational"], alike, size)
    given, like = camera_of(LENS_MODELS["fisheye"], FISHEYE, size), camera_of(LENS_MODELS["rational"], alike, size)
    corners = np.array([[0.0, 0.0], [1279.0, 719.0], [640.0, 0.0], [900.0, 500.0]])
    rays, valid = given.unproject(corners)
    assert valid.all()
    assert np.abs(like.project(rays)[0] - corners).max() < 3.0
    assert corner_radius(FISHEYE, size) > np.hypot(640.0, 360.0) / 521.0
    too_wide = FISHEYE * np.array([0.4, 0.4, 1, 1, 1, 1, 1, 1])
    assert rational_like(LENS_MODELS["fisheye"], too_wide, size) is None


@pytest.mark.parametrize(
    "seed", [1, 102, pytest.param(105, marks=pytest.mark.slow), pytest.param(116, marks=pytest.mark.slow)]
)
def test_draws_whose_plain_fit_folds_are_solved_without(seed: int) -> None:
    given = draw(WIDE, seed)
    assert solve_oracle(given).valid_region().image_fraction < 1.0
    solution = solve_ours(given)
    assert solution.camera.valid_region().image_fraction == 1.0
    # as good as the fit that folds, but for what a few parameters explain
    assert solution.rms_px < 0.15 * np.sqrt(2.0) * 1.02
