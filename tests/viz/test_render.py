"""Meshes, pictures and pages: what is drawn can be seen, and a machine without OpenGL is told so."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista as pv

from estimator.surface import reconstruct
from estimator.table import ContactTable
from vbaa_calib.errors import InputError, VbaaError
from vbaa_calib.rig import Rig
from viz import actors, render
from viz.object_file import read_object, to_mesh, write_object
from viz.ply import is_whole
from viz.rig_items import rig_items
from viz.scene import ObjectMesh, Scene, TruthObject, build_scene, truth_object

from .touching import ANTENNA_RADIUS_M


@pytest.fixture(scope="module")
def scene(table: ContactTable, rig: Rig, truth: dict[str, Any]) -> Scene:
    surface = ObjectMesh.of(reconstruct(table, ANTENNA_RADIUS_M))
    return build_scene(table, rig=rig_items(rig, table), surface=surface, truth=truth_object(truth))


@pytest.fixture
def no_opengl(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A machine on which the probe dies as VTK does."""
    monkeypatch.setattr(render, "PROBE", (sys.executable, "-c", "import os; os.abort()"))
    render.can_render.cache_clear()
    yield
    render.can_render.cache_clear()


@pytest.fixture
def opengl() -> None:
    if not render.can_render():
        pytest.skip("OpenGL does not work here: install libegl1 libgl1-mesa-dri")


def close_to(pixels: np.ndarray, colour: str, tolerance: int = 60) -> np.ndarray:
    return np.abs(pixels.astype(int) - pv.Color(colour).int_rgb).max(axis=-1) < tolerance


@pytest.mark.usefixtures("opengl")
def test_the_picture_shows_rig_and_contacts(scene: Scene, tmp_path: Path) -> None:
    render.screenshot(scene, tmp_path / "scene.png")
    pixels = np.asarray(pv.read(tmp_path / "scene.png").active_scalars).reshape(1040, 1900, -1)[..., :3]
    left, right = pixels[:, :798], pixels[:, 798:]
    assert close_to(left, actors.CAMERA).sum() > 200
    red, green, blue = (right[..., i].astype(int) for i in range(3))
    teal = (green - red > 40) & (blue - red > 30) & (green >= blue - 10)
    assert teal.sum() > 5000
    assert close_to(right, actors.ANTENNA).sum() > 500
    low, high = "#0d0887", "#f0f921"  # the ends of the scale, which the scalar bar shows
    assert close_to(right, low, 25).sum() > 100
    assert close_to(right, high, 25).sum() > 100


def test_arrows_begin_at_the_contacts_and_run_along_the_force(table: ContactTable) -> None:
    contacts = build_scene(table).contacts
    plotter = pv.Plotter(off_screen=True)
    actors.add_scene(plotter, build_scene(table), scalar_bar=False)
    arrows = plotter.meshes[-1].points.reshape(len(contacts.points_m), -1, 3) - contacts.points_m[:, None]
    along = np.einsum("aki,ai->ak", arrows, contacts.force_N / np.linalg.norm(contacts.force_N, axis=1, keepdims=True))
    plotter.close()
    np.testing.assert_allclose(along.min(axis=1), 0.0, atol=1e-6)
    np.testing.assert_allclose(along.max(axis=1) / along.max(), contacts.size_mN / contacts.size_mN.max(), atol=1e-4)


def test_without_opengl_the_picture_says_what_to_install(scene: Scene, tmp_path: Path, no_opengl: None) -> None:
    with pytest.raises(VbaaError, match="libegl1"):
        render.screenshot(scene, tmp_path / "scene.png")
    assert not list(tmp_path.iterdir())


def test_a_probe_that_cannot_start_is_no_opengl(monkeypatch: pytest.MonkeyPatch, no_opengl: None) -> None:
    monkeypatch.setattr(render, "PROBE", ("/nonexistent/python",))
    assert not render.can_render()


def test_the_page_is_whole_offline_and_has_its_legend_even_without_opengl(
    scene: Scene, tmp_path: Path, no_opengl: None
) -> None:
    render.write_page(scene, tmp_path / "scene.html", title="A & B <touch>")
    page = (tmp_path / "scene.html").read_text()
    assert "<title>A &amp; B &lt;touch&gt;</title>" in page
    assert not re.search(r"""(src|href)\s*=\s*["'](https?:)?//""", page)
    for part in actors.parts(scene):
        assert actors.LOOK[part][1] in page
    low, high = actors.force_range_mN(scene)
    assert f"{low:g} mN" in page
    assert f"{high:g} mN" in page
    assert "90 contacts" in page
    assert len(page) > 1_200_000


def test_a_scene_of_contacts_alone_makes_a_page(table: ContactTable, tmp_path: Path) -> None:
    render.write_page(build_scene(table), tmp_path / "scene.html", title="contacts")
    page = (tmp_path / "scene.html").read_text()
    assert actors.LOOK["camera"][1] not in page.partition('class="content"')[0].partition('id="vbaa"')[2]


