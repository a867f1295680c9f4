"""The scene as arrays: in the right places, at the right moments, without pyvista."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from estimator.table.contacts import ContactRow, ContactTable
from estimator.table.joint_angles import from_points
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import Rig
from viz.scene.moments import moments_of
from viz.scene.rig_items import picture_grid, poses_at, rig_items
from viz.scene.scene import DrawnEstimate
from viz.scene.truth import true_object

from .scenes import bare_scene


def test_the_scene_needs_no_pyvista() -> None:
    code = "import sys, viz.scene, viz.report; sys.exit('pyvista' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_contacts_are_the_located_ones_with_their_deviations(table: ContactTable) -> None:
    contacts = bare_scene(table).contacts
    assert len(contacts.points_m) == 90
    np.testing.assert_allclose(contacts.size_mN, 50 + 30 * np.sin(0.3 * np.arange(90)), rtol=1e-6)
    np.testing.assert_allclose(contacts.std_mm, 0.4, rtol=1e-6)
    axes, std = contacts.principal
    back = np.einsum("pij,pj,pkj->pik", axes, std**2, axes)
    np.testing.assert_allclose(back, contacts.covariance_m2, atol=1e-18)


def test_what_was_touched_lies_in_its_ball(table: ContactTable) -> None:
    scene = bare_scene(table)
    centre, radius = scene.bounding_ball_m
    assert (np.linalg.norm(scene.contacts.points_m - centre, axis=1) <= radius + 1e-12).all()
    assert 0.02 < radius < 0.06


def test_normals_go_to_the_contacts_of_their_rows(table: ContactTable) -> None:
    rows = np.array([80, 3, 90])
    normals = np.eye(3)
    scene = bare_scene(table, DrawnEstimate(rows, normals))
    np.testing.assert_array_equal(scene.normals[[80, 3]], normals[:2])
    assert np.isnan(np.delete(scene.normals, [80, 3], axis=0)).all()


def test_every_frame_is_a_moment_with_its_words(table: ContactTable) -> None:
    moments = moments_of(table, phase=np.where(table.located, "sliding", "free"))
    assert len(moments) == 92
    np.testing.assert_allclose(moments.time_s, table.time_s - table.time_s[0])
    assert moments.main == np.nanargmax(np.linalg.norm(table.force_world_N, axis=1))
    assert moments.words[90] == "no contact"
    assert moments.words[91] == "failed"
    first = moments.words[0]
    assert first.startswith("sliding: ")
    assert f"{1e3 * table.distance_m[0]:.1f} ± 0.4 mm from the clamp" in first
    assert "50.0 mN" in first


@pytest.mark.parametrize(("column", "value"), [("force_world_N", 1e300), ("point_world_m", -1e6)])
def test_what_no_antenna_reaches_is_refused(table: ContactTable, column: str, value: float) -> None:
    numbers = getattr(table, column).copy()
    numbers[3, 1] = value
    with pytest.raises(InputError, match="frame 3 has a contact beyond"):
        moments_of(replace(table, **{column: numbers}))


def test_a_long_recording_is_thinned_but_keeps_the_greatest_force(table: ContactTable) -> None:
    strongest = int(np.nanargmax(np.linalg.norm(table.force_world_N, axis=1)))
    for most in (2, 7, 40):
        moments = moments_of(table, most=most)
        assert most <= len(moments) <= most + 1
        assert moments.row[moments.main] == strongest
        assert (np.diff(moments.row) > 0).all()


@pytest.mark.parametrize(("pan", "tilt"), [(0.0, 0.0), (0.7, -0.4), (-1.2, 1.3), (3.0, -1.1)])
def test_joint_angles_come_back_from_one_point_in_both_frames(kinematics: Kinematics, pan: float, tilt: float) -> None:
    point = np.array([0.15, 0.012, -0.02])
    found = from_points(kinematics, point[None], (kinematics.T_world_antenna(pan, tilt) @ point)[None])
    turn = (np.ravel(found) - (pan, tilt) + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(turn, 0.0, atol=1e-9)


def with_joints(table: ContactTable, kinematics: Kinematics) -> ContactTable:
    """The table as the estimator writes it: with the joints of every frame."""
    angles = np.full((len(table), 2), (0.3, -0.2))
    here = table.located
    angles[here] = np.column_stack(from_points(kinematics, table.point_antenna_m[here], table.point_world_m[here]))
    return replace(table, pan_rad=angles[:, 0], tilt_rad=angles[:, 1])


def test_poses_come_from_the_joints_and_without_them_from_the_contacts(
    table: ContactTable, kinematics: Kinematics
) -> None:
    rows = np.arange(len(table))
    bare = replace(table, pan_rad=np.full(len(table), np.nan), tilt_rad=np.full(len(table), np.nan))
    given, found = poses_at(kinematics, with_joints(table, kinematics), rows), poses_at(kinematics, bare, rows)
    np.testing.assert_allclose(found[:90], given[:90], atol=1e-9)
    assert np.isfinite(given).all()
    # nothing says where the rig stood without contact
    assert np.isnan(found[90:]).all()


def test_contacts_of_another_rig_are_refused(rig: Rig, table: ContactTable) -> None:
    moved = replace(rig, kinematics=Kinematics(rig.kinematics.T_actuator_antenna, np.array([0.0, 0.0, 0.3])))
    for contacts in (table, with_joints(table, rig.kinematics)):
        with pytest.raises(InputError, match="do not fit the rig's kinematics"):
            rig_items(moved, contacts, moments_of(contacts))


def test_the_drawn_antenna_is_as_long_as_the_antenna_and_bends_from_its_free_shape(
    rig: Rig, table: ContactTable
) -> None:
    table = with_joints(table, rig.kinematics)
    moments = moments_of(table)
    items = rig_items(rig, table, moments)
    for shapes in (items.bent_m, items.free_m):
        length = np.linalg.norm(np.diff(shapes, axis=1), axis=2).sum(axis=1)
        np.testing.assert_allclose(length, 0.24, rtol=1e-3)
    np.testing.assert_allclose(items.bent_m[:, 0], items.free_m[:, 0], atol=1e-9)
    # the tip goes where the force pushes
    aside = items.bent_m[:90, -1] - items.free_m[:90, -1]
    assert (np.einsum("mi,mi->m", aside, table.force_world_N[:90]) > 0).all()
    np.testing.assert_array_equal(items.bent_m[90:], items.free_m[90:])
    assert len(items.ghosts) in (5, 6)
    assert moments.main not in items.ghosts


def test_the_drawn_picture_projects_to_the_picture(rig: Rig) -> None:
    grid = picture_grid(rig.camera, 0.07)
    np.testing.assert_allclose(grid[..., 2], 0.07)
    pixels, valid = rig.camera.project(grid.reshape(-1, 3))
    assert valid.all()
    pixels = pixels.reshape((*grid.shape[:2], 2))
    np.testing.assert_allclose(pixels[0, 0], [-0.5, -0.5], atol=1e-6)
    np.testing.assert_allclose(pixels[-1, -1], [959.5, 719.5], atol=1e-6)
    assert (np.diff(pixels[..., 0], axis=1) > 0).all()
    assert (np.diff(pixels[..., 1], axis=0) > 0).all()


def test_a_lens_without_rays_in_the_corners_still_has_a_picture() -> None:
    folding = Camera(
        "opencv", (960, 720), np.array([[400.0, 0, 480], [0, 400, 360], [0, 0, 1]]), np.array([-0.6, 0.0, 0.0, 0.0])
    )
    assert np.isfinite(picture_grid(folding, 0.07)).all()


BUMP = {"direction_world": [0.0, 0.0, 1.0], "height_m": 0.002, "width_m": 0.008}


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"shape": "cube"}, "object.shape is 'cube'"),
        ({"shape": ["sphere"]}, "object.shape is"),
        ({"radius_m": 0}, "object.radius_m is 0"),
        ({"radius_m": None}, "object.radius_m is"),
        ({"center_world_m": [0, 1]}, "object.center_world_m is"),
        ({"axis_world": [0, 0, 0]}, "no direction"),
        ({"axis_world": [0, 0, float("nan")]}, "object.axis_world is"),
        ({"shape": "box_edge", "wedge_world": None}, "object.wedge_world is"),
        ({"shape": "freeform", "bumps": "many"}, "object.bumps is"),
        ({"shape": "freeform", "bumps": [BUMP | {"height_m": 0.1}]}, r"object.bumps\[0\].*too steep"),
        ({"shape": "freeform", "bumps": [BUMP, {}]}, r"object.bumps\[1\]"),
    ],
)
def test_a_wrong_truth_is_refused(truth: dict[str, Any], change: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        true_object({"object": truth["object"] | change})


def test_nothing_located_is_an_input_error() -> None:
    with pytest.raises(InputError, match="no frame has a located contact"):
        bare_scene(ContactTable.from_rows([ContactRow(frame=0, time_s=0.0, status="no_antenna")]))
