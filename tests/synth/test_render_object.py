"""Ray casting agrees with the objects' signed distance, and the picture with their projected outline."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.object import cast, object_layer, obstacle, pressed_in
from vbaa_calib.simulate.scene.objects import TouchObject

from .studios import place

AXIS = np.array([0.2, 0.3, 0.933]) / np.linalg.norm([0.2, 0.3, 0.933])
ACROSS = np.cross(AXIS, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(AXIS, [1.0, 0.0, 0.0]))
CENTRE = np.array([0.15, 0.01, -0.02])
CAMERA = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.14, 0.0, 0.36]))


def _object(shape: str, **changes: float) -> TouchObject:
    sizes = {"radius_m": 0.02, "half_length_m": 0.06} | changes
    return TouchObject(shape=shape, center_world_m=CENTRE, axis_world=AXIS, wedge_world=ACROSS, **sizes)


def _rays(count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    origin = np.array([0.05, -0.1, 0.35])
    aims = CENTRE + np.random.default_rng(2).uniform(-0.05, 0.05, (count, 3))
    return origin, aims - origin


@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_hits_lie_on_the_surface(shape: str) -> None:
    obj = _object(shape)
    origin, directions = _rays()
    hits = cast(obj, origin, directions)
    round_part = np.isfinite(hits.depth) & (hits.face == 0)
    points = origin + hits.depth[round_part, None] * directions[round_part]
    distance, normal = obj.signed_distance(points)
    assert round_part.sum() > 300
    np.testing.assert_allclose(distance, 0.0, atol=1e-12)
    np.testing.assert_allclose(hits.normal[round_part], normal, atol=1e-9)
    assert ((hits.normal[round_part] * directions[round_part]).sum(axis=1) < 0).all()


def test_a_missed_sphere_is_never_touched_by_its_ray() -> None:
    obj = _object("sphere")
    origin, directions = _rays()
    missed = ~np.isfinite(cast(obj, origin, directions).depth)
    steps = np.linspace(0.5, 1.5, 60)[:, None, None]
    distance, _ = obj.signed_distance(origin + steps * directions[missed])
    assert missed.sum() > 100
    assert distance.min() > -1e-4


def test_the_cylinder_ends_at_its_caps() -> None:
    obj = _object("cylinder", half_length_m=0.01)
    origin, directions = _rays()
    hits = cast(obj, origin, directions)
    on = np.isfinite(hits.depth)
    along = (origin + hits.depth[on, None] * directions[on] - CENTRE) @ AXIS
    assert np.abs(along).max() < 0.01 + 1e-12
    np.testing.assert_allclose(np.abs(along[hits.face[on] == 1]), 0.01, atol=1e-12)


def test_the_blade_reaches_to_its_edge_and_no_further() -> None:
    obj = _object("knife_edge", radius_m=0.0002)
    origin, directions = _rays(40000)
    hits = cast(obj, origin, directions)
    on = np.isfinite(hits.depth)
    inward = (origin + hits.depth[on, None] * directions[on] - CENTRE) @ ACROSS
    assert on.sum() > 200
    assert inward.min() > -0.0002 - 1e-12
    assert inward.min() < 0.002
    assert inward.max() < 0.025 + 1e-12


def test_the_picture_of_a_sphere_covers_its_cone_of_sight() -> None:
    scene, obj = place("pinhole"), _object("sphere")
    layer = object_layer(scene, obj, CAMERA)
    rows, columns = np.mgrid[layer.where]
    toward = CAMERA.inverse() @ CENTRE
    # the outline of a sphere is an ellipse: semi-axes of the cone's section with the picture plane
    half = np.arcsin(0.02 / np.linalg.norm(toward))
    off = np.arctan2(np.hypot(toward[0], toward[1]), toward[2])
    fx, fy = np.diag(scene.rays.lens.matrix)[:2]
    major = (np.tan(off + half) - np.tan(off - half)) / 2
    middle = (np.tan(off + half) + np.tan(off - half)) / 2
    minor = np.sin(half) / np.sqrt(np.cos(half) ** 2 - np.sin(off) ** 2)
    assert layer.alpha.sum() == pytest.approx(np.pi * major * minor * fx * fy, rel=2e-3)
    centre = np.array([(columns * layer.alpha).sum(), (rows * layer.alpha).sum()]) / layer.alpha.sum()
    aim = toward[:2] / np.hypot(*toward[:2]) * middle
    np.testing.assert_allclose(centre, aim * [fx, fy] + scene.rays.lens.matrix[:2, 2], atol=0.05)


def test_depth_counts_along_the_cameras_axis() -> None:
    scene, obj = place("brown"), _object("sphere")
    depth = obstacle(scene, obj, CAMERA)
    toward = CAMERA.inverse() @ CENTRE
    pixel = scene.rays.lens.matrix[:2, :2] @ (toward[:2] / toward[2]) + scene.rays.lens.matrix[:2, 2]
    found = depth(np.array([pixel, [5.0, 5.0]]))
    assert found[0] == pytest.approx(toward[2] - 0.02, abs=2e-4)
    assert np.isinf(found[1])


@pytest.mark.parametrize("shape", ["sphere", "cylinder", "knife_edge"])
def test_a_pressed_object_gives_way(shape: str) -> None:
    obj = _object(shape)
    point = CENTRE - 0.021 * ACROSS
    before, after = obj.signed_distance(point)[0], pressed_in(obj, 0.001).signed_distance(point)[0]
    assert after - before == pytest.approx(0.001)


def test_an_object_outside_the_picture_leaves_no_layer() -> None:
    away = Pose(CAMERA.rotation, CAMERA.translation_m + np.array([3.0, 0.0, 0.0]))
    assert object_layer(place("pinhole"), _object("cylinder"), away) is None
