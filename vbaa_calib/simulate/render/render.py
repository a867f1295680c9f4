"""One planned picture, from back to front: the surroundings, the board or the object, the antenna, its holder."""

from __future__ import annotations

import numpy as np

from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.plan.plan import AntennaShot, BoardShot
from vbaa_calib.simulate.scene.scene import Scene

from .antenna import DepthOfObstacle, Tube, tube, tube_patch, visible_centreline
from .board import Sheet, board_patch
from .object import object_layer, obstacle, pressed_in
from .picture import LAMP_WORLD, Patch, Studio, digitise, expose, over, surroundings

HOLDER_PAINT = 0.07


def render_shot(
    scene: Scene, place: Studio, sheet: Sheet, shot: BoardShot | AntennaShot, rng: np.random.Generator
) -> np.ndarray:
    """(height, width) uint8, the picture as the camera delivers it."""
    T_world_camera = scene.T_world_antenna(shot.joints) @ scene.T_antenna_camera
    canvas = surroundings(place, T_world_camera.rotation)
    if isinstance(shot, BoardShot):
        patches = [board_patch(place, sheet, shot.T_camera_board, T_world_camera.rotation)]
    else:
        patches = [_antenna_patch(scene, place, shot, T_world_camera), _holder_patch(scene, place, T_world_camera)]
        thing = None if shot.indentation_m is None else object_layer(place, scene.object, T_world_camera)
        canvas = canvas if thing is None else over(canvas, thing)
    grey = expose(place, canvas, [patch for patch in patches if patch is not None])
    return digitise(place.spec, grey, rng)


def seen_centreline(scene: Scene, place: Studio, shot: AntennaShot) -> np.ndarray:
    """(M, 4) pixels and unit normals of the antenna's centreline where this shot shows it, about one per pixel."""
    T_world_camera = scene.T_world_antenna(shot.joints) @ scene.T_antenna_camera
    hidden_by = _obstacle(scene, place, shot, T_world_camera)
    return visible_centreline(scene.lens, _antenna(scene, shot, T_world_camera), hidden_by)


def _antenna(scene: Scene, shot: AntennaShot, T_world_camera: Pose) -> Tube:
    points = scene.T_antenna_camera.inverse() @ shot.points_m
    return tube(scene.lens, shot.arclength_m, points, scene.radius_m, T_world_camera.rotation.T @ LAMP_WORLD)


def _obstacle(scene: Scene, place: Studio, shot: AntennaShot, T_world_camera: Pose) -> DepthOfObstacle | None:
    if shot.indentation_m is None:
        return None
    return obstacle(place, pressed_in(scene.object, shot.indentation_m), T_world_camera)


def _antenna_patch(scene: Scene, place: Studio, shot: AntennaShot, T_world_camera: Pose) -> Patch | None:
    hidden_by = _obstacle(scene, place, shot, T_world_camera)
    seen = _antenna(scene, shot, T_world_camera)
    return tube_patch(place, seen, place.spec.antenna, place.spec.shading_asymmetry, hidden_by)


def _holder_patch(scene: Scene, place: Studio, T_world_camera: Pose) -> Patch | None:
    radius, length = scene.true.holder_m
    if radius <= 0 or length <= 0:
        return None
    s = np.linspace(-length, 0.0, 8)
    points = scene.T_antenna_camera.inverse() @ (scene.true.clamp_offset_m + s[:, None] * np.array([1.0, 0.0, 0.0]))
    seen = tube(scene.lens, s, points, radius, T_world_camera.rotation.T @ LAMP_WORLD)
    return tube_patch(place, seen, HOLDER_PAINT)
