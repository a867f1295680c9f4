"""What was touched, as it was reconstructed, and a level grid that tells sizes."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from viz.scene.colours import UNKNOWN, surface_scale
from viz.scene.scene import ObjectMesh, Scene

from .part import OBJECT, Part, along, ball, joined, stamp, triangles, wires


def object_parts(mesh: ObjectMesh, reach_m: float) -> list[Part]:
    """The reconstructed object, coloured by how well it is known where that is told.

    Points that belong to no triangle are discs across their normal: a piece of the object, however little of it was
    touched. Those without a normal are balls.
    """
    disc_m = 0.03 * reach_m
    pieces, colours = [], []
    rgb = _colours(mesh)
    if len(mesh.triangles):
        pieces.append(triangles(mesh.points_m, mesh.triangles, mesh.normals))
        colours.append(rgb)
    loose = np.setdiff1d(np.arange(len(mesh.points_m)), mesh.triangles)
    facing = loose[np.linalg.norm(mesh.normals[loose], axis=1) > 0.5]
    bare = np.setdiff1d(loose, facing)
    if len(facing):
        disc = pv.Disc(inner=0.0, outer=disc_m, normal=(1, 0, 0), c_res=24).triangulate()
        disc = triangles(disc.points, disc.regular_faces, np.tile([1.0, 0, 0], (disc.n_points, 1)))
        pieces.append(stamp(disc, along(mesh.normals[facing]), mesh.points_m[facing]))
        colours.append(np.repeat(rgb[facing], disc.n_points, axis=0))
    if len(bare):
        small = ball(1)
        pieces.append(stamp(small, np.tile(0.4 * disc_m * np.eye(3), (len(bare), 1, 1)), mesh.points_m[bare]))
        colours.append(np.repeat(rgb[bare], small.n_points, axis=0))
    if len(mesh.lines):
        far = np.linalg.norm(np.diff(mesh.points_m[mesh.lines], axis=1)[:, 0], axis=1) > 0
        tubes = wires([mesh.points_m[ends] for ends in mesh.lines[far]], 0.22 * disc_m, 8) if far.any() else None
        if tubes is not None:
            pieces.append(tubes)
            colours.append(np.tile(np.array(pv.Color(OBJECT).int_rgb, np.uint8), (tubes.n_points, 1)))
    if not pieces:
        return []
    whole, _ = joined(pieces)
    whole.point_data["colour"] = np.concatenate(colours)
    return [Part("object", whole, painted=True)]


def _colours(mesh: ObjectMesh) -> np.ndarray:
    """(V, 3) uint8."""
    if mesh.std_m is None or not np.isfinite(mesh.std_m).any():
        return np.tile(np.array(pv.Color(OBJECT).int_rgb, np.uint8), (len(mesh.points_m), 1))
    used = np.unique(np.concatenate([mesh.triangles.ravel(), np.flatnonzero(np.isfinite(mesh.std_m))]))
    rgb = np.tile(np.array(UNKNOWN, np.uint8), (len(mesh.points_m), 1))
    rgb[used] = surface_scale(mesh.std_m).rgb[used]
    return rgb


def grid_part(scene: Scene) -> Part | None:
    """A level grid under everything, in round squares, to read sizes from; None without a rig."""
    if scene.rig is None:
        return None
    known = np.isfinite(scene.rig.poses[:, 0, 0])
    centre, reach = scene.bounding_ball_m
    points = np.concatenate(
        [scene.rig.bent_m[known].reshape(-1, 3), centre + reach * np.vstack([np.eye(3), -np.eye(3)])]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    side = float(np.hypot(*(high - low)[:2]))
    step = next(size for size in (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, np.inf) if side / size <= 12)
    if not np.isfinite(step):
        return None
    first, last = np.floor(low[:2] / step - 0.25) * step, np.ceil(high[:2] / step + 0.25) * step
    level = low[2] - 0.02 * side
    rows = [
        np.array([[first[0], y, level], [last[0], y, level]]) for y in np.arange(first[1], last[1] + step / 2, step)
    ]
    columns = [
        np.array([[x, first[1], level], [x, last[1], level]]) for x in np.arange(first[0], last[0] + step / 2, step)
    ]
    return Part("grid", wires([*rows, *columns], 0.0011 * side, 4), opacity=0.5, lit=False, note=f"{1e3 * step:g} mm")
