"""The scene: arrays and meshes in the right places, as large as they say, at the right instants; on its page, too."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from markupsafe import escape

from estimator.table.contacts import ContactTable, _from_points
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.render.meshes import object_mesh
from vbaa_calib.simulate.scene.objects import Bump, TouchObject
from viz.scene.readable import MODES
from viz.scene.scene import Scene, _instants_of, build_scene

from ..lazy import Lazy

if TYPE_CHECKING:
    from viz.parts.assemble import ScenePart

assemble = Lazy("viz.parts.assemble")
pages = Lazy("viz.render.page")


def test_a_long_recording_is_thinned_but_keeps_the_greatest_force(table: ContactTable) -> None:
    strongest = int(np.nanargmax(np.linalg.norm(table.force_world_N, axis=1)))
    for most in (2, 7, 40):
        instants = _instants_of(table, most=most)
        assert most <= len(instants) <= most + 1
        assert instants.row[instants.main] == strongest
        assert (np.diff(instants.row) > 0).all()


def with_joints(table: ContactTable, kinematics: Kinematics) -> ContactTable:
    """The table as the estimator writes it: with the joints of every frame."""
    angles = np.full((len(table), 2), (0.3, -0.2))
    here = table.located
    angles[here] = np.column_stack(_from_points(kinematics, table.point_antenna_m[here], table.point_world_m[here]))
    return replace(table, pan_rad=angles[:, 0], tilt_rad=angles[:, 1])


def test_contacts_of_another_rig_are_refused(rig: Rig, table: ContactTable) -> None:
    moved = replace(rig, kinematics=Kinematics(rig.kinematics.T_actuator_antenna, np.array([0.0, 0.0, 0.3])))
    for contacts in (table, with_joints(table, rig.kinematics)):
        with pytest.raises(InputError, match="do not fit the rig's kinematics"):
            build_scene(contacts, moved)


@pytest.mark.parametrize("distortion", [[], [-0.6, 0.0, 0.0, 0.0]], ids=["no distortion", "no rays in the corners"])
def test_the_drawn_picture_projects_to_the_picture(rig: Rig, table: ContactTable, distortion: list[float]) -> None:
    rig = replace(rig, camera=Camera("opencv", (960, 720), rig.camera.matrix, np.array(distortion)))
    picture_m = build_scene(table, rig).rig.picture_m
    grid = rig.T_antenna_camera.inverse() @ picture_m
    np.testing.assert_allclose(grid[..., 2], grid[0, 0, 2])
    if not distortion:
        pixels, valid = rig.camera.project(grid.reshape(-1, 3))
        assert valid.all()
        pixels = pixels.reshape((*grid.shape[:2], 2))
        np.testing.assert_allclose(pixels[[0, -1], [0, -1]], [[-0.5, -0.5], [959.5, 719.5]], atol=1e-6)
        assert (np.diff(pixels[..., 0], axis=1) > 0).all()
        assert (np.diff(pixels[..., 1], axis=0) > 0).all()


def named(parts: list[ScenePart], name: str) -> ScenePart:
    return next(part for part in parts if part.name == name)


def pieces(part: ScenePart, count: int) -> np.ndarray:
    """(count, P, 3) points of each of the stamped meshes."""
    return np.asarray(part.mesh.points, float).reshape(count, -1, 3)


CENTRE, AXIS, WEDGE = np.array([0.1, 0.2, 0.3]), np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
BUMPS = (Bump(np.array([0.0, -1.0, 0.0]), 0.002, 0.006), Bump(np.array([0.6, 0.0, 0.8]), -0.001, 0.004))


@pytest.mark.parametrize("shape", ["cylinder", "sphere", "knife_edge", "box_edge", "freeform"])
def test_true_objects_lie_on_what_was_simulated(shape: str) -> None:
    bumps = BUMPS if shape == "freeform" else ()
    radius = 0.02 if shape == "freeform" else 0.002
    body = TouchObject(shape, CENTRE, AXIS, radius, 0.05, wedge_world=WEDGE, bumps=bumps)
    points = object_mesh(body, rings=64).vertices
    off, _ = body.signed_distance(points[::7])
    if shape != "knife_edge":  # a blade of 6 degrees is drawn where a rounded line is touched
        # the caps and the box's back lie inside
        assert off.max() < 2e-6
        assert np.mean(np.abs(off) < 2e-6) > 0.9
    if shape not in ("sphere", "freeform"):
        along_axis = (points - CENTRE) @ AXIS
        np.testing.assert_allclose([along_axis.min(), along_axis.max()], [-0.05, 0.05], atol=1e-6)


ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def written(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "scene.html"
    pages.write_page(scene, path, title="A & B <touch>")
    return path


def test_the_page_is_whole_offline_and_has_its_legend(scene: Scene, written: Path) -> None:
    text = written.read_text()
    assert "<title>A &amp; B &lt;touch&gt;</title>" in text
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//""", text)
    legend = text.partition('id="legend"')[2].partition('id="time"')[0]
    for part in assemble.all_parts(scene):
        assert str(escape(part.label)) in legend
    for words in ("90 contacts", "Friction &lt;is&gt; told.", "std of the surface, mm", *MODES):
        assert words in legend
    assert pages._CLEAR in text
    assert pages._ICON not in text
    head = text.partition("<script")[0]
    assert "default-src 'none'" in head
    assert "http" not in head.partition('content="default-src')[2].partition('"')[0]
    assert 1_200_000 < len(text) < 6_000_000


def test_every_page_forbids_requests() -> None:
    """Templates of whole pages have a policy, before anything that could ask for something."""
    pages = [path for top in ("viz", "estimator") for path in (ROOT / top).rglob("*.html.j2")]
    whole = [text for path in pages if "<html" in (text := path.read_text(encoding="utf-8"))]
    assert len(whole) == 2
    for text in whole:
        head, _, rest = text.partition("Content-Security-Policy")
        assert rest.startswith("\" content=\"default-src 'none';")
        assert not any(tag in head for tag in ("<script", "<style", "<link", "<img"))
