"""The reconstructed object in its files, as other programs read them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimator.object.surface import Surface, reconstruct
from estimator.table.contacts import ContactTable

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


def test_a_ply_has_the_shape(surface: Surface, tmp_path: Path) -> None:
    object_file.write_object(surface, tmp_path / "object.ply")
    mesh = pv.read(tmp_path / "object.ply")
    np.testing.assert_allclose(mesh.points, surface.points_m, atol=1e-6)
    np.testing.assert_array_equal(mesh.regular_faces, surface.triangles)


def test_a_glb_has_the_shape_with_y_up(surface: Surface, tmp_path: Path) -> None:
    object_file.write_object(surface, tmp_path / "object.glb")
    mesh = pv.read(tmp_path / "object.glb").combine()
    corners = surface.points_m[np.unique(surface.triangles)][:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(
        mesh.bounds, np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1).ravel(), atol=1e-6
    )
