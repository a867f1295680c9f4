"""The rig: antenna, the same without the object, its ghosts, plane C, the camera and what it saw."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from viz.scene.rig_items import RigItems
from viz.scene.scene import Scene

from .part import Part, joined, triangles, wire, wires

_THICKER = 1.8
"""Wires are drawn thicker than life: 0.8 mm would be less than a pixel."""
_NODES = 29


def rig_parts(scene: Scene, rig: RigItems) -> list[Part]:
    """All parts of the rig; at each instant as it stood then."""
    width = _THICKER * rig.antenna_radius_m
    edge = float(np.linalg.norm(rig.plane_m[1] - rig.plane_m[0]))
    known = np.isfinite(rig.poses[:, 0, 0])
    keep = np.linspace(0, rig.bent_m.shape[1] - 1, _NODES).round().astype(int)
    antenna, span = _over_time(rig.bent_m[:, keep], known, width)
    free, free_span = _over_time(rig.free_m[:, keep[::4]], known, 0.45 * width, sides=6)
    parts = [Part("antenna", antenna, span=span), Part("free", free, span=free_span, opacity=0.6)]
    if len(rig.ghosts):
        ghosts = wires([rig.bent_m[index] for index in rig.ghosts], 0.6 * width)
        parts.append(Part("ghosts", ghosts, opacity=0.3))
    corners = rig.plane_m[[0, 1, 2, 3, 0]]
    plane = triangles(rig.plane_m, np.array([[0, 1, 2], [0, 2, 3]]))
    parts.append(Part("plane", plane, opacity=0.09, poses=rig.poses, lit=False))
    parts.append(Part("plane", wires([corners], 0.0015 * edge, 6), opacity=0.55, poses=rig.poses))
    return parts + _camera(scene, rig, edge)


def _over_time(
    paths_m: np.ndarray, known: np.ndarray, radius_m: float, sides: int = 8
) -> tuple[pv.PolyData, np.ndarray]:
    """The wire of every known instant in one mesh, and which triangles are whose."""
    mesh, starts = joined([wire(path, radius_m, sides) for path in paths_m[known]])
    span = np.zeros((len(known), 2), int)
    span[known] = np.column_stack([starts[:-1], starts[1:]])
    return mesh, span


def _camera(scene: Scene, rig: RigItems, edge: float) -> list[Part]:
    grid, centre = rig.picture_m, rig.camera_m
    rim = np.concatenate([grid[0], grid[1:, -1], grid[-1, -2::-1], grid[-2:0:-1, 0], grid[:1, 0]])
    corners = (grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0])
    lines = wires([rim, *(np.stack([centre, corner]) for corner in corners)], 0.0016 * edge, 6)
    ball = pv.Icosphere(radius=0.012 * edge, center=centre, nsub=2)
    body, _ = joined([lines, triangles(ball.points, ball.regular_faces, (ball.points - centre) / (0.012 * edge))])
    parts = [Part("camera", body, poses=rig.poses)]
    sheet = _sheet(grid)
    if any(picture is not None for picture in scene.pictures):
        return [*parts, Part("camera", sheet, poses=rig.poses, textured=True, lit=False)]
    return [*parts, Part("camera", sheet, opacity=0.16, poses=rig.poses, lit=False)]


def _sheet(grid: np.ndarray) -> pv.PolyData:
    """The grid (H, W, 3) as triangles; texture coordinates run right and up over the picture."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    mesh = triangles(grid.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))
    right, down = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    mesh.active_texture_coordinates = np.column_stack([right.ravel(), 1 - down.ravel()]).astype(np.float32)
    return mesh
