"""The scene as SVG pictures: the whole rig, and a close-up of the contacts, each from its best side."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from markupsafe import Markup

from viz.figures.drawing import Plot, PlotMarks, pale, picture
from viz.figures.settings import STYLE
from viz.scene.layout import INK, LOOK, along, view_direction
from viz.scene.readable import contact_scale, hexes, object_scale, on_ramp, round_down, thinned
from viz.scene.rig_items import RigItems
from viz.scene.scene import ObjectMesh, Scene

Project = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Points (…, 3) m → (…, 2) px and (…,) px towards the viewer."""
Pieces = list[tuple[float, PlotMarks]]
"""Marks in pixels, each with how near it is to the viewer."""


def scene_views(scene: Scene) -> tuple[Markup, ...]:
    """Two pictures: the whole rig, if there is one, and a close-up of the contacts with its scale."""
    axes = Plot("", (660.0, 480.0), (0, 0, 0, 0), x=(0, 660), y=(480, 0), x_ticks=((), ()), y_ticks=((), ()))
    centre, radius = scene.bounding_ball_m
    scale, world = 480.0 / (2 * 1.3 * radius), _towards(view_direction(scene, height=0.45, liking=0.35))
    project: Project = partial(_projected, world, centre, scale, axes.size)
    pieces = [*_touched(scene, project, scale), *_translucent(scene, project)]
    if scene.rig is not None:
        pieces += _antennas(scene, scene.rig, project, scale)
    _draw(axes, world, [*_truth(scene, project), *pieces])
    length_m = round_down(0.16 * 660 / scale)
    axes.line((636 - length_m * scale, 636), (462, 462), INK, 3.0)
    axes.write((636 - length_m * scale / 2, 454), f"{1e3 * length_m:g} mm", "middle")
    close_up = axes.svg("what was touched, close up", 'class="scene"')
    return (close_up,) if scene.rig is None else (_whole_rig(scene, scene.rig), close_up)


def _towards(direction: np.ndarray) -> np.ndarray:
    """(3, 3) axes of a view: right, up, and along a unit vector (3,) that is not vertical."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])


def _projected(
    axes: np.ndarray, centre_m: np.ndarray, scale: float, size: tuple[float, float], points_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Parallel projection of points along the view's axes (3, 3), with `scale` px/m around the middle."""
    turned = (points_m - centre_m) @ axes.T * scale
    return turned[..., :2] * [1.0, -1.0] + np.array(size) / 2, turned[..., 2]


def _draw(axes: Plot, world: np.ndarray, pieces: Pieces) -> None:
    """SVG of the pieces, the farthest first, with the directions of the world's axes in the lower left corner."""
    axes.marks.extend(mark for _, mark in sorted(pieces, key=lambda piece: piece[0]))
    corner = np.array([34.0, axes.size[1] - 34.0])
    ends = corner + 24.0 * world[:2].T * [1.0, -1.0]
    for end, words, colour in zip(ends, "XYZ", ("#b91c1c", "#15803d", "#1d4ed8"), strict=True):
        axes.paths([[corner, end]], "axis", stroke=colour, width=2.0)
        axes.write(corner + 1.4 * (end - corner), words, "middle", shift=(0, 4))


def _touched(scene: Scene, project: Project, scale: float) -> Pieces:
    """Pieces of contacts, forces and the reconstructed object."""
    contacts, pieces = scene.contacts, Pieces()
    colours = hexes(contact_scale(scene, "force").rgb)
    chosen = thinned(np.arange(len(contacts.points_m)), STYLE.most_balls)
    size = max(2 * scene.ball_m * scale, 2.5)
    for index, at, near in zip(chosen.tolist(), *project(contacts.points_m[chosen]), strict=True):
        ball = PlotMarks("contact", at[None, None], stroke=colours[index], width=size, round_ends=True)
        shine = PlotMarks("shine", at[None, None] - 0.16 * size, stroke="#ffffff66", width=0.38 * size, round_ends=True)
        pieces += [(near, ball), (near, shine)]
    indices, arrows, _ = scene.arrows()
    for index, arrow in zip(indices.tolist(), arrows[:, :, 0], strict=True):
        ends, near = project(contacts.points_m[index] + np.outer([0.0, 0.78, 1.0], arrow))
        length, way = float(np.linalg.norm(arrow)) * scale, ends[2] - ends[1]
        across = 0.07 * length * np.array([-way[1], way[0]]) / max(float(np.linalg.norm(way)), 1e-9)
        head = np.stack([ends[1] + across, ends[2], ends[1] - across])
        shaft = PlotMarks("force", ends[None, :2], stroke=colours[index], width=max(0.045 * length, 0.8))
        pieces += [(float(near[1]), shaft), (float(near[1]), PlotMarks("force", head[None], fill=colours[index]))]
    return [*pieces, *([] if scene.object is None else _object(scene, scene.object, project, scale))]