def test_a_picture_by_another_name_is_refused(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is not a \.png"):
        render.screenshot(scene, tmp_path / "scene.gif")


def test_the_force_scale_holds_all_forces(scene: Scene) -> None:
    low, high = actors.force_range_mN(scene)
    assert low <= scene.contacts.size_mN.min() < scene.contacts.size_mN.max() <= high
    assert (low, high) == (20.0, 80.0)


@pytest.mark.parametrize("shape", ["cylinder", "sphere", "knife_edge"])
def test_true_objects_have_their_size(shape: str) -> None:
    centre, axis, wedge = np.array([0.1, 0.2, 0.3]), np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    mesh = actors.truth_mesh(TruthObject(shape, centre, axis, wedge, 0.002, 0.05))
    offset = mesh.points - centre
    if shape == "sphere":
        np.testing.assert_allclose(np.linalg.norm(offset, axis=1), 0.002, rtol=1e-4)
        return
    assert np.abs(offset @ axis).max() == pytest.approx(0.05, rel=1e-5)
    across = offset @ wedge
    assert across.min() == pytest.approx(-0.002, rel=1e-2)
    assert across.max() == pytest.approx(0.05 if shape == "knife_edge" else 0.002, rel=1e-2)


@pytest.mark.parametrize("suffix", [".vtp", ".ply"])
def test_an_object_comes_back_from_its_file(table: ContactTable, tmp_path: Path, suffix: str) -> None:
    surface = reconstruct(table, ANTENNA_RADIUS_M)
    path = tmp_path / f"object{suffix}"
    write_object(surface, path)
    back = read_object(path)
    np.testing.assert_allclose(back.points_m, surface.points_m, atol=1e-7)
    np.testing.assert_array_equal(back.triangles, surface.triangles)
    # VTK reads no normals from a .ply: there they are the triangles'
    assert (np.sum(back.normals * surface.normals, axis=1) > 0.85).all()
    if suffix == ".vtp":
        np.testing.assert_allclose(back.normals, surface.normals, atol=1e-6)
        mesh = pv.read(path)
        np.testing.assert_allclose(mesh["std_m"], surface.std_m)
        np.testing.assert_allclose(mesh["force_N"], surface.force_N)
        np.testing.assert_array_equal(mesh["frame"], surface.frame)


def test_a_line_comes_back_as_a_line(table: ContactTable, tmp_path: Path) -> None:
    surface = reconstruct(table, ANTENNA_RADIUS_M)
    line = np.stack([np.arange(9), np.arange(1, 10)], axis=1)
    only_line = type(surface)(**{**vars(surface), "triangles": np.empty((0, 3), int), "lines": line})
    write_object(only_line, tmp_path / "object.vtp")
    back = read_object(tmp_path / "object.vtp")
    assert len(back.triangles) == 0
    np.testing.assert_array_equal(back.lines, line)
    assert pv.read(tmp_path / "object.vtp").n_verts == len(surface.points_m) - 10


@pytest.mark.parametrize("name", ["object.vtp", "object.ply"])
def test_a_broken_object_file_is_refused(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / name).write_text("junk")
    with pytest.raises(InputError, match="holds no mesh"):
        read_object(tmp_path / name)
    with pytest.raises(InputError, match="no such file"):
        read_object(tmp_path / f"other-{name}")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("binary", [True, False])
def test_a_ply_is_read_whole_or_not_at_all(table: ContactTable, tmp_path: Path, binary: bool) -> None:
    path = tmp_path / "object.ply"
    to_mesh(reconstruct(table, ANTENNA_RADIUS_M)).save(path, binary=binary)
    whole = path.read_bytes()
    assert is_whole(whole)
    body = whole.index(b"end_header") + 11
    # VTK would read past the end of each of these
    for length in (0, 3, body - 40, body - 1, body, body + 1, (body + len(whole)) // 2, len(whole) - 30):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match="holds no mesh"):
            read_object(path)


def test_a_big_endian_ply_is_walked_with_its_lists() -> None:
    header = "ply\nformat binary_big_endian 1.0\nelement face 2\nproperty list ushort int vertex_indices\nend_header\n"
    rows = b"".join(np.array([3], ">u2").tobytes() + np.zeros(3, ">i4").tobytes() for _ in range(2))
    assert is_whole(header.encode() + rows)
    assert not is_whole(header.encode() + rows[:-1])
    assert not is_whole(header.encode() + rows[:14])
    assert not is_whole(header.encode().replace(b"ushort", b"wide") + rows)


@pytest.mark.parametrize("index", [99, -2])
def test_cells_of_points_that_are_not_there_are_refused(tmp_path: Path, index: int) -> None:
    path = tmp_path / "object.ply"
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{properties}element face 1\nproperty list uchar int vertex_indices\n"
        f"end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 {index}\n"
    )
    with pytest.raises(InputError, match="holds no mesh"):
        read_object(path)
    path.write_text(path.read_text().replace(f"1 {index}\n", "1 2\n"))
    assert read_object(path).triangles.tolist() == [[0, 1, 2]]
