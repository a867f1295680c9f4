"""The scene as arrays: in the right places, without pyvista."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from estimator.table import ContactRow, ContactTable
from vbaa_calib.camera import Camera
from vbaa_calib.errors import InputError
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import Rig
from viz.rig_items import frustum, joint_angles, rig_items
from viz.scene import build_scene, truth_object


def test_the_scene_needs_no_pyvista() -> None:
    code = "import sys, viz.scene, viz.report; sys.exit('pyvista' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_contacts_are_the_located_ones_with_their_bars(table: ContactTable) -> None:
    scene = build_scene(table)
    assert len(scene.contacts.points_m) == 90
    np.testing.assert_allclose(scene.contacts.bars_m.mean(axis=1), scene.contacts.points_m, atol=1e-12)
    # 2 std to both sides of the longest axis, which is 0.4 mm
    length = np.linalg.norm(np.diff(scene.contacts.bars_m, axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(length, 4 * 4e-4, rtol=1e-6)
    np.testing.assert_allclose(scene.contacts.size_mN, 50 + 30 * np.sin(0.3 * np.arange(90)), rtol=1e-6)


def test_what_was_touched_lies_in_its_ball(table: ContactTable, truth: dict[str, Any]) -> None:
    scene = build_scene(table, truth=truth_object(truth))
    centre, radius = scene.touched_m
    assert (np.linalg.norm(scene.contacts.points_m - centre, axis=1) <= radius + 1e-12).all()
    assert 0.02 < radius < 0.06


@pytest.mark.parametrize(("pan", "tilt"), [(0.0, 0.0), (0.7, -0.4), (-1.2, 1.3), (3.0, -1.1)])
def test_joint_angles_come_back_from_one_point_in_both_frames(kinematics: Kinematics, pan: float, tilt: float) -> None:
    point = np.array([0.15, 0.012, -0.02])
    found = joint_angles(kinematics, point, kinematics.T_world_antenna(pan, tilt) @ point)
    turn = (np.array(found) - (pan, tilt) + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(turn, 0.0, atol=1e-9)


def test_contacts_of_another_rig_are_refused(rig: Rig, table: ContactTable) -> None:
    moved = replace(rig, kinematics=Kinematics(rig.kinematics.T_actuator_antenna, np.array([0.0, 0.0, 0.3])))
    with pytest.raises(InputError, match="do not fit the rig's kinematics"):
        rig_items(moved, table)


def test_the_drawn_antenna_is_as_long_as_the_antenna_and_bends_from_its_free_shape(
    rig: Rig, table: ContactTable
) -> None:
    items = rig_items(rig, table)
    for shape in (items.bent_m, items.free_m, *items.ghosts_m):
        assert np.linalg.norm(np.diff(shape, axis=0), axis=1).sum() == pytest.approx(0.24, rel=1e-3)
    np.testing.assert_allclose(items.bent_m[0], items.free_m[0], atol=1e-9)
    # the tip goes where the force pushes
    strongest = np.argmax(np.where(table.located, np.hypot(table.force_y_N, table.force_z_N), -1.0))
    assert (items.bent_m[-1] - items.free_m[-1]) @ table.force_world_N[strongest] > 0
    # and the rig stands as it stood then
    angles = joint_angles(rig.kinematics, table.point_antenna_m[strongest], table.point_world_m[strongest])
    corner = rig.kinematics.T_world_antenna(*angles) @ np.array([0.0, -0.3 * 0.24, 0.0])
    np.testing.assert_allclose(items.plane_m[0], corner, atol=1e-12)
    assert len(items.ghosts_m) in (5, 6)


def test_the_frustum_projects_to_the_corners_of_the_picture(rig: Rig) -> None:
    corners = frustum(rig.camera, 0.07)
    np.testing.assert_array_equal(corners[0], 0.0)
    np.testing.assert_allclose(corners[1:, 2], 0.07)
    pixels, valid = rig.camera.project(corners[1:])
    assert valid.all()
    np.testing.assert_allclose(pixels, [[-0.5, -0.5], [959.5, -0.5], [959.5, 719.5], [-0.5, 719.5]], atol=1e-6)


def test_a_lens_without_rays_in_the_corners_still_has_a_frustum() -> None:
    folding = Camera(
        "opencv", (960, 720), np.array([[400.0, 0, 480], [0, 400, 360], [0, 0, 1]]), np.array([-0.6, 0.0, 0.0, 0.0])
    )
    assert np.isfinite(frustum(folding, 0.07)).all()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"shape": "cube"}, "object.shape is 'cube'"),
        ({"radius_m": 0}, "object.radius_m is 0"),
        ({"radius_m": None}, "object.radius_m is"),
        ({"center_world_m": [0, 1]}, "object.center_world_m is"),
        ({"axis_world": [0, 0, 0]}, "no direction"),
        ({"axis_world": [0, 0, float("nan")]}, "object.axis_world is"),
    ],
)
def test_a_wrong_truth_is_refused(truth: dict[str, Any], change: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        truth_object({"object": truth["object"] | change})


def test_a_sphere_needs_neither_axis_nor_length() -> None:
    sphere = truth_object({"object": {"shape": "sphere", "center_world_m": [0, 0, 1], "radius_m": 0.02}})
    assert sphere.radius_m == 0.02


def test_nothing_located_is_an_input_error() -> None:
    with pytest.raises(InputError, match="no frame has a located contact"):
        build_scene(ContactTable.from_rows([ContactRow(frame=0, time_s=0.0, status="no_antenna")]))
