"""The reconstructed object in its files: what comes back, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimator.object.surface import Surface, reconstruct
from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError

from ..lazy import Lazy
from .touching import ANTENNA_RADIUS_M

pv = Lazy("pyvista")
object_file = Lazy("viz.files.object_file")


@pytest.fixture(scope="module")
def surface(table: ContactTable) -> Surface:
    return reconstruct(table, ANTENNA_RADIUS_M)


def test_a_vtp_holds_all_that_is_known(surface: Surface, tmp_path: Path) -> None:
    object_file.write_object(surface, tmp_path / "object.vtp")
    mesh = pv.read(tmp_path / "object.vtp")
    np.testing.assert_allclose(mesh["std_m"], surface.std_m)
    np.testing.assert_array_equal(mesh["patch"], surface.patch)
    np.testing.assert_allclose(mesh.field_data["contact_point_m"], surface.touched_m)
    np.testing.assert_array_equal(mesh.field_data["contact_frame"], surface.touched_frame)
    np.testing.assert_allclose(
        mesh.field_data["contact_normal_covariance_rad2"].reshape(-1, 3, 3), surface.touched_normal_covariance
    )
    assert list(mesh.field_data["stiffness_in_words"]) == [surface.compliance.reason]


@pytest.mark.parametrize("binary", [True, False])
def test_a_ply_is_read_whole_or_not_at_all(surface: Surface, tmp_path: Path, binary: bool) -> None:
    path = tmp_path / "object.ply"
    pv.PolyData(object_file._to_mesh(surface)).save(path, binary=binary)
    whole = path.read_bytes()
    back = object_file.read_object(path)
    np.testing.assert_allclose(back.points_m, surface.points_m, atol=1e-4)
    np.testing.assert_array_equal(back.triangles, surface.triangles)
    body = whole.index(b"end_header") + 11
    for length in (0, 3, body - 40, body - 1, body, body + 1, (body + len(whole)) // 2, len(whole) - 30):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match="holds no mesh"):
            object_file.read_object(path)
