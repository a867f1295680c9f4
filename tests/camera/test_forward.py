"""The lens maps, forward and inverse: OpenCV's and kornia's, exact where valid, marked where not; and their slopes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.camera import Camera
from vbaa_calib.camera.lens import lens_of, prepared

from ..lazy import Lazy
from .lenses import LENSES, border_and_grid, random_camera, random_directions

torch = Lazy("torch")
tensors = Lazy("vbaa_calib.camera.tensors")

OPENCV = sorted(name for name, camera in LENSES.items() if camera.model == "opencv")


def seen(camera, count=500, seed=0):
    half_angle = min(camera.valid_region().half_angle_rad, 1.1)
    return random_directions(np.random.default_rng(seed), count, 0.999 * half_angle)


def opencv_pixels(camera, points):
    zero = np.zeros(3)
    if camera.model == "fisheye":
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, camera.matrix, camera.distortion)[0][:, 0]
    return cv2.projectPoints(points[:, None], zero, zero, camera.matrix, camera.distortion)[0][:, 0]


@pytest.mark.parametrize("name", sorted(LENSES))
def test_agrees_with_opencv(name):
    camera = LENSES[name]
    points = seen(camera) * 0.7
    pixels, valid = camera.project(points)
    # past the steep end of a rational lens pixels are large numbers; the tolerance is relative there
    assert valid.mean() > 0.9
    np.testing.assert_allclose(pixels[valid], opencv_pixels(camera, points)[valid], rtol=1e-11, atol=1e-8)


def test_fisheye_sees_beyond_a_right_angle():
    camera = LENSES["fisheye 200"]
    directions = random_directions(np.random.default_rng(1), 2000, np.deg2rad(100))
    assert (directions[:, 2] < 0).sum() > 100
    pixels, valid = camera.project(directions)
    rays, back = camera.unproject(pixels)
    assert valid.all()
    assert back.all()
    np.testing.assert_allclose(rays, directions, atol=1e-12)
    _, in_front = camera.unproject_normalized(pixels)
    np.testing.assert_array_equal(in_front, directions[:, 2] > 1e-12)


def test_nothing_behind_a_perspective_camera():
    for name in OPENCV:
        points = np.array([[0.0, 0.0, -1.0], [0.1, 0.2, 0.0], [0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [np.inf, 0.0, 1.0]])
        pixels, valid = LENSES[name].project(points)
        assert not valid.any()
        assert np.isnan(pixels).all()


@pytest.mark.parametrize("name", sorted(LENSES))
def test_derivatives_are_difference_quotients(name):
    camera, points = LENSES[name], seen(LENSES[name], 30) * 0.7
    pixels, valid, by_point, by_lens = lens_of(camera.intrinsics).project(points, True)
    np.testing.assert_array_equal(pixels, camera.project(points)[0])

    def quotient(ends, step):
        return ((ends[0] - ends[1]) / (2.0 * step))[valid]

    def close(derivative, expected):
        np.testing.assert_allclose(derivative[valid], expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max() + 1e-6)

    for axis, move in enumerate(1e-6 * np.eye(3)):
        close(by_point[..., axis], quotient([camera.project(points + sign * move)[0] for sign in (1, -1)], 1e-6))
    for index, move in enumerate(np.diag([1e-3] * 4 + [1e-6] * camera.distortion.size)):
        ends = [camera.moved(sign * move).project(points)[0] for sign in (1, -1)]
        close(by_lens[..., index], quotient(ends, move[index]))


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


EACH_KIND = ["pinhole", "tele", "gopro five", "barrel", "gopro rational", "rational radial", "prism", "tilted"]
EACH_KIND += ["only tilted", "fisheye equidistant", "fisheye 200"]


@pytest.mark.parametrize("name", EACH_KIND)
def test_slopes_are_difference_quotients(name):
    camera = LENSES[name]
    width, height = camera.image_size
    pixels = np.random.default_rng(0).uniform([0.25 * width, 0.25 * height], [0.75 * width, 0.75 * height], (40, 2))
    points, by_pixel, valid = camera.normalized_with_slopes(pixels)
    assert valid.all()

    def quotient(ends: list[np.ndarray], step: float) -> np.ndarray:
        return (ends[0] - ends[1]) / (2.0 * step)

    for axis, direction in enumerate(np.eye(2) * 1e-3):
        ends = [camera.unproject_normalized(pixels + sign * direction)[0] for sign in (1, -1)]
        np.testing.assert_allclose(by_pixel[..., axis], quotient(ends, 1e-3), rtol=1e-6, atol=1e-10)
    by_lens = camera.lens_slopes_at(points)
    for index in range(len(camera.parameter_names)):
        step = 1e-3 if index < 4 else 1e-6
        moves = [sign * step * np.eye(len(camera.parameters))[index] for sign in (1, -1)]
        ends = [camera.moved(move).unproject_normalized(pixels)[0] for move in moves]
        np.testing.assert_allclose(by_lens[..., index], quotient(ends, step), rtol=1e-6, atol=3e-9)


@pytest.mark.parametrize(
    "name", [*EACH_KIND, "barrel folding", "realsense author", "rational with a pole", "prism strong"]
)
def test_the_search_on_other_devices_is_the_cores(name):
    # the processor's tensors are the core's memory; here the same code runs on them as on a GPU's
    camera = LENSES[name]
    own = camera.distortion[:12].tolist()
    lens = prepared(camera.model == "fisheye", (1.0, 1.0, 0.0, 0.0, *own))
    pixels = np.concatenate([border_and_grid(camera, 15), [[np.nan, 1.0], [np.inf, 1.0]]])
    sensor = (pixels - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    expected, known = lens.chart(sensor)
    x, y, valid = tensors._solve_on_device(camera.intrinsics.model, lens, own, *torch.tensor(sensor).unbind(-1))
    np.testing.assert_array_equal(valid.numpy(), known)
    np.testing.assert_allclose(np.stack([x, y], -1)[known], expected[known], rtol=1e-7, atol=1e-9)
