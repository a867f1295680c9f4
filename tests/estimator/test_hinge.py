"""Rays meet the deformation plane in the antenna itself, whatever the camera's pose."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.solver.linearised import edge_on
from estimator.solver.rig_arrays import RigArrays
from vbaa_calib.antenna import linear
from vbaa_calib.camera import intersect_hinge_plane
from vbaa_calib.geometry import Pose

from ..rod_scenes import World, camera_pose

EI, LENGTH = 3.9e-3, 0.24


def antenna_points(x: np.ndarray, y: np.ndarray, roll: np.ndarray | float) -> np.ndarray:
    """(..., N, 3) of x′, y′ (..., N) in 𝒟."""
    roll = np.asarray(roll)[..., None]
    return np.stack(np.broadcast_arrays(x, y * np.cos(roll), y * np.sin(roll)), axis=-1)


def rays_from(center: np.ndarray, points: np.ndarray) -> np.ndarray:
    lines = points - center[..., None, :]
    return lines / np.linalg.norm(lines, axis=-1, keepdims=True)


def test_many_rolls_scan_one_picture() -> None:
    """Only the true roll turns the picture of a beam into a beam's shape."""
    center, contact, force = np.array([0.1, -0.25, 0.3]), 0.15, 0.4
    x = np.linspace(0.02, LENGTH, 30)
    rays = rays_from(center, antenna_points(x, linear.deflection(x, contact, force, EI), 0.5))
    rolls = np.linspace(-0.3, 1.2, 16)
    points, valid = intersect_hinge_plane(center, rays[None], rolls[:, None])
    assert valid.all()
    in_plane = points[..., 1] * np.cos(rolls[:, None]) + points[..., 2] * np.sin(rolls[:, None])
    misfit = np.abs(in_plane - linear.deflection(points[..., 0], contact, force, EI)).max(axis=-1)
    assert rolls[misfit.argmin()] == pytest.approx(0.5)
    assert misfit.min() < 1e-14


def test_the_picture_on_plane_c_is_the_beam_under_the_force_component() -> None:
    """Eqs. (3)–(7): projecting the shape in 𝒟 is bending by f_y = f′_y·cos ξ, on both parts."""
    rng = np.random.default_rng(1)
    roll, force = rng.uniform(-1.5, 1.5, 50), rng.normal(size=50)
    x = np.linspace(0.0, LENGTH, 25)
    on_c = antenna_points(x, linear.deflection(x, 0.13, force[:, None], EI), roll)[..., 1]
    np.testing.assert_allclose(on_c, linear.deflection(x, 0.13, (force * np.cos(roll))[:, None], EI), atol=1e-15)


def test_observability_angle() -> None:
    """Of the ray to the contact with 𝒟, so that an error of the ray grows by one over its sine."""
    world = World(camera_pose(0.0), np.zeros(9))
    rig = world.rig(np.zeros(17))
    center, contact = np.array([0.1, -0.3 * np.sin(0.7), 0.3 * np.cos(0.7)]), 0.1
    rig = type(rig)(**vars(rig) | {"T_antenna_camera": Pose(rig.T_antenna_camera.rotation, center)})
    rolls = np.array([0.7, 0.2, -0.1, 0.7 + np.pi / 2])
    unknowns = np.stack([np.full(4, contact / LENGTH), np.cos(rolls), np.sin(rolls)], axis=1)
    found = edge_on(RigArrays.from_rig(rig, 0.0), unknowns)
    np.testing.assert_allclose(found, np.pi / 2 - np.array([0.0, 0.5, 0.8, np.pi / 2]), atol=1e-12)
    turn, roll, place = 1e-7, 0.2, np.array([[contact, 0.0, 0.0]])
    rays = rays_from(center, place)
    normal = np.array([0.0, -np.sin(roll), np.cos(roll)])
    worst = normal - rays * (rays @ normal)[:, None]  # turned where it hurts most
    worst /= np.linalg.norm(worst)
    moved, _ = intersect_hinge_plane(center, rays * np.cos(turn) + worst * np.sin(turn), np.array(roll))
    away = np.linalg.norm(place[0] - center)
    np.testing.assert_allclose(np.linalg.norm(moved - place), turn * away / np.sin(found[1]), rtol=1e-5)
