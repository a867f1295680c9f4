"""All parts of a scene, ready for VTK: contacts, objects, the rig at every instant, a grid for scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv

from vbaa_calib.simulate.render.meshes import object_mesh
from viz.scene.layout import LOOK, along
from viz.scene.readable import surface_scale, thinned
from viz.scene.rig_items import RigItems
from viz.scene.scene import ObjectMesh, Scene


@dataclass(frozen=True, eq=False)
class ScenePart:
    """A mesh with one colour, a colour per contact, vertex colours, or a picture as texture.

    Attributes
    ----------
    name : a key of `LOOK`; several parts may share it.
    mesh : triangles with `Normals`; with uint8 RGB `colour` where `painted`, with texture coordinates where `textured`.
    span : (M, 2) first and one past the last triangle visible at each of M instants; None for all.
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
    """One part of each name, the one with the longest label, for legends."""
    longest = {part.name: part for part in sorted(parts, key=lambda part: len(part.label))}
    return [longest[name] for name in dict.fromkeys(part.name for part in parts)]


def _triangles(points: np.ndarray, faces: np.ndarray, normals: np.ndarray | None = None) -> pv.PolyData:
    """A mesh of points (V, 3) and triangles (T, 3) in single precision; smooth normals (V, 3) by default."""
    mesh = pv.PolyData.from_regular_faces(np.asarray(points, np.float32), np.asarray(faces, int))
    if normals is None:
        mesh = mesh.compute_normals(
            cell_normals=False, split_vertices=False, consistent_normals=False, auto_orient_normals=False
        )
    else:
        mesh.point_data.active_normals = np.asarray(normals, np.float32)
        mesh.point_data.active_normals_name = "Normals"
    return mesh


def _joined(meshes: list[pv.PolyData]) -> tuple[pv.PolyData, np.ndarray]:
    """Several triangle meshes with normals as one, and the bounds (len + 1,) of each one's triangles in it."""
    shift = np.cumsum([0, *(mesh.n_points for mesh in meshes)])
    faces = [mesh.regular_faces + start for mesh, start in zip(meshes, shift, strict=False)]
    mesh = _triangles(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate(faces),
        np.concatenate([np.asarray(mesh.point_data["Normals"]) for mesh in meshes]),
    )
    return mesh, np.cumsum([0, *(len(part) for part in faces)])


def _wire(points_m: np.ndarray, radius_m: float, sides: int = 10) -> pv.PolyData:
    """A round wire along points (N, 3), as triangles with normals."""
    line = pv.PolyData(np.asarray(points_m, np.float32), lines=[len(points_m), *range(len(points_m))])
    mesh = line.tube(radius=radius_m, n_sides=sides, capping=True).triangulate()
    return _triangles(mesh.points, mesh.regular_faces, mesh.point_data["TubeNormals"])


def _wires(paths: list[np.ndarray], radius_m: float, sides: int = 10) -> pv.PolyData:
    """Several wires, each along points (N, 3), as one mesh."""
    return _joined([_wire(path, radius_m, sides) for path in paths])[0]


def _stamp(mesh: pv.PolyData, linear: np.ndarray, places: np.ndarray) -> pv.PolyData:
    """Copies of the mesh at K places, in their order.

    mesh : triangles with normals.
    linear : (K, 3, 3) invertible: what is done to the mesh before it is moved to places (K, 3).
    """
    count, each = len(places), mesh.n_points
    points = np.einsum("kij,pj->kpi", linear, np.asarray(mesh.points, float)) + places[:, None]
    # a normal turns with the inverse transpose
    normals = np.einsum("kji,pj->kpi", np.linalg.inv(linear), np.asarray(mesh.point_data["Normals"], float))
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-30)
    faces = mesh.regular_faces[None] + each * np.arange(count)[:, None, None]
    return _triangles(points.reshape(-1, 3), faces.reshape(-1, 3), normals.reshape(-1, 3))


def _ball(fine: int) -> pv.PolyData:
    """A sphere of radius 1; each step of `fine` quadruples the triangles."""
    mesh = pv.Icosphere(radius=1.0, nsub=fine)
    return _triangles(mesh.points, mesh.regular_faces, mesh.points)


def _arrow() -> pv.PolyData:
    """An arrow from the origin to (1, 0, 0)."""
    mesh = pv.Arrow(tip_length=0.24, tip_radius=0.06, shaft_radius=0.022, tip_resolution=16, shaft_resolution=10)
    mesh = mesh.triangulate().compute_normals(cell_normals=False, split_vertices=True, feature_angle=40)
    return _triangles(mesh.points, mesh.regular_faces, mesh.point_data["Normals"])


