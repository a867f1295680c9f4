"""Triangle meshes: tubes around curves, and the touched object. Positions in the unit and frame of the input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.simulate.scene.objects import BOX_FACE_M, WEDGES, TouchObject, implicit

from .object import flat_sides
from .settings import PAINT


@dataclass(frozen=True, eq=False)
class Triangles:
    """A surface of triangles: vertices (V, 3), their outward normals (V, 3), faces (F, 3) counter-clockwise from
    outside."""

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray


def _grid_faces(rows: int, columns: int) -> np.ndarray:
    """(2·(rows−1)·columns, 3) faces of a grid of vertices that closes on itself along its rows."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    quads = np.stack([a, b, b + columns, a, b + columns, a + columns], axis=-1)
    return quads.reshape(-1, 3)


def tube_mesh(s: np.ndarray, points: np.ndarray, radius: np.ndarray | float, step: float) -> Triangles:
    """The tube of radius () or (N,) around the cubic spline through points (N, 3) at s (N,), with flat ends and a
    ring about every `step`.

    The curve itself is interpolated: the tube's axis is the one that `render.antenna.tube` projects.
    """
    from scipy.interpolate import CubicSpline  # slow to load

    curve = CubicSpline(s, points)
    fine = np.linspace(s[0], s[-1], int(np.ceil((s[-1] - s[0]) / step)) + 1)
    middle, along = curve(fine), curve(fine, 1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # the tube is round: any direction across serves that no tangent runs along
    helper = np.eye(3)[np.abs(along).max(axis=0).argmin()]
    side = np.cross(along, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    turn = np.linspace(0.0, 2 * np.pi, PAINT.tube_facets, endpoint=False)[:, None]
    out = np.cos(turn) * side[:, None] + np.sin(turn) * np.cross(along, side)[:, None]
    rings = middle[:, None] + np.interp(fine, s, np.broadcast_to(radius, len(s)))[:, None, None] * out
    count = len(fine) * PAINT.tube_facets
    vertices, normals = [rings.reshape(-1, 3)], [out.reshape(-1, 3)]
    faces = [_grid_faces(len(fine), PAINT.tube_facets)]
    fan = np.stack([np.zeros(30, int), np.arange(1, 31), np.arange(2, 32)], axis=1)
    for ring, outward, order in ((rings[0], -along[0], fan[:, ::-1]), (rings[-1], along[-1], fan)):
        vertices.append(ring)
        normals.append(np.tile(outward, (PAINT.tube_facets, 1)))
        faces.append(order + count)
        count += PAINT.tube_facets
    return Triangles(np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces))


def object_mesh(obj: TouchObject, rings: int = 160) -> Triangles:
    """The object's surface, world frame, m; spheres and free forms in `rings` rings."""
    if obj.shape in ("sphere", "freeform"):
        return _round_mesh(obj, rings)
    from scipy.spatial import ConvexHull, HalfspaceIntersection  # slow to load

    normals, offsets = _planes(obj)
    into = obj.wedge_world if obj.shape in WEDGES else np.zeros(3)
    corners = HalfspaceIntersection(np.column_stack([normals, -offsets]), 0.2 * BOX_FACE_M * into).intersections
    hull = ConvexHull(corners)
    # each face has its own corners: flat, but so many that a round side looks round
    vertices, outward = corners[hull.simplices], hull.equations[:, :3]
    turned = np.einsum("fi,fi->f", np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0]), outward)
    vertices = np.where((turned > 0)[:, None, None], vertices, vertices[:, ::-1])
    faces = np.arange(3 * len(vertices)).reshape(-1, 3)
    return Triangles(vertices.reshape(-1, 3) + obj.center_world_m, np.repeat(outward, 3, axis=0), faces)


def _planes(obj: TouchObject) -> tuple[np.ndarray, np.ndarray]:
    """Half-spaces normal·(x − centre) ≤ offset, (K, 3) and (K,), of cylinder, knife and box, with round sides as
    facets."""
    normals, offsets = flat_sides(obj)
    axis, into = obj.axis_world, obj.wedge_world
    if obj.shape == "knife_edge":
        return normals, offsets
    if obj.shape == "cylinder":
        into = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        into /= np.linalg.norm(into)
    reach = np.pi / 4 if obj.shape == "box_edge" else np.pi
    turn = np.linspace(-reach, reach, PAINT.wedge_facets)[:, None]
    rounding = -np.cos(turn) * into + np.sin(turn) * np.cross(axis, into)
    return np.vstack([rounding, normals]), np.append(np.full(PAINT.wedge_facets, obj.radius_m), offsets)


def _round_mesh(obj: TouchObject, rings: int) -> Triangles:
    """Sphere and free form: the surface along rays from the centre, which meet it once."""
    polar, turn = np.linspace(0.0, np.pi, rings)[:, None], np.linspace(0.0, 2 * np.pi, 2 * rings, endpoint=False)
    out = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) + 0 * turn], axis=-1)
    out = out.reshape(-1, 3)
    surface = obj.radius_along(out)[:, None] * out
    slope = implicit(surface, obj.radius_m, obj.bumps)[1]
    normals = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    return Triangles(surface + obj.center_world_m, normals, _grid_faces(rings, 2 * rings)[:, ::-1])
