"""The forward maps against OpenCV's and kornia's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from vbaa_calib.camera.lens import lens_of

from .lenses import LENSES, random_camera, random_directions

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


def test_fisheye_is_smooth_on_the_axis():
    # kornia switches to the pinhole below 1e-4 rad, and OpenCV divides by the radius: the series must join seamlessly
    camera = LENSES["fisheye tele"]
    angle = np.geomspace(1e-9, 1e-2, 400)
    pixels, valid = camera.project(np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1))
    k = camera.distortion
    exact = angle * (1 + sum(k[i] * angle ** (2 * i + 2) for i in range(4)))
    assert valid.all()
    np.testing.assert_allclose(
        (pixels[:, 0] - camera.matrix[0, 2]) / camera.matrix[0, 0], exact, atol=1e-16, rtol=1e-12
    )


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


def test_straight_back_has_no_pixel():
    pixels, valid = LENSES["fisheye equidistant"].project(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]))
    assert not valid.any()
    assert np.isnan(pixels).all()


def test_distance_does_not_matter():
    rng = np.random.default_rng(3)
    for _ in range(20):
        camera = random_camera(rng)
        directions = random_directions(rng, 50, 0.9 * camera.valid_region().half_angle_rad)
        near, _ = camera.project(1e-3 * directions)
        far, _ = camera.project(1e3 * directions)
        np.testing.assert_allclose(near, far, rtol=1e-9, atol=1e-9)


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
