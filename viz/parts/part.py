"""One part of the picture, ready for VTK, and how all parts look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyvista as pv

ANTENNA, FREE, GHOST, NOW = "#1b2430", "#8a94a3", "#9aa7b8", "#111827"
PLANE, CAMERA, OBJECT, TRUTH = "#3b82f6", "#b45309", "#0d9488", "#c9b791"
SPREAD, CONE, GRID, INK = "#0ea5e9", "#7c3aed", "#aab4c2", "#1f2937"
LOOK = {
    "contacts": (OBJECT, "contact, on the antenna's centreline"),
    "forces": (OBJECT, "force on the antenna"),
    "now": (NOW, "contact at this moment"),
    "spread": (SPREAD, "ellipsoid of 2 std"),
    "cones": (CONE, "friction cone"),
    "object": (OBJECT, "reconstructed surface"),
    "truth": (TRUTH, "true object"),
    "antenna": (ANTENNA, "antenna at this moment"),
    "free": (FREE, "antenna without the object"),
    "ghosts": (GHOST, "antenna at other moments"),
    "plane": (PLANE, "plane C"),
    "camera": (CAMERA, "camera and its picture"),
    "grid": (GRID, "level grid"),
}
"""Name of a part → its colour and what it is called in legends."""


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one colour, of a colour per contact, of colours of their own, or with a picture on them.

    Attributes
    ----------
    name : a key of `LOOK`; several parts may share it.
    mesh : triangles with `Normals`; with uint8 RGB `colour` where `painted`, with texture coordinates where `textured`.
    span : (M, 2) the first and one past the last triangle that each of M moments shows; None for all, always.
    history : the span is what there was up to each moment, so that all of it shows the whole recording.
    poses : (M, 4, 4) where the mesh stands at each moment, NaN for nowhere; None for a mesh in the world frame.
    contact : (K,) the contacts that the mesh repeats one shape for, each with equally many points; their colour follows
        the chosen scale. None for any other mesh.
    note : said in the legend after the name.
    """

    name: str
    mesh: pv.PolyData
    opacity: float = 1.0
    span: np.ndarray | None = None
    history: bool = False
    poses: np.ndarray | None = None
    contact: np.ndarray | None = None
    painted: bool = False
    textured: bool = False
    lit: bool = True
    note: str = ""

    @property
    def colour(self) -> str:
        """Hex colour of what is not painted."""
        return LOOK[self.name][0]

    @property
    def label(self) -> str:
        """What legends say."""
        return LOOK[self.name][1] + (f", {self.note}" if self.note else "")


def triangles(points: np.ndarray, faces: np.ndarray, normals: np.ndarray | None = None) -> pv.PolyData:
    """A mesh of points (V, 3) and triangles (T, 3) in single precision; smooth normals (V, 3) where none are given."""
    mesh = pv.PolyData.from_regular_faces(np.asarray(points, np.float32), np.asarray(faces, int))
    if normals is None:
        mesh = mesh.compute_normals(
            cell_normals=False, split_vertices=False, consistent_normals=False, auto_orient_normals=False
        )
    else:
        mesh.point_data.active_normals = np.asarray(normals, np.float32)
        mesh.point_data.active_normals_name = "Normals"
    return mesh


def joined(meshes: list[pv.PolyData]) -> tuple[pv.PolyData, np.ndarray]:
    """Several meshes of triangles with normals as one, and (len + 1,) where in it the triangles of each begin."""
    shift = np.cumsum([0, *(mesh.n_points for mesh in meshes)])
    faces = [mesh.regular_faces + start for mesh, start in zip(meshes, shift, strict=False)]
    mesh = triangles(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate(faces),
        np.concatenate([np.asarray(mesh.point_data["Normals"]) for mesh in meshes]),
    )
    return mesh, np.cumsum([0, *(len(part) for part in faces)])


def wire(points_m: np.ndarray, radius_m: float, sides: int = 10) -> pv.PolyData:
    """A round wire along points (N, 3), as triangles with normals."""
    line = pv.PolyData(np.asarray(points_m, np.float32), lines=[len(points_m), *range(len(points_m))])
    mesh = line.tube(radius=radius_m, n_sides=sides, capping=True).triangulate()
    return triangles(mesh.points, mesh.regular_faces, mesh.point_data["TubeNormals"])


def wires(paths: list[np.ndarray], radius_m: float, sides: int = 10) -> pv.PolyData:
    """Several wires, each along points (N, 3), as one mesh."""
    return joined([wire(path, radius_m, sides) for path in paths])[0]
