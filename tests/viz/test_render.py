"""Pictures, pages and glTF: what is drawn can be seen, and a machine without OpenGL is told so."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from viz.render import probe
from viz.scene.layout import LOOK
from viz.scene.scene import Scene

from ..lazy import Lazy

pv = Lazy("pyvista")
assemble = Lazy("viz.parts.assemble")
gltf = Lazy("viz.render.gltf")
sheet = Lazy("viz.render.screenshot")
stages = Lazy("viz.render.stage")
window = Lazy("viz.render.window")


@pytest.fixture
def no_opengl(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A machine on which the probe dies as VTK does."""
    monkeypatch.setattr(probe, "PROBE", (sys.executable, "-c", "import os; os.abort()"))
    probe.can_render.cache_clear()
    yield
    probe.can_render.cache_clear()


@pytest.fixture
def opengl() -> None:
    if not probe.can_render():
        pytest.skip("OpenGL does not work here: install libegl1 libgl1-mesa-dri")


def close_to(pixels: np.ndarray, colour: str, tolerance: int = 60) -> np.ndarray:
    return np.abs(pixels.astype(int) - pv.Color(colour).int_rgb).max(axis=-1) < tolerance


@pytest.mark.usefixtures("opengl")
def test_the_picture_shows_rig_and_contacts(scene: Scene, tmp_path: Path) -> None:
    sheet.screenshot(scene, tmp_path / "scene.png")
    pixels = cv2.imread(str(tmp_path / "scene.png"))[..., ::-1]
    layout = sheet.SHEET
    assert pixels.shape == (layout.tall, layout.wide, 3)
    rig = pixels[: layout.rig_size[1], : layout.left]
    near, strip = (pixels[: layout.near_size[1], layout.left :], pixels[layout.near_size[1] :, layout.left :])
    assert close_to(rig, LOOK["camera"][0]).sum() > 100
    assert close_to(rig, "#0af014").sum() > 100  # the camera's picture of the greatest force
    assert close_to(near, LOOK["antenna"][0]).sum() > 500
    assert (
        close_to(pixels[layout.rig_size[1] :, : layout.left], LOOK["cones"][0], 10).sum() > 100
    )  # its mark in the legend
    # the ends of the scales of force and surface
    assert all(close_to(strip, colour, 12).sum() > 60 for colour in ("#0d0887", "#f9e721", "#085ba0"))


@pytest.mark.parametrize("suffix", [".glb", pytest.param(".gltf", marks=pytest.mark.slow)])
def test_gltf_is_sound_and_comes_back_without_opengl(
    scene: Scene, tmp_path: Path, no_opengl: None, suffix: str
) -> None:
    path = tmp_path / f"scene{suffix}"
    gltf.write_gltf(scene, path)
    data = path.read_bytes()
    if suffix == ".glb":
        magic, version, size, length, kind = struct.unpack("<4sIII4s", data[:20])
        assert (magic, version, size, kind) == (b"glTF", 2, len(data), b"JSON")
        made = json.loads(data[20 : 20 + length])
        size, kind = struct.unpack("<I4s", data[20 + length : 28 + length])
        assert (kind, size) == (b"BIN\0", len(data) - length - 28)
        assert made["buffers"][0]["byteLength"] <= size
    else:
        made = json.loads(data)
    assert {node.get("name") for node in made["nodes"]} >= set(LOOK) - {"now", "framewise", "other"}
    for view in made["bufferViews"]:
        assert view["byteOffset"] + view["byteLength"] <= made["buffers"][0]["byteLength"]
        assert view["byteOffset"] % 4 == 0
    for primitive in (mesh["primitives"][0] for mesh in made["meshes"]):
        assert {"POSITION", "NORMAL"} <= set(primitive["attributes"])
        factor = made["materials"][primitive["material"]]["pbrMetallicRoughness"]["baseColorFactor"]
        assert ("COLOR_0" in primitive["attributes"]) <= (factor == [1, 1, 1, 1])
        assert (made["materials"][primitive["material"]].get("alphaMode") == "BLEND") == (factor[3] < 1)
    world = next(node for node in made["nodes"] if node.get("name") == "world")
    turn = np.reshape(world["matrix"], (4, 4)).T[:3, :3]
    np.testing.assert_array_equal(turn @ [0, 0, 1], [0, 1, 0])
    read = pv.read(path).combine()
    whole = stages.Stage(scene, [part for part in assemble.all_parts(scene) if part.name != "now"])
    assert read.n_cells == sum(actor.mapper.dataset.n_cells for actor in whole.actors)


@pytest.mark.parametrize("close", [False, True])
def test_a_click_takes_the_contact_that_is_drawn_there(scene: Scene, no_opengl: None, close: bool) -> None:
    """By rays of a pinhole camera, worked out here without VTK's matrices."""
    stage = stages.Stage(scene, assemble.all_parts(scene), size=(700, 500))
    controls, points = window._Controls(stage, "force"), scene.contacts.points_m
    controls.close = not close
    controls.look_closer()
    camera = stage.plotter.camera
    centre = np.array(camera.position)
    ahead = np.subtract(camera.focal_point, centre) / camera.distance
    right = np.cross(ahead, camera.up) / np.linalg.norm(np.cross(ahead, camera.up))
    up = np.cross(right, ahead)
    scale = 250 / np.tan(np.radians(camera.view_angle / 2))
    offset = points - centre
    pixels = [350, 250] + scale * np.column_stack([offset @ right, offset @ up]) / (offset @ ahead)[:, None]
    for index, (x, y) in enumerate(pixels):
        ray = ahead + (x - 350) / scale * right + (y - 250) / scale * up
        along = offset @ ray / np.linalg.norm(ray)
        inside = scene.ball_m**2 - (offset**2).sum(axis=1) + along**2
        front = np.where(inside >= 0, along - np.sqrt(np.maximum(inside, 0)), np.inf).argmin()
        assert controls.contact_at(x, y) == front
        assert close or controls.contact_at(x + 40, y + 400) is None, index
    stage.plotter.close()
