"""The inverse: exact where valid, marked where not, on the branch of the axis."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.camera import Camera

from .lenses import LENSES, border_and_grid, camera, random_camera, random_directions
from .test_forward import opencv_pixels


@pytest.mark.parametrize("name", sorted(LENSES))
def test_round_trip(name):
    lens = LENSES[name]
    pixels = border_and_grid(lens)
    rays, valid = lens.unproject(pixels)
    again, still = lens.project(rays)
    assert valid.any()
    np.testing.assert_array_equal(valid, ~np.isnan(rays).any(-1))
    assert still[valid].all()
    np.testing.assert_allclose(np.linalg.norm(rays[valid], axis=-1), 1.0, atol=1e-14)
    assert np.abs(again - pixels)[valid].max() <= 1e-9


@pytest.mark.parametrize("name", sorted(LENSES))
def test_round_trip_in_single_precision(name):
    lens = LENSES[name]
    if lens.matrix[0, 0] > 5000:
        pytest.skip("one rounding of a float32 ray is more than 1e-3 px at this focal length")
    pixels = border_and_grid(lens).astype(np.float32)
    rays, valid = lens.unproject(pixels)
    again, still = lens.project(rays)
    assert rays.dtype == again.dtype == np.float32
    # a ray rounded across the fold may have no pixel any more, but then it says so
    assert still[valid].mean() > 0.995
    assert np.abs(again - pixels)[valid & still].max() <= 1e-3


@pytest.mark.parametrize("name", ["gopro five", "barrel", "pincushion", "mustache", "rational", "prism", "tilted"])
def test_agrees_with_opencv_where_that_has_converged(name):
    lens = LENSES[name]
    pixels = border_and_grid(lens)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
    theirs = cv2.undistortPointsIter(pixels[:, None], lens.matrix, lens.distortion, None, None, criteria)[:, 0]
    converged = np.abs(opencv_pixels(lens, np.c_[theirs, np.ones(len(theirs))]) - pixels).max(-1) < 1e-9
    radius = lens.valid_region().ideal_radius
    on_branch = converged & (np.linalg.norm(theirs, axis=-1) < 0.99 * radius)
    ours, valid = lens.unproject_normalized(pixels)
    assert on_branch.mean() > 0.5
    assert valid[on_branch].all()
    np.testing.assert_allclose(ours[on_branch], theirs[on_branch], atol=1e-9)


def test_beyond_the_fold_nothing_is_valid():
    # r (1 − 0.35 r²) grows to r² = 1/1.05 and reaches 0.6505 there
    lens = LENSES["barrel folding"]
    region = lens.valid_region()
    fold = 1 / np.sqrt(1.05)
    assert region.ideal_radius == pytest.approx(fold, rel=1e-9)
    assert region.distorted_radius == pytest.approx(fold * (1 - 0.35 / 1.05), rel=1e-9)
    beyond = np.array([[643.2 + 700 * 0.651, 355.1], [643.2, 355.1 - 707 * 0.7]])
    rays, valid = lens.unproject(beyond)
    assert not valid.any()
    assert np.isnan(rays).all()
    _, valid = lens.project(np.array([[fold * 1.001, 0.0, 1.0], [2.0, 0.0, 1.0]]))
    assert not valid.any()


def test_a_pole_is_not_crossed():
    # r (1 + 0.1 r²)/(1 − 0.9 r²) reaches every radius before its pole at r = 1.054; behind it lies another branch
    lens = LENSES["rational with a pole"]
    assert lens.valid_region().ideal_radius == pytest.approx(1 / np.sqrt(0.9), rel=1e-6)
    ideal, valid = lens.unproject_normalized(border_and_grid(lens))
    assert valid.all()
    assert (np.linalg.norm(ideal, axis=-1) < 1 / np.sqrt(0.9)).all()
    _, valid = lens.project(np.array([[1.06, 0.0, 1.0], [5.0, 0.0, 1.0]]))
    assert not valid.any()


def around_the_rim(lens: Camera, rng: np.random.Generator, count: int) -> np.ndarray:
    """Pixels on both sides of the valid region's rim, where other branches are close."""
    radius = lens.valid_region().distorted_radius
    azimuth, along = rng.uniform(-np.pi, np.pi, count), radius * rng.uniform(0.99, 1.03, count)
    return (
        lens.matrix[:2, 2] + np.stack([along * np.cos(azimuth), along * np.sin(azimuth)], -1) * np.diag(lens.matrix)[:2]
    )


def check_never_silently_wrong(lens: Camera, rng: np.random.Generator, count: int) -> tuple[int, int]:
    """Random pixels around the image, and random directions. Returns how many came back of how many that should."""
    width, height = lens.image_size
    pixels = rng.uniform([-0.2 * width, -0.2 * height], [1.2 * width, 1.2 * height], (count, 2))
    if lens.valid_region().distorted_radius < 3.0:
        pixels = np.concatenate([pixels, around_the_rim(lens, rng, count)])
    rays, valid = lens.unproject(pixels)
    assert np.isfinite(rays[valid]).all()
    assert np.isnan(rays[~valid]).all()
    again, still = lens.project(rays[valid])
    assert still.all()
    np.testing.assert_allclose(again, pixels[valid], rtol=0, atol=1e-8)
    front = valid & (rays[:, 2] > 1e-3)
    if front.any():
        assert np.abs(opencv_pixels(lens, rays[front]) - pixels[front]).max() < 1e-8
    # the branch: what a direction in the region is mapped to must come back as that direction, up to conditioning
    half_angle = min(1.1 * lens.valid_region().half_angle_rad, 1.4)
    directions = random_directions(rng, count, half_angle)
    pixels, seen = lens.project(directions)
    near = seen & (np.abs(pixels).max(-1, initial=0.0, where=np.isfinite(pixels)) < 1e4)
    rays, valid = lens.unproject(pixels[near])
    slope = np.linalg.norm(lens.normalized_with_slopes(pixels[near])[1][valid], axis=(1, 2))
    error = np.linalg.norm((rays - directions[near])[valid], axis=-1)
    assert (error <= 1e-8 * (1e-2 + slope)).all()
    return int(valid.sum()), int(near.sum())


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_never_silently_wrong(seed):
    rng = np.random.default_rng(seed)
    check_never_silently_wrong(random_camera(rng), rng, 300)


@pytest.mark.slow
def test_never_silently_wrong_on_many():
    rng = np.random.default_rng(20251101)
    back, of = np.sum([check_never_silently_wrong(random_camera(rng), rng, 2000) for _ in range(250)], axis=0)
    assert of > 100_000
    assert back > 0.9999 * of


def test_hostile_pixels_are_marked():
    pixels = np.array([[np.nan, 1.0], [np.inf, 1.0], [-np.inf, np.nan], [1e300, 1e300], [-1e200, 0.0]])
    for name, lens in LENSES.items():
        rays, valid = lens.unproject(pixels)
        assert not valid[:3].any(), name
        assert np.isnan(rays[~valid]).all(), name
        assert np.isfinite(rays[valid]).all(), name


def test_absurd_coefficients_are_marked_not_wrong():
    rng = np.random.default_rng(5)
    for _ in range(60):
        lens = camera("opencv", (640, 480), 500, 500, 320, 240, rng.normal(size=14) * 10 ** rng.uniform(-3, 12, 14))
        pixels = border_and_grid(lens, 11)
        rays, valid = lens.unproject(pixels)
        again, _ = lens.project(rays[valid])
        assert np.abs(again - pixels[valid]).max(initial=0.0) < 1e-8
