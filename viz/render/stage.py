"""A scene's parts in a pyvista plotter, at any instant and by any colour scale."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from viz.parts import Part
from viz.scene.colours import contact_scale
from viz.scene.scene import Scene


class Stage:
    """What draws a scene in one plotter's active view.

    Attributes
    ----------
    parts, actors : each part and what draws it, in the same order.
    """

    def __init__(self, plotter: pv.Plotter, scene: Scene, parts: list[Part], mode: str = "force") -> None:
        self.scene, self.parts = scene, parts
        # one part may stand on several stages: what changes with time and colours is the stage's own
        self._meshes = [part.mesh.copy(deep=False) for part in parts]
        self._faces = [part.mesh.regular_faces for part in parts]
        self.paint(mode)
        self.actors = [self._add(plotter, part, mesh) for part, mesh in zip(parts, self._meshes, strict=True)]
        self.show(scene.instants.main)

    def _add(self, plotter: pv.Plotter, part: Part, mesh: pv.PolyData) -> pv.Actor:
        colour = {"scalars": "colour", "rgb": True} if part.painted else {"color": part.colour}
        if part.textured:
            # any other colour would tint the picture
            colour = {"color": "white", "texture": _texture(next(p for p in self.scene.pictures if p is not None))}
        actor = plotter.add_mesh(
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
        """Colour the contacts by force, time or uncertainty."""
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
        """Put all instants' triangles into every mesh, for a viewer that chooses among them itself."""
        for actor, mesh, faces in zip(self.actors, self._meshes, self._faces, strict=True):
            mesh.regular_faces = faces
            actor.visibility = True


def _texture(picture: np.ndarray) -> pv.Texture:
    """(H, W, 3) uint8 with its first row at the top."""
    made = pv.numpy_to_texture(np.ascontiguousarray(picture))
    made.interpolate = True
    made.repeat = False
    return made