def _object(scene: Scene, mesh: ObjectMesh, project: Project, scale: float) -> Pieces:
    """Pieces of the object: shaded triangles; lines; points outside all triangles as discs across their normal, or
    small without one."""
    stds, plain = object_scale(scene), LOOK["object"][0]
    rgb = np.array([[int(plain[at : at + 2], 16) for at in (1, 3, 5)]] * len(mesh.points_m))
    rgb = rgb if stds is None else stds.rgb
    faces, pieces = thinned(mesh.triangles, STYLE.most_faces), Pieces()
    corners = mesh.points_m[faces]
    at, depth = project(corners)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    light = normal @ view_direction(scene, height=0.9, liking=0.0)
    shade = 0.6 + 0.4 * np.abs(light) / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
    # few colours: neighbours become one path
    colours = hexes((rgb[faces].mean(axis=1) * shade[:, None] / 6).round().astype(int) * 6)
    for colour, place, near in zip(colours, at, depth.mean(axis=1).tolist(), strict=True):
        pieces.append((near, PlotMarks("object", place[None], fill=colour, stroke=colour, width=0.6)))
    disc = 0.03 * scene.bounding_ball_m[1]
    loose = thinned(np.setdiff1d(np.arange(len(mesh.points_m)), mesh.triangles), STYLE.most_balls)
    flat = np.linalg.norm(mesh.normals[loose], axis=1) > 0.5
    half_m = np.tile(0.4 * disc * np.eye(3)[:2], (len(loose), 1, 1))
    half_m[flat] = disc * np.swapaxes(along(mesh.normals[loose[flat]]), 1, 2)[:, 1:]
    at, depth = project(mesh.points_m[loose])
    shapes = np.concatenate([at[:, None], project(mesh.points_m[loose, None] + half_m)[0]], axis=1)
    for colour, place, near in zip(hexes(rgb[loose]), shapes, depth.tolist(), strict=True):
        pieces.append((near, PlotMarks("object", place[None], fill=colour, ellipse=True)))
    for ends in mesh.points_m[mesh.lines[: STYLE.most_faces]]:
        pieces += _wire(project, ends, plain, max(0.44 * disc * scale, 1.2))
    return pieces


def _wire(project: Project, points_m: np.ndarray, colour: str, width: float) -> Pieces:
    """Pieces of a line through points (K, 3), which other pieces may cover; a translucent line is one piece, because
    overlapping ends would be darker."""
    at, depth = project(points_m)
    if len(colour) > 7:
        return [(float(depth.mean()), PlotMarks("wire", at[None], stroke=colour, width=width))]
    ends = zip(at, at[1:], depth.tolist(), strict=False)
    return [
        (near, PlotMarks("wire", np.stack([one, other])[None], stroke=colour, width=width, round_ends=True))
        for one, other, near in ends
    ]


def _translucent(scene: Scene, project: Project) -> Pieces:
    """Pieces of ellipsoids and cones."""
    turn, pieces = np.linspace(0, 2 * np.pi, 24, endpoint=False)[:, None], Pieces()
    (chosen, axes_m, _), points_m = scene.spreads(), scene.contacts.points_m
    for centre_m, axes in zip(points_m[chosen], axes_m, strict=True):
        at, depth = project(centre_m + np.vstack([np.zeros(3), axes.T]))
        variance, way = np.linalg.eigh((at[1:] - at[0]).T @ (at[1:] - at[0]))
        shape = np.vstack([at[:1], at[0] + (way * np.sqrt(np.maximum(variance, 0.0))).T])
        mark = PlotMarks("spread", shape[None], fill=pale(LOOK["spread"][0], 0.22), ellipse=True)
        pieces.append((float(depth[0]), mark))
    chosen, axes_m, _ = scene.cones()
    for tip_m, (height, *radii) in zip(points_m[chosen], np.swapaxes(axes_m, 1, 2), strict=True):
        rim = tip_m + height + np.cos(turn) * radii[0] + np.sin(turn) * radii[1]
        at, depth = project(np.vstack([tip_m, rim]))
        outline = cv2.convexHull(at.astype(np.float32))[:, 0]
        colour, near = LOOK["cones"][0], float(depth[0])
        pieces.append((near, PlotMarks("cone", outline[None], fill=pale(colour, 0.2))))
        pieces.append((near, PlotMarks("mouth", at[None, 1:], pale(colour, 0.16), pale(colour, 0.75), 0.8)))
    return pieces


