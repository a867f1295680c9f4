"""The objects: distance, scene file, rays, and how the camera sees them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.object import _cast, object_patch, pressed_in
from vbaa_calib.simulate.scene.objects import BOX_FACE_M, Bump, TouchObject

from .studios import place

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
WEDGE = np.array([1.0, 2.0, 0.0]) / math.sqrt(5.0)
CENTRE = np.array([0.15, 0.01, -0.02])
BUMPS = (
    Bump(np.array([0.6, 0.8, 0.0]), 3e-3, 12e-3),
    Bump(np.array([0.0, -0.6, 0.8]), -2e-3, 10e-3),
    Bump(np.array([-1.0, 0.0, 0.0]), 4e-3, 15e-3),
)


ORIGIN = np.array([0.05, -0.1, 0.35])
CAMERA = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.14, 0.0, 0.36]))


def solid(shape: str, radius_m: float = 0.02, half_length_m: float = 0.06) -> TouchObject:
    return TouchObject(shape, CENTRE, AXIS, radius_m, half_length_m, wedge_world=WEDGE)


def box() -> TouchObject:
    return solid("box_edge", 4e-3, 0.05)


def freeform() -> TouchObject:
    return TouchObject("freeform", CENTRE, AXIS, 0.03, 1.0, bumps=BUMPS)


def rays(count: int, spread_m: float) -> np.ndarray:
    """From `ORIGIN` past the object's middle."""
    return CENTRE + np.random.default_rng(2).uniform(-spread_m, spread_m, (count, 3)) - ORIGIN


EVERY = {
    each.shape: each for each in (solid("cylinder"), solid("sphere"), solid("knife_edge", 2e-4), box(), freeform())
}


@pytest.mark.parametrize("shape", EVERY)
def test_distance_has_the_normal_as_gradient_and_ends_on_the_surface(shape: str) -> None:
    obj = EVERY[shape]
    rng = np.random.default_rng(3)
    points = CENTRE + 0.05 * rng.normal(size=(4, 60, 3))
    distance, normal = obj.signed_distance(points)
    assert distance.shape == (4, 60)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1.0)
    step = 1e-6
    gradient = np.stack(
        [
            (obj.signed_distance(points + step * e)[0] - obj.signed_distance(points - step * e)[0]) / (2 * step)
            for e in np.eye(3)
        ],
        axis=-1,
    )
    outside = distance > -2e-3
    assert outside.sum() > 100
    np.testing.assert_allclose(gradient[outside], normal[outside], atol=1e-5)
    np.testing.assert_allclose(obj.signed_distance(points - distance[..., None] * normal)[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.sign(obj.rough_distance(points)), np.sign(distance))


@pytest.mark.parametrize("shape", ["cylinder", "sphere", "box_edge", "freeform"])
def test_rays_end_on_the_surface_and_missing_ones_never_touch_it(shape: str) -> None:
    obj, exact = EVERY[shape], shape in ("cylinder", "sphere")
    directions = rays(4000, 0.05) if exact else rays(1500, 0.06)
    depth, normals, face = _cast(obj, ORIGIN, directions)
    hit = np.isfinite(depth)
    assert 200 < hit.sum() < 3000
    on = hit & (face == 0)
    distance, normal = obj.signed_distance(ORIGIN + depth[on, None] * directions[on])
    np.testing.assert_allclose(distance, 0.0, atol=1e-12 if exact else 3e-6)
    np.testing.assert_allclose(normals[on], normal, atol=1e-9 if exact else 1e-3)
    assert ((normals[hit] * directions[hit]).sum(axis=1) < 1e-3).all()
    along = ORIGIN + np.linspace(0.6, 1.6, 80)[:, None, None] * directions[~hit]
    bodies = obj.signed_distance(along)[0]
    if shape in ("cylinder", "box_edge"):
        bodies = np.maximum(bodies, np.abs((along - CENTRE) @ AXIS) - obj.half_length_m)
    if shape == "box_edge":
        bodies = np.maximum(bodies, ((along - CENTRE) @ obj.into_faces.T - BOX_FACE_M).max(axis=-1))
    assert bodies.min() > -1e-5


@pytest.mark.parametrize("shape", EVERY)
def test_a_pressed_object_gives_way(shape: str) -> None:
    obj = EVERY[shape]
    ahead = CENTRE - 0.05 * (WEDGE if shape != "freeform" else np.array([0.0, 0.0, 1.0]))
    before, after = obj.signed_distance(ahead)[0], pressed_in(obj, 0.001).signed_distance(ahead)[0]
    # the bumps go with their places
    assert after - before == pytest.approx(0.001, abs=5e-4 if shape == "freeform" else 1e-9)


@pytest.mark.parametrize("shape", EVERY)
def test_the_camera_sees_it_unless_it_is_outside_the_picture(shape: str) -> None:
    patch = object_patch(place(), EVERY[shape], CAMERA)
    assert (patch.alpha > 0.99).sum() > 500
    assert np.isfinite(patch.brightness).all()
    away = Pose(CAMERA.rotation, CAMERA.translation_m + np.array([3.0, 0.0, 0.0]))
    assert object_patch(place(), EVERY[shape], away) is None
