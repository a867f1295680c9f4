"""One small mesh set down at many places, each time turned and stretched."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from .part import triangles


def stamp(mesh: pv.PolyData, linear: np.ndarray, places: np.ndarray) -> pv.PolyData:
    """The mesh at K places, in their order.

    Parameters
    ----------
    mesh : triangles with normals.
    linear : (K, 3, 3) invertible: what is done to the mesh before it is moved to places (K, 3).
    """
    count, each = len(places), mesh.n_points
    points = np.einsum("kij,pj->kpi", linear, np.asarray(mesh.points, float)) + places[:, None]
    # a normal turns with the inverse transpose
    normals = np.einsum("kji,pj->kpi", np.linalg.inv(linear), np.asarray(mesh.point_data["Normals"], float))
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-30)
    faces = mesh.regular_faces[None] + each * np.arange(count)[:, None, None]
    return triangles(points.reshape(-1, 3), faces.reshape(-1, 3), normals.reshape(-1, 3))


def along(axis: np.ndarray) -> np.ndarray:
    """(K, 3, 3) rotations whose first column is along axis (K, 3), which is not zero."""
    first = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    # what is farthest from parallel to the axis
    helper = np.eye(3)[np.abs(first).argmin(axis=1)]
    second = np.cross(first, helper)
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([first, second, np.cross(first, second)], axis=2)


def ball(fine: int) -> pv.PolyData:
    """A ball of radius 1; every step of `fine` has four times the triangles."""
    mesh = pv.Icosphere(radius=1.0, nsub=fine)
    return triangles(mesh.points, mesh.regular_faces, mesh.points)


def arrow() -> pv.PolyData:
    """From the origin to (1, 0, 0)."""
    mesh = pv.Arrow(tip_length=0.24, tip_radius=0.06, shaft_radius=0.022, tip_resolution=16, shaft_resolution=10)
    mesh = mesh.triangulate().compute_normals(cell_normals=False, split_vertices=True, feature_angle=40)
    return triangles(mesh.points, mesh.regular_faces, mesh.point_data["Normals"])


def cone(sides: int = 28) -> pv.PolyData:
    """An open cone: the tip at the origin, the rim of radius 1 around (1, 0, 0)."""
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    rim = np.column_stack([np.ones(sides), np.cos(turn), np.sin(turn)])
    normals = np.column_stack([-np.ones(sides), np.cos(turn), np.sin(turn)]) / np.sqrt(2)
    # the tip once for each side: it has no normal of its own
    faces = np.column_stack([np.arange(sides), sides + np.arange(sides), sides + (np.arange(sides) + 1) % sides])
    return triangles(np.vstack([np.zeros((sides, 3)), rim]), faces, np.vstack([normals, normals]))
