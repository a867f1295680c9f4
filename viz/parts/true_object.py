"""The true object of a simulated session as triangles."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from vbaa_calib.simulate.scene.bumps import surface_radius
from vbaa_calib.simulate.scene.objects import BOX_FACE_M
from viz.scene.truth import TrueObject

from .part import Part, triangles

ARC = 12
"""Steps along the rounding of the box's edge."""


def truth_part(truth: TrueObject) -> Part:
    """The true object, to look through."""
    mesh = truth_mesh(truth).compute_normals(cell_normals=False, split_vertices=True, feature_angle=40)
    return Part("truth", triangles(mesh.points, mesh.regular_faces, mesh.point_data["Normals"]), opacity=0.22)


def truth_mesh(truth: TrueObject) -> pv.PolyData:
    """The true object; of a box its two faces as deep as simulated pictures show them.

    Of a knife, as much of the blade as the edge is half as long."""
    if truth.shape in ("sphere", "freeform"):
        return _round(truth)
    if truth.shape == "box_edge":
        return _extruded(truth, _corner(truth))
    rod = pv.Cylinder(
        center=truth.center_m,
        direction=truth.axis,
        radius=truth.radius_m,
        height=2 * truth.half_length_m,
        resolution=128,
    ).triangulate()
    if truth.shape == "cylinder":
        return rod
    thick = truth.radius_m * np.cross(truth.axis, truth.wedge)
    into = truth.half_length_m * truth.wedge
    return rod.append_polydata(_extruded(truth, np.array([thick, thick + into, into - thick, -thick])))


def _round(truth: TrueObject) -> pv.PolyData:
    mesh = pv.Icosphere(radius=1.0, nsub=5)
    directions = np.asarray(mesh.points, float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    radius = surface_radius(directions, truth.radius_m, truth.bumps)
    return pv.PolyData.from_regular_faces(truth.center_m + radius[:, None] * directions, mesh.regular_faces)


def _corner(truth: TrueObject) -> np.ndarray:
    """(K, 3) the box's outline across its edge, from the centre of the rounding: face, rounding, face."""
    side = np.cross(truth.axis, truth.wedge)
    turn = np.linspace(-np.pi / 4, np.pi / 4, ARC + 1)[:, None]
    rounding = truth.radius_m * (np.sin(turn) * side - np.cos(turn) * truth.wedge)
    along = BOX_FACE_M / np.sqrt(2) * np.array([truth.wedge - side, truth.wedge + side])
    return np.vstack([rounding[:1] + along[0], rounding, rounding[-1:] + along[1]])


def _extruded(truth: TrueObject, outline: np.ndarray) -> pv.PolyData:
    """The convex outline (K, 3) across the axis, from one end of the object to the other, closed."""
    count = len(outline)
    ends = truth.center_m + outline + truth.half_length_m * np.array([-1.0, 1.0])[:, None, None] * truth.axis
    here, there = np.arange(count), np.roll(np.arange(count), -1)
    fan = np.column_stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)])
    faces = np.vstack(
        [
            np.column_stack([here, there, there + count]),
            np.column_stack([here, there + count, here + count]),
            fan[:, ::-1],
            fan + count,
        ]
    )
    mesh = pv.PolyData.from_regular_faces(ends.reshape(-1, 3), faces)
    # the outline may run either way round
    return mesh.flip_faces() if mesh.volume < 0 else mesh
