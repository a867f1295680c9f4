"""A scene with everything in it, for the tests of what is drawn."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.rig import Rig
from viz.scene.scene import ObjectMesh, Scene, build_scene
from viz.scene.truth import true_object

RED, GREEN = (250, 20, 10), (10, 240, 20)


def full_scene(table: ContactTable, rig: Rig, truth: dict[str, Any]) -> Scene:
    """All parts; the pictures are red, then green, and the last instant has none."""
    points, force = table.point_world_m[:90], table.force_world_N[:90]
    normals = force / np.linalg.norm(force, axis=1, keepdims=True)
    triangles = np.array([[i, i + 1, i + 9] for i in range(80)] + [[i + 1, i + 10, i + 9] for i in range(80)])
    red, green = (np.full((6, 8, 3), colour, np.uint8) for colour in (RED, GREEN))
    mesh = ObjectMesh(points, normals, triangles, np.empty((0, 2), int), np.linspace(1e-4, 5e-4, 90))
    return replace(
        build_scene(table, rig, truth=true_object(truth)),
        object=mesh,
        normals=normals,
        cone_rad=0.3,
        facts=("Friction <is> told.",),
        pictures=(*[red] * 60, *[green] * 31, None),
    )
