"""The reconstructed surface against objects whose shape is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator import surface as surface_module
from estimator.surface import Surface, group, reconstruct, smooth
from estimator.table import ContactRow, ContactTable
from tests.viz.touching import ANTENNA_RADIUS_M, cylinder, sphere, touch
from vbaa_calib.errors import InputError

CENTRE = np.array([0.16, 0.05, 0.0])
RADIUS_M = 0.015


def rebuilt(points: np.ndarray, normals: np.ndarray, seed: int = 0, **noise: float) -> Surface:
    rows = touch(points, normals, np.random.default_rng(seed), **noise)
    return reconstruct(ContactTable.from_rows(rows), ANTENNA_RADIUS_M)


def grid(low_rad: float, high_rad: float, around: int = 8, up: int = 12) -> tuple[np.ndarray, np.ndarray]:
    angle, height = np.meshgrid(np.linspace(low_rad, high_rad, around), np.linspace(-0.03, 0.03, up))
    return cylinder(angle.ravel(), height.ravel())


def off_cylinder(points_m: np.ndarray) -> np.ndarray:
    return np.linalg.norm((points_m - CENTRE)[:, :2], axis=1) - RADIUS_M


def both(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts])


def face_normals(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Unit normal and area of each triangle."""
    a, b, c = (surface.points_m[surface.triangles[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    size = np.linalg.norm(cross, axis=1)
    return cross / size[:, None], size / 2


def test_the_surface_lies_one_radius_from_the_contacts_and_faces_out() -> None:
    surface = rebuilt(*grid(0.9, 2.1), std_along_m=1e-7, std_across_m=1e-7)
    assert np.abs(off_cylinder(surface.points_m)).max() < 2e-6
    normal, area = face_normals(surface)
    assert (np.sum(normal * surface.normals[surface.triangles[:, 0]], axis=1) > 0.9).all()
    # chords under arcs: a little less than the touched area
    assert area.sum() == pytest.approx(RADIUS_M * 1.2 * 0.06, rel=0.01)
    assert not surface.notes


def test_smoothing_takes_noise_out_and_knows_what_is_left() -> None:
    error, raw_error, scaled = [], [], []
    for seed in range(6):
        points, normals = grid(1.0, 2.2, 7, 9)
        rows = touch(points, normals, np.random.default_rng(seed), std_along_m=3e-4, std_across_m=3e-4)
        surface = reconstruct(ContactTable.from_rows(rows), ANTENNA_RADIUS_M)
        raw = np.stack([row.point_world_m for row in rows]) - ANTENNA_RADIUS_M * normals
        raw_error.append(off_cylinder(raw))
        error.append(off_cylinder(surface.points_m))
        scaled.append(error[-1] / surface.std_m)
    assert np.std(error) < 0.8 * np.std(raw_error)
    assert 0.85 < np.sqrt(np.mean(np.square(scaled))) < 1.15


def test_two_sides_of_a_cylinder_are_two_patches() -> None:
    surface = rebuilt(*both(grid(1.0, 2.1), grid(1.0 + np.pi, 2.1 + np.pi)))
    assert set(surface.patch) == {0, 1}
    assert (np.diff(surface.patch[surface.triangles], axis=1) == 0).all()
    sides = [surface.normals[surface.patch == side].mean(axis=0) for side in (0, 1)]
    assert sides[0] @ sides[1] < -0.7


def test_touched_all_around_the_patches_stay_height_fields() -> None:
    rng = np.random.default_rng(3)
    surface = rebuilt(*cylinder(rng.uniform(0, 2 * np.pi, 240), rng.uniform(-0.03, 0.03, 240)), std_along_m=2e-4)
    assert 3 <= surface.patch.max() + 1 <= 6
    normal, _ = face_normals(surface)
    assert (np.sum(normal * surface.normals[surface.triangles[:, 0]], axis=1) > 0).mean() > 0.99
    assert np.sqrt(np.mean(off_cylinder(surface.points_m) ** 2)) < 3e-4


def test_objects_apart_are_not_joined() -> None:
    points, normals = grid(1.2, 1.9, 5, 8)
    far = points * [1, 1, 0.3] + [0.0, 0.0, 0.08]
    surface = rebuilt(*both((points * [1, 1, 0.3], normals), (far, normals)), std_along_m=1e-4)
    assert surface.patch.max() == 1
    assert np.ptp(surface.points_m[surface.triangles][:, :, 2], axis=1).max() < 0.02


def test_dense_tracks_far_apart_are_one_surface() -> None:
    angle, height = np.tile(np.linspace(1.2, 1.9, 16), 8), np.repeat(np.linspace(-0.03, 0.03, 8), 16)
    surface = rebuilt(*cylinder(angle, height), std_along_m=1e-5, std_across_m=1e-5)
    assert surface.patch.max() == 0
    assert face_normals(surface)[1].sum() > 0.8 * RADIUS_M * 0.7 * 0.06


@pytest.mark.parametrize("sway_rad", [0.0, 0.05])
def test_a_track_no_wider_than_its_noise_is_a_line(sway_rad: float) -> None:
    height = np.linspace(-0.03, 0.03, 60)
    points, normals = cylinder(1.6 + sway_rad * np.sin(np.arange(60.0)), height)
    surface = rebuilt(points, normals, std_along_m=1e-3, std_across_m=3e-4)
    assert len(surface.triangles) == 0
    assert surface.lines.tolist() == [[i, i + 1] for i in range(59)]
    assert "without triangles" in surface.notes[0]
    assert np.sqrt(np.mean(off_cylinder(surface.points_m) ** 2)) < 2e-4


def test_no_triangle_is_a_sliver() -> None:
    rng = np.random.default_rng(5)
    surface = rebuilt(*sphere(rng, 130, 0.9), std_along_m=1e-4)
    a, b, c = (surface.points_m[surface.triangles[:, i]] for i in range(3))
    longest = np.max([np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    height = 2 * face_normals(surface)[1] / longest
    assert (height / longest).min() > 0.02
    assert len(surface.triangles) > 200


def test_nearly_collinear_points_give_a_line_not_slivers() -> None:
    height = np.linspace(-0.03, 0.03, 40)
    points, normals = cylinder(1.6 + 1e-3 * np.random.default_rng(0).standard_normal(40), height)
    surface = rebuilt(points, normals, std_along_m=1e-6, std_across_m=1e-6)
    assert len(surface.triangles) == 0
    assert len(surface.lines) == 39


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_points_stay_points(count: int) -> None:
    surface = rebuilt(*cylinder(np.full(count, 1.6), np.linspace(-0.01, 0.01, count)))
    assert len(surface.points_m) == count
    assert len(surface.triangles) == 0
    assert len(surface.lines) == count - 1
    assert surface.notes


def test_contacts_in_one_place_are_no_area() -> None:
    surface = rebuilt(*cylinder(np.full(20, 1.6), np.zeros(20)), std_along_m=5e-4)
    assert len(surface.triangles) == 0
    assert np.isfinite(surface.points_m).all()


def test_exact_duplicates_are_survived() -> None:
    points, normals = grid(1.2, 1.9)
    surface = rebuilt(
        np.repeat(points, 2, axis=0), np.repeat(normals, 2, axis=0), std_along_m=1e-12, std_across_m=1e-12
    )
    assert np.isfinite(surface.points_m).all()
    assert len(surface.triangles) > 60


def test_only_located_contacts_count_and_unknown_covariances_are_not_smoothed() -> None:
    rows = touch(*grid(1.2, 1.9), np.random.default_rng(0))
    rows = [replace(row, covariance_world_m2=np.full((3, 3), np.nan)) for row in rows]
    lost = ContactRow(frame=len(rows), time_s=99.0, status="low_signal", in_contact=True)
    surface = reconstruct(ContactTable.from_rows([*rows, lost]), ANTENNA_RADIUS_M)
    assert lost.frame not in surface.frame
    expected = np.stack(
        [row.point_world_m - ANTENNA_RADIUS_M * n for row, n in zip(rows, surface.normals, strict=True)]
    )
    np.testing.assert_allclose(surface.points_m, expected, atol=1e-12)
    assert np.isnan(surface.std_m).all()


def test_many_contacts_are_thinned_and_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface_module, "MAX_POINTS", 30)
    surface = rebuilt(*cylinder(np.full(70, 1.6), np.linspace(-0.03, 0.03, 70)))
    assert len(surface.points_m) == 30
    assert "70 contacts were thinned evenly to 30" in surface.notes[0]


def test_nothing_touched_is_an_input_error() -> None:
    row = ContactRow(frame=0, time_s=0.0, status="no_contact")
    with pytest.raises(InputError, match="no frame has a located contact"):
        reconstruct(ContactTable.from_rows([row]), ANTENNA_RADIUS_M)


def test_the_result_turns_with_the_world() -> None:
    turn, shift = Rotation.from_rotvec([0.4, -1.1, 0.7]), np.array([0.3, -0.2, 0.5])
    rows = touch(*grid(1.0, 2.1), np.random.default_rng(2))
    matrix = turn.as_matrix()
    turned = [
        replace(
            row,
            point_world_m=turn.apply(row.point_world_m) + shift,
            force_world_N=turn.apply(row.force_world_N),
            covariance_world_m2=matrix @ row.covariance_world_m2 @ matrix.T,
        )
        for row in rows
    ]
    here = reconstruct(ContactTable.from_rows(rows), ANTENNA_RADIUS_M)
    there = reconstruct(ContactTable.from_rows(turned), ANTENNA_RADIUS_M)
    np.testing.assert_allclose(there.points_m, turn.apply(here.points_m) + shift, atol=1e-7)
    assert {frozenset(t) for t in here.triangles.tolist()} == {frozenset(t) for t in there.triangles.tolist()}


def test_smoothing_keeps_a_plane_and_beats_the_noise_of_a_bowl() -> None:
    rng = np.random.default_rng(0)
    flat = rng.uniform(-0.02, 0.02, (80, 2))
    std = np.full(80, 2e-4)
    plane = 0.3 * flat[:, 0] - 0.1 * flat[:, 1] + 0.004
    np.testing.assert_allclose(smooth(flat, plane, std)[0], plane, atol=1e-9)
    bowl = 20 * np.sum(flat**2, axis=1)
    smoothed, left = smooth(flat, bowl + std * rng.standard_normal(80), std)
    assert np.std(smoothed - bowl) < 0.75 * 2e-4
    assert (left < std).all()


def test_grouping_labels_every_point_once() -> None:
    points, normals = both(grid(1.0, 2.1), grid(1.0 + np.pi, 2.1 + np.pi))
    order = np.random.default_rng(0).permutation(len(points))
    labels = group(points[order], normals[order])
    assert sorted(np.unique(labels)) == [0, 1]
    assert all(len(set(labels[np.argsort(order)][half])) == 1 for half in (slice(0, 96), slice(96, None)))
