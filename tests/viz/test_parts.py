"""Meshes: what is drawn is where it should be, as large as it says, and at its moments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.table.contacts import ContactTable
from vbaa_calib.simulate.render.meshes import object_mesh
from vbaa_calib.simulate.scene.objects import Bump, TouchObject
from viz.parts.assemble import all_parts
from viz.parts.part import Part, ball
from viz.scene.readable import thinned
from viz.scene.scene import Scene, build_scene


def named(parts: list[Part], name: str) -> Part:
    return next(part for part in parts if part.name == name)


def pieces(part: Part, count: int) -> np.ndarray:
    """(count, P, 3) points of each of the stamped meshes."""
    return np.asarray(part.mesh.points, float).reshape(count, -1, 3)


def test_arrows_begin_at_the_contacts_and_run_along_the_force(scene: Scene) -> None:
    contacts = scene.contacts
    arrows = pieces(named(all_parts(scene), "forces"), 90) - contacts.points_m[:, None]
    direction = contacts.force_N / np.linalg.norm(contacts.force_N, axis=1, keepdims=True)
    reach = np.einsum("aki,ai->ak", arrows, direction)
    np.testing.assert_allclose(reach.min(axis=1), 0.0, atol=1e-7)
    np.testing.assert_allclose(reach.max(axis=1) / reach.max(), contacts.size_mN / contacts.size_mN.max(), atol=1e-4)


def test_ellipsoids_are_two_deviations_large_times_what_the_legend_says(scene: Scene) -> None:
    part = named(all_parts(scene), "spread")
    chosen = thinned(np.arange(90), part.mesh.n_points // ball(2).n_points)
    offset = pieces(part, len(chosen)) - scene.contacts.points_m[chosen][:, None]
    weight = np.linalg.inv(scene.contacts.covariance_m2[chosen])
    distance = np.sqrt(np.einsum("kpi,kij,kpj->kp", offset, weight, offset))
    factor = float(part.note.removesuffix("x enlarged")) if part.note else 1.0
    np.testing.assert_allclose(distance, 2 * factor, rtol=1e-3)


def test_degenerate_covariances_and_missing_numbers_are_drawn_or_left_out(table: ContactTable) -> None:
    covariance, force = table.covariance_world_m2.copy(), table.force_world_N.copy()
    covariance[0], covariance[1], covariance[2] = 0.0, np.diag([1e-8, 0.0, 0.0]), np.nan
    force[0], force[1] = 0.0, np.nan
    parts = all_parts(build_scene(replace(table, covariance_world_m2=covariance, force_world_N=force)))
    assert all(np.isfinite(part.mesh.points).all() for part in parts)
    assert all(np.isfinite(part.mesh.point_data["Normals"]).all() for part in parts)
    assert len(named(parts, "forces").contact) == 88
    nothing = replace(table, covariance_world_m2=0 * covariance, force_world_N=np.full_like(force, np.nan))
    assert {part.name for part in all_parts(build_scene(nothing))} == {"contacts", "now"}


def test_cones_open_by_the_friction_angle_around_the_normals(scene: Scene) -> None:
    part = named(all_parts(scene), "cones")
    assert part.note == "half angle 17.2°"
    chosen = thinned(np.arange(90), 16)
    offset = pieces(part, len(chosen)) - scene.contacts.points_m[chosen][:, None]
    tip, rim, hem = np.split(offset, [offset.shape[1] // 4, offset.shape[1] // 2], axis=1)
    np.testing.assert_allclose(tip, 0.0, atol=1e-7)
    angle, inner = (
        np.arccos(np.einsum("kpi,ki->kp", ring, scene.normals[chosen]) / np.linalg.norm(ring, axis=2))
        for ring in (rim, hem)
    )
    np.testing.assert_allclose(angle, 0.3, atol=1e-4)
    assert (inner < 0.3001).all()


def test_an_instant_shows_the_contacts_up_to_then_and_its_own_antenna(scene: Scene) -> None:
    parts = all_parts(scene)
    contacts, now, antenna = (named(parts, name) for name in ("contacts", "now", "antenna"))
    each = contacts.mesh.n_cells // 90
    np.testing.assert_array_equal(contacts.span[:, 1] // each, np.minimum(np.arange(92) + 1, 90))
    np.testing.assert_array_equal((now.span[:, 1] - now.span[:, 0]) // each, [1] * 90 + [0, 0])
    for instant in (0, 37):
        first, last = antenna.span[instant]
        points = antenna.mesh.points[np.unique(antenna.mesh.regular_faces[first:last])]
        off = np.linalg.norm(points[:, None] - scene.rig.bent_m[instant][None], axis=2).min(axis=1)
        assert off.max() < 0.006  # nodes are up to 9 mm apart
    # nothing says where the antenna was then
    np.testing.assert_array_equal(antenna.span[90:], 0)


CENTRE, AXIS, WEDGE = np.array([0.1, 0.2, 0.3]), np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
BUMPS = (
    Bump(np.array([0.0, -1.0, 0.0]), 0.002, 0.006),
    Bump(np.array([0.6, 0.0, 0.8]), -0.001, 0.004),
)


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