def _cone() -> pv.PolyData:
    """An open cone with a hem: its apex at the origin, its rim of radius 1 around (1, 0, 0)."""
    sides = 28
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
    return _triangles(points, np.vstack([faces, 2 * sides + ring]), np.vstack([normals, normals, facing]))


def all_parts(scene: Scene) -> list[ScenePart]:
    """Every part of the scene; their number does not depend on the recording's length."""
    parts = _contact_parts(scene)
    if scene.object is not None:
        parts += _object_parts(scene.object, scene.bounding_ball_m[1])
    if scene.truth is not None:
        shape = object_mesh(scene.truth, rings=64)
        parts.append(ScenePart("truth", _triangles(shape.vertices, shape.faces, shape.normals), opacity=0.22))
    if scene.rig is not None:
        parts += [*_rig_parts(scene, scene.rig), *_grid(scene, scene.rig)]
    return parts


def _contact_parts(scene: Scene) -> list[ScenePart]:
    """Spheres, force arrows, ellipsoids and friction cones in order of time: at an instant those so far are visible."""
    contacts = scene.contacts
    count = len(contacts.points_m)
    chosen = thinned(np.arange(count), 2500)
    note = f"{len(chosen)} of {count}" if len(chosen) < count else ""
    size = scene.ball_m * np.eye(3)
    sphere = _ball(2 if len(chosen) <= 400 else 1)
    parts = [_stamped(scene, "contacts", chosen, sphere, size, note=note)]
    if scene.framewise_m is not None:
        parts.append(_stamped(scene, "framewise", chosen, sphere, 0.6 * size))
    drawn = np.flatnonzero(np.isin(contacts.row, scene.instants.row))
    if len(drawn):
        parts.append(_stamped(scene, "now", drawn, sphere, 1.9 * size, opacity=0.35))
    for name, mesh, (chosen, linear, note), opacity in (
        ("forces", _arrow(), scene.arrows(), 1.0),
        ("spread", _ball(2), scene.spreads(), 0.22),
        ("cones", _cone(), scene.cones(), 0.28),
    ):
        if len(chosen):
            parts.append(_stamped(scene, name, chosen, mesh, linear, opacity=opacity, note=note))
    return parts


def _stamped(
    scene: Scene, name: str, chosen: np.ndarray, mesh: pv.PolyData, linear: np.ndarray, **look: Any
) -> ScenePart:
    """Copies of `mesh` at the chosen contacts; at an instant those so far are visible, of "now" only that frame's."""
    rows, instants = scene.contacts.row[chosen], scene.instants.row
    last = np.searchsorted(rows, instants, side="right")
    first = np.searchsorted(rows, instants, side="left") if name == "now" else np.zeros_like(last)
    coloured = name in ("contacts", "forces")
    points = scene.contacts.points_m if name != "framewise" or scene.framewise_m is None else scene.framewise_m
    return ScenePart(
        name,
        _stamp(mesh, np.broadcast_to(linear, (len(chosen), 3, 3)), points[chosen]),
        span=mesh.n_cells * np.column_stack([first, last]),
        history=name != "now",
        contact=chosen if coloured else None,
        painted=coloured,
        **look,
    )


def _object_parts(mesh: ObjectMesh, reach_m: float) -> list[ScenePart]:
    """The reconstructed object, coloured by its uncertainty where known.

    Points outside all triangles are drawn as discs across their normal, or as balls without one.
    """
    disc_m, grey = 0.03 * reach_m, np.array([pv.Color(LOOK["object"][0]).int_rgb], np.uint8)
    known = np.isfinite(mesh.std_m).any()
    rgb = surface_scale(mesh.std_m).rgb if known else np.repeat(grey, len(mesh.points_m), axis=0)
    pieces: list[tuple[pv.PolyData, np.ndarray]] = []
    if len(mesh.triangles):
        pieces.append((_triangles(mesh.points_m, mesh.triangles, mesh.normals), rgb))
    loose = np.setdiff1d(np.arange(len(mesh.points_m)), mesh.triangles)
    flat = np.linalg.norm(mesh.normals[loose], axis=1) > 0.5
    disc = pv.Disc(inner=0.0, outer=disc_m, normal=(1, 0, 0), c_res=24).triangulate()
    disc = _triangles(disc.points, disc.regular_faces, np.tile([1.0, 0, 0], (disc.n_points, 1)))
    small = np.broadcast_to(0.4 * disc_m * np.eye(3), ((~flat).sum(), 3, 3))
    for shape, at, linear in ((disc, loose[flat], along(mesh.normals[loose[flat]])), (_ball(1), loose[~flat], small)):
        if len(at):
            pieces.append((_stamp(shape, linear, mesh.points_m[at]), np.repeat(rgb[at], shape.n_points, axis=0)))
    ends = mesh.points_m[mesh.lines]
    ends = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > 0]
    if len(ends):
        tubes = _wires(list(ends), 0.22 * disc_m, 8)
        pieces.append((tubes, np.repeat(grey, tubes.n_points, axis=0)))
    if not pieces:
        return []
    whole, _ = _joined([piece for piece, _ in pieces])
    whole.point_data["colour"] = np.concatenate([colours for _, colours in pieces])
    return [ScenePart("object", whole, painted=True)]


