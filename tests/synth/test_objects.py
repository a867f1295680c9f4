"""Box edge and free form: distance, scene file, and how the camera sees them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.object import cast, object_layer, pressed_in
from vbaa_calib.simulate.scene.objects import BOX_FACE_M, Bump, TouchObject, surface_radius
from vbaa_calib.simulate.scene.scene import bundled_scene
from vbaa_calib.simulate.scene.scene_file import load_scene

from .studios import place

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
WEDGE = np.array([1.0, 2.0, 0.0]) / math.sqrt(5.0)
CENTRE = np.array([0.15, 0.01, -0.02])
BUMPS = (
    Bump(np.array([0.6, 0.8, 0.0]), 3e-3, 12e-3),
    Bump(np.array([0.0, -0.6, 0.8]), -2e-3, 10e-3),
    Bump(np.array([-1.0, 0.0, 0.0]), 4e-3, 15e-3),
)


def box(**kwargs: float) -> TouchObject:
    return TouchObject("box_edge", CENTRE, AXIS, 4e-3, 0.05, wedge_world=WEDGE, **kwargs)


def freeform(**kwargs: float) -> TouchObject:
    return TouchObject("freeform", CENTRE, AXIS, 0.03, 1.0, bumps=BUMPS, **kwargs)


@pytest.mark.parametrize("obj", [box(), freeform()], ids=["box", "free form"])
def test_distance_has_the_normal_as_gradient_and_ends_on_the_surface(obj: TouchObject) -> None:
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


def test_no_point_of_the_free_form_is_nearer() -> None:
    """Against a dense cloud of its surface, made by rays from the centre."""
    rng = np.random.default_rng(5)
    rays = rng.normal(size=(60000, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    cloud = CENTRE + surface_radius(rays, 0.03, BUMPS)[:, None] * rays
    np.testing.assert_allclose(freeform().signed_distance(cloud)[0], 0.0, atol=1e-12)
    points = CENTRE + 0.04 * rng.normal(size=(200, 3))
    nearest = cKDTree(cloud).query(points)[0]
    distance = np.abs(freeform().signed_distance(points)[0])
    assert (nearest >= distance - 1e-12).all()
    # the cloud's points lie some 0.6 mm apart
    assert (nearest**2 - distance**2).max() < 8e-4 * (nearest.max() + 8e-4)


def test_the_box_is_two_planes_that_meet_in_a_rounding() -> None:
    into = box().into_faces
    np.testing.assert_allclose(into @ into.T, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(into @ WEDGE, math.sqrt(0.5))
    deep = CENTRE + 0.02 * into[1] - 0.007 * into[0]
    distance, normal = box().signed_distance(deep)
    np.testing.assert_allclose(distance, 0.003)
    np.testing.assert_allclose(normal, -into[0])
    np.testing.assert_allclose(box().signed_distance(CENTRE - 0.01 * WEDGE)[0], 0.006)
    np.testing.assert_array_equal(box().within(CENTRE + np.array([[-0.049], [0.051]]) * AXIS), [True, False])


@pytest.mark.parametrize("obj", [box(), freeform()], ids=["box", "free form"])
def test_rays_end_on_the_surface_and_missing_ones_never_touch_it(obj: TouchObject) -> None:
    origin = np.array([0.05, -0.1, 0.35])
    directions = CENTRE + np.random.default_rng(2).uniform(-0.06, 0.06, (1500, 3)) - origin
    hits = cast(obj, origin, directions)
    hit = np.isfinite(hits.depth)
    assert 200 < hit.sum() < 1400
    on = hit & (hits.face == 0)
    distance, normal = obj.signed_distance(origin + hits.depth[on, None] * directions[on])
    np.testing.assert_allclose(distance, 0.0, atol=3e-6)
    np.testing.assert_allclose(hits.normal[on], normal, atol=1e-3)
    assert ((hits.normal[hit] * directions[hit]).sum(axis=1) < 1e-3).all()
    along = origin + np.linspace(0.6, 1.6, 80)[:, None, None] * directions[~hit]
    bodies = obj.signed_distance(along)[0]
    if obj.shape == "box_edge":
        depth = (along - CENTRE) @ obj.into_faces.T - BOX_FACE_M
        ends = np.abs((along - CENTRE) @ AXIS) - obj.half_length_m
        bodies = np.maximum(np.maximum(bodies, depth.max(axis=-1)), ends)
    assert bodies.min() > -1e-5


@pytest.mark.parametrize("obj", [box(), freeform()], ids=["box", "free form"])
def test_the_camera_sees_it_and_a_pressed_skin_is_drawn_back(obj: TouchObject) -> None:
    camera = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.14, 0.0, 0.36]))
    layer = object_layer(place(), obj, camera)
    assert layer is not None
    assert (layer.alpha > 0.99).sum() > 500
    assert np.isfinite(layer.brightness).all()
    outside = CENTRE - (0.05 * WEDGE if obj.shape == "box_edge" else np.array([0.0, 0.0, -0.05]))
    assert pressed_in(obj, 1e-3).signed_distance(outside)[0] > obj.signed_distance(outside)[0] + 5e-4


def _read(folder: Path, **changes: Any) -> TouchObject:
    """The object of a scene file; None takes a key out."""
    values = {"shape": "freeform", "center_world_m": [0.15, 0.0, 0.0], "radius_m": 0.03}
    bumps = [{"direction_world": [0, 2, 0], "height_m": 0.002, "width_m": 0.01}]
    scene = read_yaml(bundled_scene("demo")) | {"object": values | {"bumps": bumps} | changes}
    (folder / "scene.yaml").write_text(json.dumps(scene))
    return load_scene(folder / "scene.yaml").object


def test_the_scene_file_gives_both(tmp_path: Path) -> None:
    ball = _read(tmp_path)
    assert ball.shape == "freeform"
    np.testing.assert_allclose(ball.bumps[0].direction_world, [0, 1, 0])
    assert (ball.bumps[0].height_m, ball.bumps[0].width_m) == (0.002, 0.01)
    edge = _read(tmp_path, shape="box_edge", bumps=None, axis_world=[0, 0, 2], wedge_world=[1, 0, 1])
    np.testing.assert_allclose(edge.wedge_world, [1, 0, 0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"shape": "sphere"}, "bumps do not go with a sphere"),
        ({"bumps": []}, r"object.bumps: \[\] is not 1 or more"),
        (
            {"bumps": [{"direction_world": [0, 0, 0], "height_m": 0.002, "width_m": 0.01}]},
            "direction_world has no length",
        ),
        ({"bumps": [{"direction_world": [0, 1, 0], "height_m": 0.02, "width_m": 0.01}]}, "too steep"),
        ({"bumps": [{"direction_world": [0, 1, 0], "width_m": 0.01}]}, "height_m is missing"),
        ({"shape": "box_edge", "bumps": None, "axis_world": [0, 0, 1]}, "wedge_world"),
    ],
)
def test_wrong_objects_name_their_key(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        _read(tmp_path, **changes)


def test_bumps_belong_to_the_free_form() -> None:
    with pytest.raises(InputError, match="no bumps"):
        TouchObject("sphere", CENTRE, AXIS, 0.03, 1.0, bumps=BUMPS)
    with pytest.raises(InputError, match="unit vector"):
        Bump(np.array([0.0, 2.0, 0.0]), 1e-3, 0.01)
