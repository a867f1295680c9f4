"""The reconstructed surface against objects whose shape is known: what is drawn, and what is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.object.surface import Surface, reconstruct, touches_of
from estimator.table.contacts import ContactRow, ContactTable
from vbaa_calib.core.errors import InputError
from vbaa_calib.simulate.scene.objects import TouchObject

from ..viz.touching import ANTENNA_RADIUS_M, cylinder, touch
from .touched import CYLINDER, FREEFORM, KNIFE, RADIUS_M, SPHERE, angles_rad, drawn, edge_touches, spread_touches

CENTRE = np.array([0.16, 0.05, 0.0])
CYLINDER_RADIUS_M = 0.015


def rebuilt(points: np.ndarray, normals: np.ndarray, seed: int = 0, **noise: float) -> Surface:
    rows = touch(points, normals, np.random.default_rng(seed), **noise)
    return reconstruct(ContactTable.from_rows(rows), ANTENNA_RADIUS_M)


def grid(low_rad: float, high_rad: float, around: int = 7, up: int = 9) -> tuple[np.ndarray, np.ndarray]:
    angle, height = np.meshgrid(np.linspace(low_rad, high_rad, around), np.linspace(-0.03, 0.03, up))
    return cylinder(angle.ravel(), height.ravel())


def off_cylinder(points_m: np.ndarray) -> np.ndarray:
    return np.linalg.norm((points_m - CENTRE)[:, :2], axis=1) - CYLINDER_RADIUS_M


def both(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts])


def face_normals(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Unit normal and area of each triangle."""
    a, b, c = (surface.points_m[surface.triangles[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    size = np.linalg.norm(cross, axis=1)
    return cross / size[:, None], size / 2


def test_exact_contacts_give_the_object_one_radius_away_facing_out() -> None:
    surface = rebuilt(*grid(0.9, 2.1), std_along_m=1e-7, std_across_m=1e-7)
    assert np.abs(off_cylinder(surface.touched_m)).max() < 2e-6
    between = np.abs(off_cylinder(surface.points_m))
    assert between.max() < 1e-4
    assert (between < np.maximum(4 * surface.std_m, 2e-6)).all()
    normal, area = face_normals(surface)
    assert (np.sum(normal * surface.normals[surface.triangles[:, 0]], axis=1) > 0.99).all()
    # the footprint ends a little beyond the outermost contacts
    assert CYLINDER_RADIUS_M * 1.2 * 0.06 < area.sum() < 1.6 * CYLINDER_RADIUS_M * 1.2 * 0.06
    assert not surface.notes


@pytest.mark.parametrize(("obj", "friction", "seed"), [(CYLINDER, 0.0, 0), (SPHERE, 0.5, 2), (FREEFORM, 0.0, 0)])
def test_a_smooth_object_comes_out_as_one_surface_with_its_normals(
    obj: TouchObject, friction: float, seed: int
) -> None:
    """Whatever way friction leans the forces: shape and tangents tell the normals."""
    true = spread_touches(obj, 60, np.random.default_rng(seed), common=False)
    size = np.linalg.norm(true.force_N, axis=1, keepdims=True)
    normals = true.force_N / size
    leant = replace(true, force_N=true.force_N + friction * size * np.cross(normals, true.tangent))
    surface = reconstruct(drawn(leant, np.random.default_rng(seed + 1)), RADIUS_M)
    distance, normal = obj.signed_distance(surface.points_m)
    assert np.sqrt(np.mean(distance**2)) < 1e-4
    assert np.percentile(np.degrees(angles_rad(surface.normals, normal)), 90) < 6
    assert np.percentile(np.degrees(angles_rad(surface.touched_normal, normals)), 95) < 3
    assert set(surface.patch) == {0}
    assert len(surface.triangles) > 500


def test_an_edge_is_a_line_with_the_normal_of_each_contact() -> None:
    true = edge_touches(60, np.random.default_rng(0))
    surface = reconstruct(drawn(true, np.random.default_rng(1)), RADIUS_M)
    assert len(surface.triangles) == 0
    assert len(surface.lines) > 20
    assert any("too narrow" in note for note in surface.notes)
    distance, _ = KNIFE.signed_distance(surface.points_m)
    assert np.abs(distance).max() < 6e-4
    felt = true.force_N / np.linalg.norm(true.force_N, axis=1, keepdims=True)
    assert np.degrees(angles_rad(surface.touched_normal, felt)).max() < 1.0
    assert (surface.std_across_m > 0).all()


def test_touched_all_around_the_patches_stay_height_fields() -> None:
    rng = np.random.default_rng(3)
    surface = rebuilt(*cylinder(rng.uniform(0, 2 * np.pi, 150), rng.uniform(-0.03, 0.03, 150)), std_along_m=2e-4)
    assert 3 <= surface.patch.max() + 1 <= 6
    normal, _ = face_normals(surface)
    assert (np.sum(normal * surface.normals[surface.triangles[:, 0]], axis=1) > 0).mean() > 0.99
    assert np.sqrt(np.mean(off_cylinder(surface.points_m) ** 2)) < 3e-4


def test_objects_apart_are_not_joined() -> None:
    points, normals = grid(1.2, 1.9, 5, 7)
    far = points * [1, 1, 0.3] + [0.0, 0.0, 0.08]
    surface = rebuilt(*both((points * [1, 1, 0.3], normals), (far, normals)), std_along_m=1e-4)
    assert surface.patch.max() == 1
    assert np.ptp(surface.points_m[surface.triangles][:, :, 2], axis=1).max() < 0.02


def test_a_bay_that_was_not_touched_stays_open() -> None:
    """A ring of contacts is not filled."""
    rng = np.random.default_rng(0)
    turn, out = rng.uniform(0, 2 * np.pi, 160), rng.uniform(0.024, 0.03, 160)
    points = np.column_stack([out * np.cos(turn), np.zeros(160), out * np.sin(turn)])
    surface = rebuilt(CENTRE + points, np.tile([0.0, -1.0, 0.0], (160, 1)), std_along_m=1e-4)
    from_centre = np.linalg.norm(surface.points_m - CENTRE, axis=1)
    assert from_centre.min() > 0.015
    assert face_normals(surface)[1].sum() > 0.7 * np.pi * (0.03**2 - 0.024**2)


def test_a_track_no_wider_than_its_noise_is_a_line() -> None:
    points, normals = cylinder(1.6 + 0.05 * np.sin(np.arange(60.0)), np.linspace(-0.03, 0.03, 60))
    surface = rebuilt(points, normals, std_along_m=1e-3, std_across_m=3e-4)
    assert len(surface.triangles) == 0
    assert surface.lines.tolist() == [[i, i + 1] for i in range(len(surface.points_m) - 1)]
    assert np.sqrt(np.mean(off_cylinder(surface.points_m) ** 2)) < 2e-4


def test_a_track_with_a_gap_is_a_line_with_a_gap() -> None:
    height = np.concatenate([np.linspace(-0.03, -0.01, 30), np.linspace(0.004, 0.03, 30)])
    surface = rebuilt(*cylinder(np.full(60, 1.6), height), std_along_m=1e-3)
    drawn_m = np.abs(np.diff(surface.points_m[surface.lines][:, :, 2], axis=1)).ravel()
    assert drawn_m.max() < 0.002
    assert 0.03 < drawn_m.sum() < 0.055


def test_the_result_turns_with_the_world() -> None:
    turn, shift = Rotation.from_rotvec([0.4, -1.1, 0.7]), np.array([0.3, -0.2, 0.5])
    here = drawn(spread_touches(SPHERE, 40, np.random.default_rng(2), common=False), np.random.default_rng(3))
    matrix = turn.as_matrix()
    there = replace(
        here,
        point_m=turn.apply(here.point_m) + shift,
        force_N=turn.apply(here.force_N),
        tangent=turn.apply(here.tangent),
        own_m2=matrix @ here.own_m2 @ matrix.T,
    )
    one, other = reconstruct(here, RADIUS_M), reconstruct(there, RADIUS_M)
    np.testing.assert_allclose(other.touched_m, turn.apply(one.touched_m) + shift, atol=2e-6)
    np.testing.assert_allclose(other.touched_std_m, one.touched_std_m, rtol=0.05)


def test_only_located_contacts_with_a_force_count() -> None:
    rows = touch(*grid(1.2, 1.9, 4, 4), np.random.default_rng(0))
    lost = ContactRow(frame=len(rows), time_s=99.0, status="low_signal", in_contact=True)
    limp = replace(rows[0], frame=len(rows) + 1, time_s=99.1, force_world_N=np.zeros(3))
    again = replace(
        rows[1], frame=len(rows) + 2, time_s=99.2, status="tip_contact", tangent_world=np.array([1.0, 0, 0])
    )
    found = touches_of(ContactTable.from_rows([*rows, lost, limp, again]))
    assert found.frame.tolist() == [*range(16), 18]
    assert found.row.tolist() == [*range(16), 18]
    assert np.isnan(found.tangent[-1]).all()  # the tip is not tangent to what it touches


def test_contacts_of_a_model_that_is_off_are_not_believed() -> None:
    rows = touch(*grid(0.9, 2.1), np.random.default_rng(0))
    table = ContactTable.from_rows(
        [replace(row, bias_std=4.0 if index < 10 else 0.2) for index, row in enumerate(rows)]
    )
    surface = reconstruct(table, ANTENNA_RADIUS_M)
    assert len(surface.touched_m) == len(rows) - 10
    assert surface.notes[0].startswith("10 contacts")
    with pytest.raises(InputError, match="all 63 contacts were found with a model that is off"):
        reconstruct(replace(table, bias_std=np.full(len(rows), 2.0)), ANTENNA_RADIUS_M)
