"""Rays meet the deformation plane in the antenna itself, whatever the camera's pose."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.contact.hinge_plane import antenna_points, camera_angle, hinge_shape, onto_plane_c
from vbaa_calib.antenna import linear
from vbaa_calib.geometry import hinge_plane

EI, LENGTH = 3.9e-3, 0.24


def rays_from(center: np.ndarray, points: np.ndarray) -> np.ndarray:
    lines = points - center[..., None, :]
    return lines / np.linalg.norm(lines, axis=-1, keepdims=True)


def test_round_trip_from_any_camera() -> None:
    rng = np.random.default_rng(0)
    roll = rng.uniform(-np.pi / 2, np.pi / 2, 300)
    center = rng.uniform(-0.5, 0.5, (300, 3))
    x, y = rng.uniform(0.0, LENGTH, (300, 40)), rng.uniform(-0.05, 0.05, (300, 40))
    points = antenna_points(x, y, roll)
    shape = hinge_shape(rays_from(center, points), center, roll)
    clear = camera_angle(center, roll) > 0.05
    assert clear.sum() > 200
    np.testing.assert_allclose(shape.x_m[clear], x[clear], atol=1e-12)
    np.testing.assert_allclose(shape.y_m[clear], y[clear], atol=1e-12)
    np.testing.assert_allclose(shape.distance_m, np.linalg.norm(points - center[:, None], axis=-1), atol=1e-10)


def test_points_lie_in_the_hinge_plane() -> None:
    for roll in (-1.0, 0.0, 0.4, np.pi / 2):
        plane = hinge_plane(roll)
        points = antenna_points(np.linspace(0, LENGTH, 5), np.linspace(0, 0.03, 5), roll)
        np.testing.assert_allclose(points @ plane.normal, plane.offset_m, atol=1e-17)
        assert np.tan(roll) * points[-1, 1] == pytest.approx(points[-1, 2])


def test_many_rolls_scan_one_picture() -> None:
    """Only the true roll turns the picture of a beam into a beam's shape."""
    center, contact, force = np.array([0.1, -0.25, 0.3]), 0.15, 0.4
    x = np.linspace(0.02, LENGTH, 30)
    points = antenna_points(x, linear.deflection(x, contact, force, EI), 0.5)
    rolls = np.linspace(-0.3, 1.2, 16)
    shape = hinge_shape(rays_from(center, points), center, rolls)
    assert shape.x_m.shape == (16, 30)
    misfit = np.abs(shape.y_m - linear.deflection(shape.x_m, contact, force, EI)).max(axis=-1)
    assert rolls[misfit.argmin()] == pytest.approx(0.5)
    assert misfit.min() < 1e-15


def test_far_cameras_lose_no_digits() -> None:
    """At 100 km the deflection still comes out to rounding of the rays, not of the distance squared."""
    center = np.array([0.1, 3.0e4, 1.0e5])
    points = antenna_points([0.05, 0.2], [0.001, 0.01], 0.3)
    shape = hinge_shape(rays_from(center, points), center, 0.3)
    np.testing.assert_allclose(shape.y_m, [0.001, 0.01], atol=1e-10)


def test_onto_plane_c_gives_the_beam_under_the_force_component() -> None:
    """Eqs. (3)–(7): projecting the shape in 𝒟 is bending by f_y = f′_y·cos ξ, on both parts."""
    rng = np.random.default_rng(1)
    roll, force = rng.uniform(-1.5, 1.5, 50), rng.normal(size=50)
    x = np.linspace(0.0, LENGTH, 25)
    in_d = np.stack([np.broadcast_to(x, (50, 25)), linear.deflection(x, 0.13, force[:, None], EI)], axis=-1)
    on_c = onto_plane_c(in_d, roll[:, None])
    np.testing.assert_array_equal(on_c[..., 0], in_d[..., 0])
    np.testing.assert_allclose(
        on_c[..., 1], linear.deflection(x, 0.13, (force * np.cos(roll))[:, None], EI), atol=1e-15
    )
    upright = antenna_points(in_d[..., 0], in_d[..., 1], roll)[..., :2]
    np.testing.assert_allclose(on_c, upright, atol=1e-16)


def test_observability_angle() -> None:
    above = np.array([0.1, 0.0, 0.3])
    assert camera_angle(above, 0.0, 0.1) == pytest.approx(np.pi / 2)
    assert camera_angle(above, np.pi / 2, 0.1) == pytest.approx(0.0, abs=1e-15)
    tilted = np.array([0.1, -0.3 * np.sin(0.7), 0.3 * np.cos(0.7)])
    np.testing.assert_allclose(camera_angle(tilted, [0.7, 0.2, -0.1], 0.1), np.pi / 2 - np.array([0.0, 0.5, 0.8]))
    shape = hinge_shape(rays_from(tilted, np.array([[0.1, 0.0, 0.0]])), tilted, 0.2)
    assert shape.incidence_rad[0] == pytest.approx(camera_angle(tilted, 0.2, 0.1))


def test_an_error_of_a_ray_moves_the_point_as_stated() -> None:
    center, roll, turn = np.array([0.05, -0.3, 0.2]), 0.3, 1e-7
    rays = rays_from(center, antenna_points([0.12], [0.004], roll))
    shape = hinge_shape(rays, center, roll)
    normal = hinge_plane(roll).normal
    # turned in the plane of the ray and the normal of 𝒟, where it hurts most
    worst = normal - rays * (rays @ normal)[:, None]
    worst /= np.linalg.norm(worst)
    moved = hinge_shape(rays * np.cos(turn) + worst * np.sin(turn), center, roll)
    shift = np.hypot(moved.x_m - shape.x_m, moved.y_m - shape.y_m)
    np.testing.assert_allclose(shift, turn * shape.distance_m / np.sin(shape.incidence_rad), rtol=1e-5)


def test_rays_that_miss_are_nan() -> None:
    center = np.array([0.0, 0.0, 0.3])
    rays = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [np.nan, 0.0, -1.0]])
    with np.errstate(all="raise"):
        shape = hinge_shape(rays, center, 0.0)
        inside = hinge_shape(rays, center, np.pi / 2)
    np.testing.assert_array_equal(np.isnan(shape.y_m), [True, True, False, True])
    np.testing.assert_array_equal(np.isnan(shape.x_m), [True, True, False, True])
    assert np.nanmax(inside.incidence_rad) < 1e-15
