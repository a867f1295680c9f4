"""All parts of a scene."""

from __future__ import annotations

from viz.scene.scene import Scene

from .contacts import contact_parts
from .object import grid_part, object_parts
from .part import Part
from .rig import rig_parts
from .true_object import truth_part


def all_parts(scene: Scene) -> list[Part]:
    """Every part that this scene shows, opaque ones in any order; their number does not grow with the recording."""
    parts = contact_parts(scene)
    if scene.object is not None:
        parts += object_parts(scene.object, scene.bounding_ball_m[1])
    if scene.truth is not None:
        parts.append(truth_part(scene.truth))
    if scene.rig is not None:
        parts += rig_parts(scene, scene.rig)
    grid = grid_part(scene)
    return parts if grid is None else [*parts, grid]
