"""A scene's parts in a pyvista plotter, with instant, colour scale and camera."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pyvista as pv
from vtkmodules.vtkCommonCore import vtkLogger

from viz.parts.assemble import ScenePart
from viz.scene.layout import view_direction
from viz.scene.readable import contact_scale
from viz.scene.scene import Scene


class Stage:
    """A scene in a plotter of its own; `actors` are in the order of `parts`."""

    def __init__(
        self,
        scene: Scene,
        parts: list[ScenePart],
        mode: str = "force",
        size: tuple[int, int] = (1200, 800),
        *,
        off_screen: bool = True,
    ) -> None:
        self.plotter = pv.Plotter(off_screen=off_screen, window_size=list(size), title="vbaa")
        self.plotter.set_background("#ffffff")
        self.scene, self.parts = scene, parts
        # parts are shared between stages: what changes with time and colours is copied
        self._meshes = [part.mesh.copy(deep=False) for part in parts]
        self._faces = [part.mesh.regular_faces for part in parts]
        self.paint(mode)
        self.actors = [self._add(part, mesh) for part, mesh in zip(parts, self._meshes, strict=True)]
        self.show(scene.instants.main)

    def _add(self, part: ScenePart, mesh: pv.PolyData) -> pv.Actor:
        colour = {"scalars": "colour", "rgb": True} if part.painted else {"color": part.colour}
        if part.textured:
            # any other colour would tint the picture
            colour = {"color": "white", "texture": _texture(next(p for p in self.scene.pictures if p is not None))}
        actor = self.plotter.add_mesh(
            mesh, opacity=part.opacity, lighting=part.lit, copy_mesh=False, reset_camera=False, render=False, **colour
        )
        if part.painted:
            actor.prop.color = "white"  # glTF multiplies it with the colours of the vertices
        actor.prop.interpolation = "Phong" if part.lit else "Flat"
        actor.prop.ambient, actor.prop.diffuse = 0.25, 0.8
        if part.name in ("antenna", "contacts", "forces"):
            actor.prop.specular, actor.prop.specular_power = 0.35, 25
        return actor

    def paint(self, mode: str) -> None:
        """Colour the contacts by one of `readable.MODES`."""
        rgb = contact_scale(self.scene, mode).rgb
        for part, mesh in zip(self.parts, self._meshes, strict=True):
            if part.contact is not None:
                mesh.point_data["colour"] = np.repeat(rgb[part.contact], mesh.n_points // len(part.contact), axis=0)

    def show(self, instant: int, *, everything: bool = True) -> None:
        """Show one instant; with `everything`, the contacts of all instants."""
        for part, actor, mesh, faces in zip(self.parts, self.actors, self._meshes, self._faces, strict=True):
            if part.span is not None:
                first, last = (0, len(faces)) if part.history and everything else part.span[instant]
                mesh.regular_faces = faces[first:last]
                actor.visibility = bool(last > first)
            if part.poses is not None:
                known = bool(np.isfinite(part.poses[instant]).all())
                actor.visibility = known
                if known:
                    actor.user_matrix = part.poses[instant]
            if part.textured:
                picture = self.scene.pictures[instant]
                actor.visibility = actor.visibility and picture is not None
                if picture is not None:
                    actor.texture = _texture(picture)

    def unfold(self) -> None:
        """Put all instants' triangles into every mesh, for a viewer that selects among them itself."""
        for actor, mesh, faces in zip(self.actors, self._meshes, self._faces, strict=True):
            mesh.regular_faces = faces
            actor.visibility = True

    def look_at_all(self) -> None:
        """Show the whole rig from the touched side and from above."""
        self.plotter.view_vector(view_direction(self.scene, height=0.75, liking=0.8), viewup=(0, 0, 1))
        camera = self.plotter.camera
        focus = np.array(camera.focal_point)
        camera.position = focus + (np.array(camera.position) - focus) / 1.15
        self.plotter.reset_camera_clipping_range()

    def look_at_contacts(self, *, parallel: bool = True) -> float:
        """Show the contacts close up. Returns half the visible height, m."""
        centre, radius = self.scene.bounding_ball_m
        half = 1.3 * radius
        away = half / np.tan(np.radians(15))
        direction = view_direction(self.scene, height=0.45, liking=0.35)
        self.plotter.camera_position = [centre + away * direction, centre, (0.0, 0.0, 1.0)]
        self.plotter.camera.view_angle = 30
        if parallel:
            self.plotter.enable_parallel_projection()
            self.plotter.camera.parallel_scale = half
        self.plotter.reset_camera_clipping_range()
        return half


def _texture(picture: np.ndarray) -> pv.Texture:
    """(H, W, 3) uint8 with its first row at the top."""
    made = pv.numpy_to_texture(np.ascontiguousarray(picture))
    made.interpolate = True
    made.repeat = False
    return made


@contextmanager
def quiet() -> Iterator[None]:
    """Context without VTK's warnings on stderr about a missing display."""
    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)
