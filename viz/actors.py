"""A scene's arrays as pyvista meshes, with colours and points of view."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from .scene import ObjectMesh, RigItems, Scene, TruthObject

ANTENNA, FREE, GHOST = "#20262e", "#8a94a3", "#9aa7b8"
PLANE, CAMERA, OBJECT, TRUTH, BAR, INK = "#3b82f6", "#b45309", "#0d9488", "#b9ab94", "#6b7280", "#1f2937"
FORCE_MAP = "plasma"
LOOK = {
    "antenna": (ANTENNA, "antenna, at the greatest force"),
    "free": (FREE, "the same without the object"),
    "ghosts": (GHOST, "antenna in other frames"),
    "plane": (PLANE, "plane C"),
    "camera": (CAMERA, "camera"),
    "object": (OBJECT, "reconstructed surface"),
    "truth": (TRUTH, "true object"),
    "bars": (BAR, "contact ± 2 std, along its longest axis"),
}
"""Part of the scene → its colour and its name in legends."""


def parts(scene: Scene) -> list[str]:
    """The keys of `LOOK` that this scene shows."""
    shown = ["antenna", "free", "ghosts", "plane", "camera"] if scene.rig else []
    shown += ["object"] if scene.object else []
    shown += ["truth"] if scene.truth else []
    return [*shown, "bars"]


def force_range_mN(scene: Scene) -> tuple[float, float]:
    """Ends of the colour scale: rounded outwards, never of zero length. Without forces: (0, 1)."""
    size = scene.contacts.size_mN
    if not np.isfinite(size).any():
        return 0.0, 1.0
    low, high = float(np.nanmin(size)), float(np.nanmax(size))
    step = 10.0 ** np.floor(np.log10(max(high - low, 0.05 * high, 1e-6)))
    return float(np.floor(low / step) * step), float(np.ceil(high / step + 1e-9) * step)


def add_scene(plotter: pv.Plotter, scene: Scene, *, scalar_bar: bool) -> None:
    """Put every part of the scene into the active view."""
    if scene.truth is not None:
        _add_truth(plotter, scene.truth)
    if scene.rig is not None:
        _add_rig(plotter, scene.rig)
    if scene.object is not None:
        _add_object(plotter, scene.object, 0.03 * scene.touched_m[1])
    _add_contacts(plotter, scene, scalar_bar)


def tube(points_m: np.ndarray, radius_m: float) -> pv.PolyData:
    """A round wire along points (N, 3)."""
    line = pv.PolyData(points_m, lines=[len(points_m), *range(len(points_m))])
    return line.tube(radius=radius_m, n_sides=20, capping=True)


def _add_rig(plotter: pv.Plotter, rig: RigItems) -> None:
    # thicker than life: 0.8 mm would be less than a pixel
    width = 1.8 * rig.antenna_radius_m
    plotter.add_mesh(tube(rig.bent_m, width), color=ANTENNA, smooth_shading=True, specular=0.5, specular_power=20)
    for ghost in rig.ghosts_m:
        plotter.add_mesh(tube(ghost, width), color=GHOST, opacity=0.45, smooth_shading=True)
    for dash in np.array_split(rig.free_m, max(len(rig.free_m) // 4, 1)):
        if len(dash) > 1:
            plotter.add_mesh(tube(dash[: max(len(dash) - 1, 2)], 0.8 * width), color=FREE)
    plane = pv.PolyData(rig.plane_m, faces=[4, 0, 1, 2, 3])
    plotter.add_mesh(plane, color=PLANE, opacity=0.10, lighting=False)
    edge = float(np.linalg.norm(rig.plane_m[1] - rig.plane_m[0]))
    plotter.add_mesh(tube(rig.plane_m[[0, 1, 2, 3, 0]], 0.0015 * edge), color=PLANE, opacity=0.55)
    centre, corners = rig.frustum_m[0], rig.frustum_m[1:]
    pyramid = pv.PolyData(rig.frustum_m, faces=[3, 0, 1, 2, 3, 0, 2, 3, 3, 0, 3, 4, 3, 0, 4, 1])
    plotter.add_mesh(pyramid, color=CAMERA, opacity=0.16, lighting=False)
    for path in (corners[[0, 1, 2, 3, 0]], *(np.stack([centre, corner]) for corner in corners)):
        plotter.add_mesh(tube(path, 0.0018 * edge), color=CAMERA)
    plotter.add_mesh(pv.Sphere(radius=0.012 * edge, center=centre), color=CAMERA, smooth_shading=True)


def _add_contacts(plotter: pv.Plotter, scene: Scene, scalar_bar: bool) -> None:
    contacts, radius = scene.contacts, scene.touched_m[1]
    bars = pv.PolyData(
        contacts.bars_m.reshape(-1, 3),
        lines=np.column_stack([np.full(len(contacts.bars_m), 2), np.arange(2 * len(contacts.bars_m)).reshape(-1, 2)]),
    )
    plotter.add_mesh(bars.tube(radius=0.003 * radius), color=BAR, opacity=0.8)
    known = np.isfinite(contacts.force_N).all(axis=1)
    if not known.all():
        cloud = pv.PolyData(contacts.points_m[~known])
        plotter.add_mesh(cloud.glyph(geom=pv.Sphere(radius=0.02 * radius), scale=False, orient=False), color=BAR)
    if not known.any():
        return
    cloud = pv.PolyData(contacts.points_m[known])
    cloud["force, mN"] = contacts.size_mN[known]
    longest = max(float(contacts.size_mN[known].max()), 1e-12)
    cloud["length"] = 0.5 * radius * contacts.size_mN[known] / longest
    cloud["force"] = contacts.force_N[known]
    ball = pv.Sphere(radius=0.022 * radius, theta_resolution=20, phi_resolution=20)
    arrow = pv.Arrow(tip_length=0.22, tip_radius=0.055, shaft_radius=0.02, tip_resolution=24, shaft_resolution=16)
    limits = force_range_mN(scene)
    for glyphs in (
        cloud.glyph(geom=ball, scale=False, orient=False),
        cloud.glyph(geom=arrow, scale="length", orient="force"),
    ):
        plotter.add_mesh(
            glyphs, scalars="force, mN", cmap=FORCE_MAP, clim=limits, smooth_shading=True, show_scalar_bar=False
        )
    if scalar_bar:
        plotter.add_scalar_bar(
            title="force on the antenna, mN\n",
            color=INK,
            n_labels=3,
            fmt="%.4g",
            title_font_size=24,
            label_font_size=22,
            width=0.5,
            height=0.075,
            position_x=0.25,
            position_y=0.02,
        )


def _add_object(plotter: pv.Plotter, mesh: ObjectMesh, disc_radius_m: float) -> None:
    if len(mesh.triangles):
        surface = pv.PolyData.from_regular_faces(mesh.points_m, mesh.triangles)
        surface.point_data["Normals"] = mesh.normals
        plotter.add_mesh(surface, color=OBJECT, smooth_shading=True, ambient=0.4, split_sharp_edges=False)
    loose = np.setdiff1d(np.arange(len(mesh.points_m)), mesh.triangles)
    facing = loose[np.linalg.norm(mesh.normals[loose], axis=1) > 0.5]
    if len(facing):
        # a point with its normal is a piece of the object, however little of it was touched
        cloud = pv.PolyData(mesh.points_m[facing])
        cloud["normals"] = mesh.normals[facing]
        disc = pv.Disc(inner=0.0, outer=disc_radius_m, normal=(1, 0, 0), c_res=32)
        plotter.add_mesh(cloud.glyph(geom=disc, scale=False, orient="normals"), color=OBJECT, ambient=0.4)
    bare = np.setdiff1d(loose, facing)
    if len(bare):
        ball = pv.Sphere(radius=0.4 * disc_radius_m)
        plotter.add_mesh(pv.PolyData(mesh.points_m[bare]).glyph(geom=ball, scale=False, orient=False), color=OBJECT)
    if len(mesh.lines):
        lines = pv.PolyData(mesh.points_m, lines=np.column_stack([np.full(len(mesh.lines), 2), mesh.lines]))
        plotter.add_mesh(lines.tube(radius=0.25 * disc_radius_m), color=OBJECT, smooth_shading=True)


def truth_mesh(truth: TruthObject) -> pv.PolyData:
    """The true object; of a knife, its edge and as much of the blade as the edge is half as long."""
    if truth.shape == "sphere":
        return pv.Sphere(radius=truth.radius_m, center=truth.center_m, theta_resolution=96, phi_resolution=64)
    length = 2 * truth.half_length_m
    rod = pv.Cylinder(
        center=truth.center_m, direction=truth.axis, radius=truth.radius_m, height=length, resolution=128
    ).triangulate()
    if truth.shape == "cylinder":
        return rod
    along, into = truth.half_length_m * truth.axis, truth.half_length_m * truth.wedge
    thick = truth.radius_m * np.cross(truth.axis, truth.wedge)
    corners = [truth.center_m + a * along + b * into + c * thick for c in (-1, 1) for b in (0, 1) for a in (-1, 1)]
    return rod.append_polydata(
        pv.PolyData(np.array(corners)).delaunay_3d().extract_surface(algorithm=None).triangulate()
    )


def _add_truth(plotter: pv.Plotter, truth: TruthObject) -> None:
    mesh = truth_mesh(truth)
    plotter.add_mesh(mesh, color=TRUTH, opacity=0.3, smooth_shading=True, split_sharp_edges=True, specular=0.2)


def look_at_all(plotter: pv.Plotter, *, lift: float = 0.0) -> None:
    """The whole rig, from beside and above; `lift` moves it up by this share of half the picture."""
    plotter.view_vector((-0.30, -1.0, 0.52), viewup=(0, 0, 1))
    plotter.camera.zoom(1.1)
    plotter.camera.SetWindowCenter(0.0, -lift)


def look_at_touched(plotter: pv.Plotter, scene: Scene) -> None:
    """What was touched, close up."""
    centre, radius = scene.touched_m
    plotter.view_vector((-0.62, -0.62, 0.48), viewup=(0, 0, 1))
    span = 1.25 * radius
    plotter.reset_camera(bounds=[side for c in centre for side in (c - span, c + span)])
    plotter.camera.zoom(1.45)
    plotter.reset_camera_clipping_range()
