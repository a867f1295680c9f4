"""Rays and planes: exact where they meet, marked where they do not."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.autograd import gradcheck

from vbaa_calib.camera import intersect_hinge_plane, intersect_plane
from vbaa_calib.geometry import PLANE_C, Plane, hinge_plane

RNG = np.random.default_rng(0)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_points_lie_on_plane_and_ray():
    plane = Plane(unit(np.array([0.3, -0.4, 0.8])), 0.2)
    origins, directions = RNG.normal(size=(5, 1, 3)), unit(RNG.normal(size=(40, 3)))
    points, valid = intersect_plane(origins, directions, plane)
    assert points.shape == (5, 40, 3)
    assert 0.2 < valid.mean() < 0.8
    np.testing.assert_allclose((points @ plane.normal)[valid], 0.2, atol=1e-12)
    along = (points - origins)[valid]
    forward = np.broadcast_to(directions, (5, 40, 3))[valid]
    np.testing.assert_allclose(unit(along), forward, atol=1e-10)
    assert np.isnan(points[~valid]).all()


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((0, 0, 0.4), (1.0, 0.0, 0.0)),
        ((0, 0, 0.4), (0.0, 0.0, 1.0)),
        ((0, 0, 0.4), (1.0, 0.0, -0.0005)),
        ((0, 0, 0.0), (0.0, 0.0, -1.0)),
        ((0, 0, 0.0), (1.0, 0.0, 0.0)),
        ((0, 0, 0.4), (np.nan, 0.0, -1.0)),
        ((0, np.inf, 0.4), (0.0, 0.0, -1.0)),
    ],
    ids=["parallel", "behind", "grazing", "plane through the camera", "in the plane", "not a ray", "not an origin"],
)
def test_no_answer_is_nan_and_never_the_origin(origin, direction):
    for kind in (np.array, torch.tensor):
        points, valid = intersect_plane(kind([float(v) for v in origin]), kind(list(direction)), PLANE_C)
        assert not valid.any()
        assert np.isnan(np.asarray(points)).all()


@pytest.mark.parametrize("roll", [-2.0, -0.7, 0.0, 0.4, 1.2, np.pi / 2])
def test_the_hinge_plane_at_any_roll(roll):
    origin, directions = np.array([0.1, 0.05, 0.4]), unit(RNG.normal(size=(50, 3)))
    points, valid = intersect_hinge_plane(origin, directions, np.array(roll))
    expected, also = intersect_plane(origin, directions, hinge_plane(roll))
    np.testing.assert_array_equal(valid, also)
    np.testing.assert_allclose(points, expected, atol=1e-12)
    # tan ξ = z/y on the hinge plane
    np.testing.assert_allclose((points[:, 2] * np.cos(roll) - points[:, 1] * np.sin(roll))[valid], 0.0, atol=1e-12)


def test_rolls_broadcast_and_are_differentiable():
    origin, directions = torch.tensor([0.1, 0.05, 0.4]).double(), torch.tensor(unit(RNG.normal(size=(6, 3))))
    rolls = torch.tensor([[0.0], [0.3], [0.9]]).double()
    points, valid = intersect_hinge_plane(origin, directions, rolls)
    assert points.shape == (3, 6, 3)
    for row in range(3):
        alone, _ = intersect_hinge_plane(origin, directions, rolls[row])
        torch.testing.assert_close(points[row], alone, equal_nan=True)
    safe = directions[valid.all(0)]
    inputs = (origin.requires_grad_(), safe.requires_grad_(), rolls.requires_grad_())
    assert gradcheck(lambda *given: intersect_hinge_plane(*given)[0], inputs)


def test_a_camera_in_the_hinge_plane_sees_nothing_on_it():
    roll = 0.4
    origin = 0.3 * np.array([0.0, np.cos(roll), np.sin(roll)]) + [0.1, 0, 0]
    _, valid = intersect_hinge_plane(origin, unit(RNG.normal(size=(50, 3))), np.array(roll))
    assert not valid.any()
