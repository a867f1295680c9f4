"""Path-traced pictures: the surfaces that mitsuba is given, what it shows of them, and the labels beside them."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicSpline

from vbaa_calib.antenna.rod import solve_rod
from vbaa_calib.cli.main import main
from vbaa_calib.simulate.plan import AntennaShot, Plan, plan
from vbaa_calib.simulate.render.antenna import tube
from vbaa_calib.simulate.render.board import print_sheet
from vbaa_calib.simulate.render.meshes import Triangles, object_mesh, tube_mesh
from vbaa_calib.simulate.render.picture import studio
from vbaa_calib.simulate.scene.lens import project
from vbaa_calib.simulate.scene.objects import Bump, TouchObject
from vbaa_calib.simulate.scene.scene import Joints, SceneSpec, true_rod
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.simulate.shots import seen_antenna, wires_of
from vbaa_calib.simulate.traced.tracer import Exposure, Tracer, _load_mitsuba
from vbaa_calib.simulate.traced_shots import TracedPictures

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


def test_labels_show_what_was_drawn(tmp_path: Path) -> None:
    data = small_scene(noload=1, loads=(1,)) | {
        "picture": {"blur_px": 0.0, "read_noise": 0.0, "electrons_per_grey": 1e9}
    }
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(data))
    assert main(["simulate", str(tmp_path / "scene.yaml"), "-o", str(tmp_path / "s"), "--labels"]) == 0
    labels = tmp_path / "s" / "labels"
    rows = list(csv.DictReader((labels / "centrelines.csv").open()))
    contacts = {row["image"]: row for row in csv.DictReader((labels / "contacts.csv").open())}
    assert {row["image"] for row in rows} == set(contacts)
    assert {row["in_contact"] for row in contacts.values()} == {"0", "1"}
    for image, contact in contacts.items():
        mine = [row for row in rows if row["image"] == image]
        line = np.array([[float(row[name]) for name in ("s_m", "u_px", "v_px", "width_px")] for row in mine])
        seen = np.array([row["visible"] == "1" for row in mine])
        mask = cv2.imread(str(labels / image), cv2.IMREAD_UNCHANGED) / 255.0
        step = np.linalg.norm(np.gradient(line[:, 1:3], axis=0), axis=1)
        assert mask.sum() == pytest.approx((step * line[:, 3])[seen].sum(), rel=0.03)
        # where the mask says that all of a pixel is antenna, the picture is as bright as paint
        picture = cv2.imread(str(tmp_path / "s" / image), cv2.IMREAD_UNCHANGED)
        assert np.median(picture[mask > 0.99]) > 2 * np.median(picture[mask == 0])
        if contact["in_contact"] == "1":
            at = np.array([np.interp(float(contact["distance_m"]), line[:, 0], line[:, k]) for k in (1, 2)])
            assert at == pytest.approx([float(contact["u_px"]), float(contact["v_px"])], abs=0.05)


def _small(folder: Path, traced: dict[str, object]) -> SceneSpec:
    (folder / "scene.yaml").write_text(yaml.safe_dump(small_scene(1, (3,)) | {"traced": traced}))
    return load_scene(folder / "scene.yaml")


def _recorded(planned: Plan) -> list[AntennaShot]:
    shots = [shot for shot in planned.shots if isinstance(shot, AntennaShot)]
    return [shot for shot in shots if shot.path.startswith("recording/")]


def test_the_parts_of_an_antenna_make_up_the_whole(tmp_path: Path) -> None:
    scene = _small(tmp_path, {})
    shot = _recorded(plan(scene))[2]
    s = shot.arclength_m
    parts = wires_of(scene, s, shot.points_m)[0].cut(np.array([s[0], 0.1201, 0.13, s[-1]]))
    assert [(part.arclength_m[0], part.arclength_m[-1]) for part in parts] == [
        (s[0], 0.1201),
        (0.1201, 0.13),
        (0.13, s[-1]),
    ]
    for part in parts:
        between = (part.arclength_m[1:] + part.arclength_m[:-1]) / 2
        curve = CubicSpline(part.arclength_m, part.points_m)
        assert curve(between) == pytest.approx(CubicSpline(s, shot.points_m)(between), abs=1e-8)


def test_each_row_shows_the_antenna_when_it_is_read(tmp_path: Path) -> None:
    scene = _small(tmp_path, {})
    still, rolled = _recorded(plan(scene)), _recorded(plan(scene, 0.5))
    assert np.array_equal(rolled[-1].points_m, still[-1].points_m)
    after = CubicSpline(still[2].arclength_m, still[2].points_m)(still[1].arclength_m)
    motion = after - still[1].points_m
    row = project(scene.lens, scene.T_antenna_camera.inverse() @ rolled[1].points_m)[:, 1]
    share = 0.5 * (row / (scene.lens.image_size[1] - 1) - 0.5)
    assert np.abs(share).max() > 0.01
    assert np.abs(motion).max() > 1e-3
    assert rolled[1].points_m == pytest.approx(still[1].points_m + share[:, None] * motion, abs=1e-7)


# --- what mitsuba shows


def test_each_stretch_has_its_own_surface(tmp_path: Path) -> None:
    pytest.importorskip("mitsuba", reason="the extra `render` is not installed")
    stretches = [[0.03, 0.07, "paint", [0.9, 0.9, 0.9], 2e-4], [0.16, 1.0, "none", None, 0.0]]
    stretches += [[0.0, 0.03, "clear", None, 0.0]]
    lit = {"light": "side", "bench_roughness": 0.1, "bench_below_m": 0.3, "exposure": 2.0, "samples": 64}
    scene = _small(tmp_path, lit | {"material": "rubber", "stretches": stretches})
    rng, place = np.random.default_rng(0), studio(scene.lens, scene.picture, np.random.default_rng(0))
    shot = plan(scene).shots[-1]
    assert isinstance(shot, AntennaShot)
    free = replace(shot, indentation_m=None)
    camera = TracedPictures(scene, place, print_sheet(scene.board), rng)
    picture = camera.shot(free, None, rng).astype(np.float32)
    seen = seen_antenna(scene, free)

    def brightness(aside_px: float) -> np.ndarray:
        at = (seen.pixels + aside_px * seen.normals)[:, None].astype(np.float32)
        return cv2.remap(picture, at, np.empty(0), cv2.INTER_LINEAR).ravel()

    s, bench = np.linspace(0.0, shot.arclength_m[-1], len(seen.pixels)), (brightness(9.0) + brightness(-9.0)) / 2
    painted, rubber, gone = (
        float(np.median((brightness(0.0) / bench)[(s > low) & (s < high)]))
        for low, high in ((0.035, 0.065), (0.08, 0.15), (0.17, 1.0))
    )
    assert painted > 1.5
    assert rubber < 0.8
    assert gone == pytest.approx(1.0, abs=0.15)
    # a picture of the board has no antenna
    assert camera.shot(plan(scene).shots[0], None, rng).shape == picture.shape


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
    tracer = Tracer(_load_mitsuba(), scene, rays, {}, 1.0)
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
