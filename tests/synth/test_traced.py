"""Path-traced pictures: the surfaces that mitsuba is given, what it shows of them, and the labels beside them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from vbaa_calib.antenna.rod import solve_rod
from vbaa_calib.simulate.render.antenna import tube
from vbaa_calib.simulate.render.meshes import Triangles, object_mesh, tube_mesh
from vbaa_calib.simulate.render.picture import studio
from vbaa_calib.simulate.scene.objects import Bump, TouchObject
from vbaa_calib.simulate.scene.scene import Joints, SceneSpec, true_rod
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.simulate.traced import Exposure, _load_mitsuba, _Tracer

from ..small_scene import small_scene

X, Y, Z = np.eye(3)
BUMPS = (Bump(Y, 0.004, 0.012), Bump(-X, -0.003, 0.01))
OBJECTS = (
    TouchObject("cylinder", np.array([0.1, 0.02, 0.1]), Z, 0.02, 0.05),
    TouchObject("sphere", np.zeros(3), Z, 0.03, 0.1),
    TouchObject("knife_edge", np.array([0.1, 0.0, 0.0]), Z, 0.001, 0.04, wedge_world=Y),
    TouchObject("box_edge", np.array([0.1, 0.0, 0.0]), Z, 0.004, 0.04, wedge_world=X),
    TouchObject("freeform", np.array([0.1, 0.0, 0.0]), Z, 0.03, 0.1, bumps=BUMPS),
)


def _volume(shape: Triangles) -> float:
    """By the divergence theorem: positive only where the faces are counter-clockwise seen from outside."""
    a, b, c = (shape.vertices[shape.faces[:, k]] - shape.vertices.mean(axis=0) for k in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def test_a_tube_is_closed_and_its_axis_is_the_curve() -> None:
    s = np.linspace(0.0, 0.2, 40)
    points = np.stack([0.1 * np.sin(s / 0.1), 0.02 * np.cos(s / 0.1), 0.1 - 0.1 * np.cos(s / 0.1)], axis=1)
    shape = tube_mesh(s, points, 0.0005, 0.001)
    rings = shape.vertices[: -2 * 32].reshape(-1, 32, 3)
    fine = tube_mesh(s, points, 1e-9, 0.0001).vertices[: -2 * 32].reshape(-1, 32, 3).mean(axis=1)
    length = np.linalg.norm(np.diff(fine, axis=0), axis=1).sum()
    assert np.linalg.norm(rings.mean(axis=1)[[0, -1]] - points[[0, -1]], axis=1).max() < 1e-9
    assert _volume(shape) == pytest.approx(np.pi * 0.0005**2 * length, rel=0.01)
    outward = np.einsum(
        "vi,vi->v", shape.normals[: -2 * 32], (rings - rings.mean(axis=1, keepdims=True)).reshape(-1, 3)
    )
    assert outward == pytest.approx(0.0005, rel=1e-6)


@pytest.mark.parametrize("obj", OBJECTS, ids=lambda obj: obj.shape)
def test_an_objects_surface_is_the_one_that_is_touched(obj: TouchObject) -> None:
    shape = object_mesh(obj)
    middles = shape.vertices[shape.faces].mean(axis=1)
    assert _volume(shape) > 0
    # ends and backs are no part of what is touched: there the surface is only inside of it
    distance = obj.signed_distance(middles)[0]
    if obj.shape == "knife_edge":
        # a blade of 6° is drawn where a rounded line is touched
        assert distance[shape.normals[shape.faces[:, 0]] @ obj.wedge_world < -0.99] == pytest.approx(0.0, abs=1e-3)
        return
    assert distance.max() < 2e-5
    along = (middles - obj.center_world_m) @ obj.axis_world
    touched = np.abs(along) < obj.half_length_m - 1e-3 if obj.shape in ("cylinder", "box_edge") else distance > -1
    if obj.shape == "box_edge":
        touched &= (middles - obj.center_world_m) @ obj.wedge_world < 0.01
    assert np.abs(distance[touched]).max() < 2e-5


# --- what mitsuba shows


@pytest.fixture
def traced_scene(tmp_path: Path) -> SceneSpec:
    pytest.importorskip("mitsuba", reason="the extra `render` is not installed")
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(small_scene(1, (1,)) | {"traced": {"samples": 64}}))
    return load_scene(tmp_path / "scene.yaml")


def _centroids(picture: np.ndarray, pixels: np.ndarray, normals: np.ndarray, reach: float) -> np.ndarray:
    """(N,) offset of the picture's centroid across a line from points on it."""
    t = np.arange(-reach, reach + 0.01, 0.05)
    at = (pixels[:, None] + t[:, None] * normals[:, None]).astype(np.float32)
    profile = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    return (profile * t).sum(axis=1) / profile.sum(axis=1)


def test_a_traced_antenna_lies_where_its_truth_says(traced_scene: SceneSpec) -> None:
    # an independent route: the centroid of a white tube on black, through a distorted lens
    scene, rays = traced_scene, studio(traced_scene.lens, traced_scene.picture, np.random.default_rng(0)).rays
    rod, joints = true_rod(scene), Joints(0.3, -0.2)
    shape = solve_rod(rod, np.zeros((1, 3)), np.array([0.2]), np.array([[0.0, 0.05, 0.0]]))
    curve = (shape.arclength_m[0], shape.points_m[0], scene.radius_m)
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.9}}
    poses = scene.T_world_camera(joints), scene.T_world_antenna(joints)
    tracer = _Tracer(_load_mitsuba(), scene, rays, {}, 1.0)
    # a lamp in the camera lights both flanks alike
    lamp = {
        "type": "point",
        "position": tracer.at(poses[0].translation_m).tolist(),
        "intensity": {"type": "rgb", "value": 1e5},
    }
    picture = tracer.picture([Exposure(*poses, [(*curve, white)])], {"lamp": lamp}, 1)
    seen = tube(scene.lens, curve[0], scene.T_antenna_camera.inverse() @ curve[1], scene.radius_m, Z)
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7)
    inner = slice(20, -20, 4)
    offset = _centroids(picture[..., 1], seen.pixels[inner], seen.normals[inner], 4.0)
    assert abs(offset.mean()) < 0.01
    assert np.sqrt((offset**2).mean()) < 0.03
