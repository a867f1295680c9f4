"""One part of the picture, ready for VTK, and how all parts look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyvista as pv

from viz.scene.layout import LOOK


@dataclass(frozen=True, eq=False)
class ScenePart:
    """A mesh of one colour, of a colour per contact, with vertex colours, or with a picture as texture.

    Attributes
    ----------
    name : a key of `LOOK`; several parts may share it.
    mesh : triangles with `Normals`; with uint8 RGB `colour` where `painted`, with texture coordinates where `textured`.
    span : (M, 2) first and one past the last triangle shown at each of M instants; None for all.
    history : spans grow with time, so that all triangles together show the whole recording.
    poses : (M, 4, 4) of the mesh at each instant, NaN where it is hidden; None for a mesh in the world frame.
    contact : (K,) contacts for which the mesh repeats one shape, coloured by the chosen scale; None for other meshes.
    note : added to the name in legends.
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
        """Hex colour of an unpainted part."""
        return LOOK[self.name][0]

    @property
    def label(self) -> str:
        """Text in legends."""
        return LOOK[self.name][1] + (f", {self.note}" if self.note else "")


def layers_of(parts: list[ScenePart]) -> list[ScenePart]:
    """One part of each name, that with the longest label, for legends."""
    longest = {part.name: part for part in sorted(parts, key=lambda part: len(part.label))}
    return [longest[name] for name in dict.fromkeys(part.name for part in parts)]


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


def stamp(mesh: pv.PolyData, linear: np.ndarray, places: np.ndarray) -> pv.PolyData:
    """The mesh at K places, in their order.

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
    """An open cone with a hem: the tip at the origin, the rim of radius 1 around (1, 0, 0)."""
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    rim = np.column_stack([np.ones(sides), np.cos(turn), np.sin(turn)])
    normals = np.column_stack([-np.ones(sides), np.cos(turn), np.sin(turn)]) / np.sqrt(2)
    # the tip once for each side: it has no normal of its own
    faces = np.column_stack([np.arange(sides), sides + np.arange(sides), sides + (np.arange(sides) + 1) % sides])
    # a ring in the mouth, so that it does not look closed
    hem, facing = np.vstack([rim, rim * [1.0, 0.88, 0.88]]), np.tile([1.0, 0.0, 0.0], (2 * sides, 1))
    here, there = np.arange(sides), (np.arange(sides) + 1) % sides
    ring = np.vstack(
        [np.column_stack([here, there, sides + here]), np.column_stack([there, sides + there, sides + here])]
    )
    points = np.vstack([np.zeros((sides, 3)), rim, hem])
    return triangles(points, np.vstack([faces, 2 * sides + ring]), np.vstack([normals, normals, facing]))