def _truth(scene: Scene, project: Project) -> Pieces:
    """Pieces of the true object's side that faces the viewer, pale and shaded, behind all others."""
    if scene.truth is None:
        return []
    from vbaa_calib.simulate.render.meshes import object_mesh

    mesh = object_mesh(scene.truth, rings=16)
    at, depth = project(mesh.vertices[mesh.faces])
    a, b = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
    facing = a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0]
    normal = mesh.normals[mesh.faces[facing]].mean(axis=1)
    shade = np.abs(normal @ view_direction(scene, height=0.9, liking=0.0))
    # opaque, as if it shone through to white paper: where triangles meet, both would count
    rgb = 255 - 0.5 * (255 - np.outer(0.6 + 0.4 * shade, on_ramp([LOOK["truth"][0]] * 2, np.zeros(1))[0]))
    colours = hexes((rgb / 3).round().astype(int) * 3)
    nearest = zip(colours, at[facing], (depth[facing].mean(axis=1) - 1e6).tolist(), strict=True)
    return [
        (near, PlotMarks("truth", place[None], fill=colour, stroke=colour, width=0.6))
        for colour, place, near in nearest
    ]


def _antennas(scene: Scene, rig: RigItems, project: Project, scale: float) -> Pieces:
    """Pieces of the antenna at the greatest force, without the object, and at other times."""
    main, width = scene.instants.main, 2 * rig.drawn_radius_m * scale
    drawn = [(rig.bent_m[index], pale(LOOK["ghosts"][0], 0.35), max(0.6 * width, 0.8)) for index in rig.ghosts]
    if np.isfinite(rig.bent_m[main]).all():
        drawn.append((rig.free_m[main], pale(LOOK["free"][0], 0.6), max(0.45 * width, 0.8)))
        drawn.append((rig.bent_m[main], LOOK["antenna"][0], max(width, 1.4)))
    return [piece for points_m, colour, wide in drawn for piece in _wire(project, points_m, colour, wide)]


def _whole_rig(scene: Scene, rig: RigItems) -> Markup:
    """The rig at the greatest force over a horizontal grid, with plane C, the camera and its picture."""
    axes = Plot("", (440.0, 480.0), (0, 0, 0, 0), x=(0, 440), y=(480, 0), x_ticks=((), ()), y_ticks=((), ()))
    world, pose = _towards(view_direction(scene, height=0.75, liking=0.8)), rig.poses[scene.instants.main]
    lines, placed = scene.level_grid(rig)[0], np.isfinite(pose).all()
    picture_m, plane_m, camera_m = (
        points @ pose[:3, :3].T + pose[:3, 3] for points in (rig.picture_m, rig.plane_m, rig.camera_m)
    )
    every = [lines, picture_m, plane_m, camera_m, rig.bent_m, scene.contacts.points_m]
    turned = np.concatenate([points.reshape(-1, 3) for points in every]) @ world.T
    turned = turned[np.isfinite(turned).all(axis=1)]
    low, high = turned.min(axis=0), turned.max(axis=0)
    scale = 0.94 * float(min(axes.size / np.maximum(high - low, 1e-9)[:2]))
    project: Project = partial(_projected, world, world.T @ ((low + high) / 2), scale, axes.size)
    pieces = [(-np.inf, PlotMarks("grid", project(lines)[0], stroke=pale(LOOK["grid"][0], 0.6), width=0.8))]
    if placed:
        colour = LOOK["plane"][0]
        plane = PlotMarks(
            "plane", project(plane_m)[0][None], fill=pale(colour, 0.09), stroke=pale(colour, 0.8), width=1.2
        )
        pieces += [(-np.inf, plane), *_camera(axes, scene, project(picture_m)[0], project(camera_m)[0])]
    pieces += [*_truth(scene, project), *_touched(scene, project, scale), *_antennas(scene, rig, project, scale)]
    _draw(axes, world, pieces)
    return axes.svg("the whole rig", 'class="scene"')


def _camera(axes: Plot, scene: Scene, grid: np.ndarray, centre: np.ndarray) -> Pieces:
    """Pieces of the camera, and its picture where it has one; px."""
    seen = scene.pictures[scene.instants.main] if scene.pictures else None
    colour, corners = LOOK["camera"][0], grid[[0, 0, -1, -1], [0, -1, -1, 0]]
    if seen is not None:
        axes.under.append(picture(cv2.imencode(".jpg", seen[..., ::-1])[1].tobytes(), corners[[0, 1, 3]]))
    rays = np.stack([np.broadcast_to(centre, corners.shape), corners], axis=1)
    sheet = PlotMarks(
        "camera", corners[None], fill=pale(colour, 0.16 if seen is None else 0.0), stroke=colour, width=1.2
    )
    dot = PlotMarks("camera", centre[None, None], stroke=colour, width=7.0, round_ends=True)
    return [(np.inf, sheet), (np.inf, PlotMarks("camera", rays, stroke=colour, width=1.2)), (np.inf, dot)]
