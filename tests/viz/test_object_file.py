"""The reconstructed object in its files: what comes back, and what is refused."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkIOGeometry import vtkGLTFReader

from estimator.object.surface import Surface, reconstruct
from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError
from viz.files.object_file import _to_mesh, read_object, write_object

from .touching import ANTENNA_RADIUS_M


@pytest.fixture(scope="module")
def surface(table: ContactTable) -> Surface:
    return reconstruct(table, ANTENNA_RADIUS_M)


def test_a_vtp_holds_all_that_is_known(surface: Surface, tmp_path: Path) -> None:
    write_object(surface, tmp_path / "object.vtp")
    mesh = pv.read(tmp_path / "object.vtp")
    np.testing.assert_allclose(mesh["std_m"], surface.std_m)
    np.testing.assert_array_equal(mesh["patch"], surface.patch)
    np.testing.assert_allclose(mesh.field_data["contact_point_m"], surface.touched_m)
    np.testing.assert_array_equal(mesh.field_data["contact_frame"], surface.touched_frame)
    np.testing.assert_allclose(
        mesh.field_data["contact_normal_covariance_rad2"].reshape(-1, 3, 3), surface.touched_normal_covariance
    )
    assert list(mesh.field_data["stiffness_in_words"]) == [surface.compliance.reason]


def test_vtk_reads_the_glb_upright_in_metres(surface: Surface, tmp_path: Path) -> None:
    path = tmp_path / "object.glb"
    write_object(surface, path)
    reader = vtkGLTFReader()
    reader.SetFileName(str(path))
    reader.ApplyDeformationsToGeometryOn()
    reader.Update()
    mesh = pv.wrap(reader.GetOutput()).combine().extract_surface(algorithm=None)
    low, high = surface.points_m.min(axis=0), surface.points_m.max(axis=0)
    # z up has become y up: (x, y, z) → (x, z, −y)
    np.testing.assert_allclose(mesh.bounds, [low[0], high[0], low[2], high[2], -high[1], -low[1]], atol=1e-6)
    assert mesh.n_cells == len(surface.triangles)


def test_a_glb_keeps_to_the_format(surface: Surface, tmp_path: Path) -> None:
    """glTF 2.0: chunks padded to 4 bytes, ends of positions, views inside the buffer, unit normals, no NaN."""
    unknown = Surface(**{**vars(surface), "std_m": np.full(len(surface.points_m), np.nan)})
    write_object(unknown, tmp_path / "object.glb")
    data = (tmp_path / "object.glb").read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    made = json.loads(data[20 : 20 + size], parse_constant=pytest.fail)
    assert struct.unpack_from("<I", data, 8)[0] == len(data)
    assert size % 4 == len(data) % 4 == 0
    for view in made["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= made["buffers"][0]["byteLength"]
    attributes = made["meshes"][0]["primitives"][0]["attributes"]
    position = made["accessors"][attributes["POSITION"]]
    np.testing.assert_allclose(position["min"], surface.points_m.min(axis=0), atol=1e-6)
    back = read_object(tmp_path / "object.glb")
    np.testing.assert_allclose(np.linalg.norm(back.normals, axis=1), 1.0, atol=1e-5)
    assert np.isnan(back.std_m).all()


@pytest.mark.parametrize("binary", [True, False])
def test_a_ply_is_read_whole_or_not_at_all(surface: Surface, tmp_path: Path, binary: bool) -> None:
    path = tmp_path / "object.ply"
    _to_mesh(surface).save(path, binary=binary)
    whole = path.read_bytes()
    back = read_object(path)
    np.testing.assert_allclose(back.points_m, surface.points_m, atol=1e-4)
    np.testing.assert_array_equal(back.triangles, surface.triangles)
    body = whole.index(b"end_header") + 11
    for length in (0, 3, body - 40, body - 1, body, body + 1, (body + len(whole)) // 2, len(whole) - 30):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match="holds no mesh"):
            read_object(path)


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
