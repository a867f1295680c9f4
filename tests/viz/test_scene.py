"""The scene as arrays: in the right places, at the right instants, without pyvista."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.table.contacts import ContactTable, _from_points
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import Rig
from viz.scene.scene import _instants_of, build_scene


@pytest.mark.parametrize(("column", "value"), [("force_world_N", 1e300), ("point_world_m", -1e6)])
def test_what_no_antenna_reaches_is_refused(table: ContactTable, column: str, value: float) -> None:
    numbers = getattr(table, column).copy()
    numbers[3, 1] = value
    with pytest.raises(InputError, match="frame 3 has a contact beyond"):
        _instants_of(replace(table, **{column: numbers}))


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


def test_poses_come_from_the_joints_and_without_them_from_the_contacts(rig: Rig, table: ContactTable) -> None:
    bare = replace(table, pan_rad=np.full(len(table), np.nan), tilt_rad=np.full(len(table), np.nan))
    given, found = (build_scene(contacts, rig).rig.poses for contacts in (with_joints(table, rig.kinematics), bare))
    np.testing.assert_allclose(found[:90], given[:90], atol=1e-9)
    assert np.isfinite(given).all()
    # nothing says where the rig stood without contact
    assert np.isnan(found[90:]).all()


def test_contacts_of_another_rig_are_refused(rig: Rig, table: ContactTable) -> None:
    moved = replace(rig, kinematics=Kinematics(rig.kinematics.T_actuator_antenna, np.array([0.0, 0.0, 0.3])))
    for contacts in (table, with_joints(table, rig.kinematics)):
        with pytest.raises(InputError, match="do not fit the rig's kinematics"):
            build_scene(contacts, moved)


def test_the_drawn_antenna_is_as_long_as_the_antenna_and_bends_from_its_free_shape(
    rig: Rig, table: ContactTable
) -> None:
    table = with_joints(table, rig.kinematics)
    scene = build_scene(table, rig)
    items = scene.rig
    for shapes in (items.bent_m, items.free_m):
        length = np.linalg.norm(np.diff(shapes, axis=1), axis=2).sum(axis=1)
        np.testing.assert_allclose(length, 0.24, rtol=1e-3)
    np.testing.assert_allclose(items.bent_m[:, 0], items.free_m[:, 0], atol=1e-9)
    # the tip goes where the force pushes
    aside = items.bent_m[:90, -1] - items.free_m[:90, -1]
    assert (np.einsum("mi,mi->m", aside, table.force_world_N[:90]) > 0).all()
    np.testing.assert_array_equal(items.bent_m[90:], items.free_m[90:])
    assert len(items.ghosts) in (5, 6)
    assert scene.instants.main not in items.ghosts


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


def test_the_picture_shows_antenna_and_contact_where_the_camera_has_them(rig: Rig, table: ContactTable) -> None:
    """The clamp and every contact; nothing where there is no contact."""
    scene = build_scene(table, rig)
    seen = scene.rig.seen * rig.camera.image_size - 0.5
    clamp, _ = rig.camera.project(rig.T_antenna_camera.inverse() @ np.zeros((1, 3)))
    np.testing.assert_allclose(seen[:90, 0], np.tile(clamp, (90, 1)), atol=1e-6)
    points = np.pad(scene.contacts.points_m, ((0, 0), (0, 1)), constant_values=1.0)
    in_antenna = np.linalg.solve(scene.rig.poses[:90], points[..., None])[:, :3, 0]
    expected, valid = rig.camera.project(rig.T_antenna_camera.inverse() @ in_antenna)
    assert valid.all()
    np.testing.assert_allclose(seen[:90, -1], expected, atol=1e-6)
    assert np.isnan(seen[90:, -1]).all()
