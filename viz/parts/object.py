"""What was touched, as it was reconstructed, and a level grid that tells sizes."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from viz.scene.colours import surface_scale
from viz.scene.scene import ObjectMesh, Scene

from .part import OBJECT, Part, along, ball, joined, stamp, triangles, wires


def object_parts(mesh: ObjectMesh, reach_m: float) -> list[Part]:
    """The reconstructed object, coloured by how well it is known where that is known.

    Points that belong to no triangle are discs across their normal: a piece of the object, however little of it was
    touched. Those without a normal are balls.
    """
    disc_m = 0.03 * reach_m
    rgb = _colours(mesh)
    pieces: list[tuple[pv.PolyData, np.ndarray]] = []
    if len(mesh.triangles):
        pieces.append((triangles(mesh.points_m, mesh.triangles, mesh.normals), rgb))
    loose = np.setdiff1d(np.arange(len(mesh.points_m)), mesh.triangles)
    flat = np.linalg.norm(mesh.normals[loose], axis=1) > 0.5
    disc = pv.Disc(inner=0.0, outer=disc_m, normal=(1, 0, 0), c_res=24).triangulate()
    disc = triangles(disc.points, disc.regular_faces, np.tile([1.0, 0, 0], (disc.n_points, 1)))
    small = np.broadcast_to(0.4 * disc_m * np.eye(3), ((~flat).sum(), 3, 3))
    for shape, at, linear in ((disc, loose[flat], along(mesh.normals[loose[flat]])), (ball(1), loose[~flat], small)):
        if len(at):
            pieces.append((stamp(shape, linear, mesh.points_m[at]), np.repeat(rgb[at], shape.n_points, axis=0)))
    ends = mesh.points_m[mesh.lines]
    ends = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > 0]
    if len(ends):
        tubes = wires(list(ends), 0.22 * disc_m, 8)
        pieces.append((tubes, np.tile(np.array(pv.Color(OBJECT).int_rgb, np.uint8), (tubes.n_points, 1))))
    if not pieces:
        return []
    whole, _ = joined([piece for piece, _ in pieces])
    whole.point_data["colour"] = np.concatenate([colours for _, colours in pieces])
    return [Part("object", whole, painted=True)]


def _colours(mesh: ObjectMesh) -> np.ndarray:
    """(V, 3) uint8; grey for loose points of unknown deviation."""
    if mesh.std_m is None or not np.isfinite(mesh.std_m).any():
        return np.tile(np.array(pv.Color(OBJECT).int_rgb, np.uint8), (len(mesh.points_m), 1))
    return surface_scale(mesh.std_m).rgb


def grid_part(scene: Scene) -> Part | None:
    """A level grid under everything, in round squares, to read sizes from; None without a rig."""
    if scene.rig is None:
        return None
    known = np.isfinite(scene.rig.poses[:, 0, 0])
    centre, reach = scene.bounding_ball_m
    points = np.vstack([scene.rig.bent_m[known].reshape(-1, 3), centre + reach, centre - reach])
    low, high = points.min(axis=0), points.max(axis=0)
    side = float(np.hypot(*(high - low)[:2]))
    step = next((size for size in (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if side / size <= 12), None)
    if step is None:
        return None
    first, last = np.floor(low[:2] / step - 0.25) * step, np.ceil(high[:2] / step + 0.25) * step
    level = low[2] - 0.02 * side
    x, y = (np.arange(a, b + step / 2, step) for a, b in zip(first, last, strict=True))
    rows = [np.array([[first[0], at, level], [last[0], at, level]]) for at in y]
    columns = [np.array([[at, first[1], level], [at, last[1], level]]) for at in x]
    return Part("grid", wires([*rows, *columns], 0.0011 * side, 4), opacity=0.5, lit=False, note=f"{1e3 * step:g} mm")