def _rig_parts(scene: Scene, rig: RigItems) -> list[ScenePart]:
    """The rig at each instant: antenna, free antenna, ghosts, plane C, camera and its picture."""
    width = rig.drawn_radius_m
    edge = float(np.linalg.norm(rig.plane_m[1] - rig.plane_m[0]))
    known = np.isfinite(rig.poses[:, 0, 0])
    # the drawn antenna has fewer nodes
    keep = np.linspace(0, rig.bent_m.shape[1] - 1, 29).round().astype(int)
    antenna, span = _over_time(rig.bent_m[:, keep], known, width)
    free, free_span = _over_time(rig.free_m[:, keep[::4]], known, 0.45 * width, sides=6)
    parts = [ScenePart("antenna", antenna, span=span), ScenePart("free", free, span=free_span, opacity=0.6)]
    if len(rig.ghosts):
        ghosts = _wires([rig.bent_m[index] for index in rig.ghosts], 0.6 * width)
        parts.append(ScenePart("ghosts", ghosts, opacity=0.3))
    corners = rig.plane_m[[0, 1, 2, 3, 0]]
    plane = _triangles(rig.plane_m, np.array([[0, 1, 2], [0, 2, 3]]))
    parts.append(ScenePart("plane", plane, opacity=0.09, poses=rig.poses, lit=False))
    parts.append(ScenePart("plane", _wires([corners], 0.0015 * edge, 6), opacity=0.55, poses=rig.poses))
    grid, centre = rig.picture_m, rig.camera_m
    rim = np.concatenate([grid[0], grid[1:, -1], grid[-1, -2::-1], grid[-2:0:-1, 0], grid[:1, 0]])
    rays = (np.stack([centre, corner]) for corner in (grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0]))
    lens = pv.Icosphere(radius=0.012 * edge, center=centre, nsub=2)
    lens = _triangles(lens.points, lens.regular_faces, (lens.points - centre) / (0.012 * edge))
    parts.append(ScenePart("camera", _joined([_wires([rim, *rays], 0.0016 * edge, 6), lens])[0], poses=rig.poses))
    seen = any(picture is not None for picture in scene.pictures)
    opacity = 1.0 if seen else 0.16
    return [*parts, ScenePart("camera", _sheet(grid), opacity=opacity, poses=rig.poses, textured=seen, lit=False)]


def _over_time(
    paths_m: np.ndarray, known: np.ndarray, radius_m: float, sides: int = 8
) -> tuple[pv.PolyData, np.ndarray]:
    """The wires of all known instants in one mesh, and the range of triangles of each."""
    mesh, starts = _joined([_wire(path, radius_m, sides) for path in paths_m[known]])
    span = np.zeros((len(known), 2), int)
    span[known] = np.column_stack([starts[:-1], starts[1:]])
    return mesh, span


def _sheet(grid: np.ndarray) -> pv.PolyData:
    """The grid (H, W, 3) as triangles; texture coordinates run right and up over the picture."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    mesh = _triangles(grid.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))
    right, down = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    mesh.active_texture_coordinates = np.column_stack([right.ravel(), 1 - down.ravel()]).astype(np.float32)
    return mesh


def _grid(scene: Scene, rig: RigItems) -> list[ScenePart]:
    """A horizontal grid under everything."""
    lines, step = scene.level_grid(rig)
    if not len(lines):
        return []
    thickness = 0.0011 * float(np.hypot(*np.ptp(lines.reshape(-1, 3), axis=0)[:2]))
    return [ScenePart("grid", _wires(list(lines), thickness, 4), opacity=0.5, lit=False, note=f"{1e3 * step:g} mm")]
