"""The touched object as the camera sees it: ray cast, shaded and antialiased."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from vbaa_calib.geometry import Pose
from vbaa_calib.native import core
from vbaa_calib.simulate.scene.lens import project
from vbaa_calib.simulate.scene.objects import BOX_FACE_M, LINES, WEDGES, TouchObject

from .antenna import DepthOfObstacle
from .picture import LAMP_WORLD, ImagePatch, Studio, frame_around
from .settings import PAINT


def _cast(obj: TouchObject, origin_m: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First intersections of rays from one origin (3,) along directions (N, 3), world frame: depth (N,) in lengths
    of the direction (inf for a miss), normal (N, 3), face (N,), 0 for a round side."""
    found: tuple[np.ndarray, np.ndarray, np.ndarray] = core.simulate.cast_rays(_body(obj), origin_m, directions)
    return found


def _body(obj: TouchObject) -> SimpleNamespace:
    """The drawn shape as the core reads it: its sides as half-spaces (K, 4), a radius about the centre that holds it,
    and how fast F grows at most along a line in a free form."""
    # exp(−½): largest slope of a bump, in its height over its width
    steepest = 1.0 + math.exp(-0.5) * sum(abs(one.height_m) / one.width_m for one in obj.bumps)
    return SimpleNamespace(
        object=obj.numbers,
        sides=np.column_stack(flat_sides(obj)),
        across=obj.across,
        reach_m=_reach_m(obj),
        steepest=steepest,
    )


def flat_sides(obj: TouchObject) -> tuple[np.ndarray, np.ndarray]:
    """Half-spaces normal·(x − centre) ≤ offset, (K, 3) and (K,), of the flat faces and ends of the drawn shape."""
    axis, into, radius, half = obj.axis_world, obj.wedge_world, obj.radius_m, obj.half_length_m
    if obj.shape == "knife_edge":
        side = np.cross(axis, into)
        sin, cos = np.sin(PAINT.blade_half_angle_rad), np.cos(PAINT.blade_half_angle_rad)
        normals = [-into, cos * side - sin * into, -cos * side - sin * into, into, axis, -axis]
        return np.stack(normals), np.array([radius, radius, radius, PAINT.blade_depth_m, half, half])
    if obj.shape == "box_edge":
        return np.vstack([obj.into_faces, axis, -axis]), np.array([BOX_FACE_M] * 2 + [half] * 2)
    return (np.stack([axis, -axis]), np.full(2, half)) if obj.shape == "cylinder" else (np.zeros((0, 3)), np.zeros(0))


def _reach_m(obj: TouchObject) -> float:
    """Radius about the centre of a sphere that contains the drawn shape."""
    if obj.shape == "freeform":
        return obj.radius_m + sum(max(one.height_m, 0.0) for one in obj.bumps)
    return math.hypot(obj.half_length_m, math.sqrt(2.0) * max(BOX_FACE_M, obj.radius_m))


def pressed_in(obj: TouchObject, depth_m: float) -> TouchObject:
    """The object with its surface moved inwards by the indentation, so that a soft one does not cover the antenna."""
    if obj.shape in WEDGES:
        return replace(obj, center_world_m=obj.center_world_m + depth_m * obj.wedge_world)
    return replace(obj, radius_m=max(obj.radius_m - depth_m, 0.2 * obj.radius_m))


def _world_rays(rays: np.ndarray, T_world_camera: Pose) -> np.ndarray:
    """World directions (N, 3), of unit depth along the camera's z, from (N, 2) x/z and y/z."""
    turn = T_world_camera.rotation
    return rays @ turn[:, :2].T + turn[:, 2]


def obstacle(place: Studio, obj: TouchObject, T_world_camera: Pose) -> DepthOfObstacle:
    """The object as an obstacle between camera and antenna."""
    left, top, right, bottom = _frame(place, obj, T_world_camera)

    def depth(pixels: np.ndarray) -> np.ndarray:
        u, v = pixels.T
        near = (u >= left - 1) & (u <= right) & (v >= top - 1) & (v <= bottom)
        found, rays = np.full(len(pixels), np.inf), _world_rays(place.rays.at(pixels[near]), T_world_camera)
        found[near] = _cast(obj, T_world_camera.translation_m, rays)[0]
        return found

    return depth


def _frame(place: Studio, obj: TouchObject, T_world_camera: Pose) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) bounds of the pixels that may contain the object."""
    corners = T_world_camera.inverse() @ _bounding_points(obj)
    return frame_around(place, project(place.rays.lens, corners))


def _bounding_points(obj: TouchObject) -> np.ndarray:
    axis = obj.axis_world if obj.shape in LINES else np.array([0.0, 0.0, 1.0])
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    side = np.cross(axis, helper) / np.linalg.norm(np.cross(axis, helper))
    reach = PAINT.blade_depth_m * 1.2 if obj.shape == "knife_edge" else obj.radius_m
    half = obj.half_length_m if obj.shape in LINES else obj.radius_m
    if obj.shape in ("box_edge", "freeform"):
        reach = half = _reach_m(obj)
    corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
    return obj.center_world_m + corners @ np.stack([half * axis, reach * side, reach * np.cross(axis, side)])


def object_patch(place: Studio, obj: TouchObject, T_world_camera: Pose) -> ImagePatch | None:
    """The object's picture with antialiased edges; None outside the picture."""
    left, top, right, bottom = _frame(place, obj, T_world_camera)
    if right <= left or bottom <= top:
        return None
    window = left, top, right - left, bottom - top, PAINT.object_subpixels
    turn, origin = np.ascontiguousarray(T_world_camera.rotation), T_world_camera.translation_m
    seen = core.simulate.object_pixels(_body(obj), origin, turn, place.rays.padded, window, LAMP_WORLD, PAINT.ambient)
    seen[0] *= place.spec.object
    return ImagePatch(left, top, 1, *seen)
