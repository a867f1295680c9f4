"""One planned picture, from back to front: the surroundings, the board or the object, the antenna, its holder."""

from __future__ import annotations

import numpy as np

from ..geometry import Pose
from .picture import LAMP_WORLD, Layer, Studio, digitise, expose, over, surroundings
from .plan import Shot
from .render_antenna import DepthOfObstacle, Tube, tube, tube_layer, visible_centreline
from .render_board import Sheet, board_layer
from .render_object import object_layer, obstacle, pressed_in
from .scene import Scene

HOLDER_PAINT = 0.07


def render_shot(scene: Scene, place: Studio, sheet: Sheet, shot: Shot, rng: np.random.Generator) -> np.ndarray:
    """(height, width) uint8, the picture as the camera delivers it."""
    T_world_camera = _world_camera(scene, shot)
    canvas = surroundings(place, T_world_camera.rotation)
    for layer in _layers(scene, place, sheet, shot, T_world_camera):
        if layer is not None:
            canvas = over(canvas, layer)
    return digitise(place.spec, expose(place, canvas), rng)


def seen_centreline(scene: Scene, place: Studio, shot: Shot) -> np.ndarray:
    """(M, 4) pixels and unit normals of the antenna's centreline where this shot shows it, about one per pixel."""
    T_world_camera = _world_camera(scene, shot)
    return visible_centreline(
        scene.lens, _antenna(scene, shot, T_world_camera), _obstacle(scene, place, shot, T_world_camera)
    )


def _world_camera(scene: Scene, shot: Shot) -> Pose:
    return scene.T_world_antenna(shot.joints) @ scene.T_antenna_camera


def _layers(scene: Scene, place: Studio, sheet: Sheet, shot: Shot, T_world_camera: Pose) -> list[Layer | None]:
    if shot.T_camera_board is not None:
        return [board_layer(place, sheet, shot.T_camera_board, T_world_camera.rotation)]
    seen = _antenna(scene, shot, T_world_camera)
    hidden_by = _obstacle(scene, place, shot, T_world_camera)
    spec = place.spec
    layers = [tube_layer(place, seen, spec.antenna, spec.shading_asymmetry, hidden_by), _holder(scene, place, T_world_camera)]
    return layers if shot.indentation_m is None else [object_layer(place, scene.object, T_world_camera), *layers]


def _antenna(scene: Scene, shot: Shot, T_world_camera: Pose) -> Tube:
    points = scene.T_antenna_camera.inverse() @ shot.points_m
    return tube(scene.lens, shot.arclength_m, points, scene.radius_m, T_world_camera.rotation.T @ LAMP_WORLD)


def _obstacle(scene: Scene, place: Studio, shot: Shot, T_world_camera: Pose) -> DepthOfObstacle | None:
    if shot.indentation_m is None:
        return None
    return obstacle(place, pressed_in(scene.object, shot.indentation_m), T_world_camera)


def _holder(scene: Scene, place: Studio, T_world_camera: Pose) -> Layer | None:
    radius, length = scene.true.holder_m
    if radius <= 0 or length <= 0:
        return None
    s = np.linspace(-length, 0.0, 8)
    points = scene.true.clamp_offset_m + s[:, None] * np.array([1.0, 0.0, 0.0])
    seen = tube(
        scene.lens, s, scene.T_antenna_camera.inverse() @ points, radius, T_world_camera.rotation.T @ LAMP_WORLD
    )
    return tube_layer(place, seen, HOLDER_PAINT)
