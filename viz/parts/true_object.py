"""The true object of a simulated session as triangles."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from vbaa_calib.simulate.scene.bumps import surface_radius
from vbaa_calib.simulate.scene.objects import BOX_FACE_M, TouchObject

from .part import Part, triangles

_ARC = 12
"""Steps along the rounding of the box's edge."""


def truth_part(truth: TouchObject) -> Part:
    """The true object, to look through."""
    mesh = _truth_mesh(truth).compute_normals(cell_normals=False, split_vertices=True, feature_angle=40)
    return Part("truth", triangles(mesh.points, mesh.regular_faces, mesh.point_data["Normals"]), opacity=0.22)


def _truth_mesh(truth: TouchObject) -> pv.PolyData:
    """The true object; of a box its two faces as deep as simulated pictures show them.

    Of a knife, as much of the blade as the edge is half as long."""
    radius, half, wedge = truth.radius_m, truth.half_length_m, truth.wedge_world
    if truth.shape in ("sphere", "freeform"):
        mesh = pv.Icosphere(radius=1.0, nsub=5)
        directions = np.asarray(mesh.points, float)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        away = surface_radius(directions, radius, truth.bumps)[:, None] * directions
        return pv.PolyData.from_regular_faces(truth.center_world_m + away, mesh.regular_faces)
    side = np.cross(truth.axis_world, wedge)
    if truth.shape == "box_edge":
        # across the edge, from the centre of the rounding: face, rounding, face
        turn = np.linspace(-np.pi / 4, np.pi / 4, _ARC + 1)[:, None]
        rounding = radius * (np.sin(turn) * side - np.cos(turn) * wedge)
        faces = BOX_FACE_M * truth.into_faces
        return _extruded(truth, np.vstack([rounding[:1] + faces[0], rounding, rounding[-1:] + faces[1]]))
    place = {"center": truth.center_world_m, "direction": truth.axis_world}
    rod = pv.Cylinder(**place, radius=radius, height=2 * half, resolution=128).triangulate()
    if truth.shape == "cylinder":
        return rod
    thick, into = radius * side, half * wedge
    return rod.append_polydata(_extruded(truth, np.array([thick, thick + into, into - thick, -thick])))


def _extruded(truth: TouchObject, outline: np.ndarray) -> pv.PolyData:
    """The convex outline (K, 3) across the axis, from one end of the object to the other, closed."""
    count = len(outline)
    ends = (
        truth.center_world_m + outline + truth.half_length_m * np.array([-1.0, 1.0])[:, None, None] * truth.axis_world
    )
    here, there = np.arange(count), np.roll(np.arange(count), -1)
    fan = np.column_stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)])
    sides = [np.column_stack([here, there, there + count]), np.column_stack([here, there + count, here + count])]
    mesh = pv.PolyData.from_regular_faces(ends.reshape(-1, 3), np.vstack([*sides, fan[:, ::-1], fan + count]))
    # the outline may run either way round
    return mesh.flip_faces() if mesh.volume < 0 else mesh
