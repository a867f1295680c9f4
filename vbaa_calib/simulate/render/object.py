"""The touched object as the camera sees it: ray casting, shaded and antialiased."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.scene.lens import project
from vbaa_calib.simulate.scene.objects import BOX_FACE_M, LINES, WEDGES, TouchObject, implicit

from .antenna import DepthOfObstacle
from .picture import LAMP_WORLD, Patch, Studio, frame_around

_BLADE_HALF_ANGLE_RAD, _BLADE_DEPTH_M = np.deg2rad(3.0), 0.025
_AMBIENT = 0.35
_STEPS, _HIT_M = 100, 1e-6
_STEEPEST = math.exp(-0.5)
"""Largest slope of a bump, in its height over its width."""
_SUBPIXELS = 4


@dataclass(frozen=True, eq=False)
class _Hits:
    """Where rays meet an object: depth (N,) in lengths of the ray's vector (inf: a miss), normal (N, 3), face (N,)."""

    depth: np.ndarray
    normal: np.ndarray
    face: np.ndarray


def cast(obj: TouchObject, origin_m: np.ndarray, directions: np.ndarray) -> _Hits:
    """First hits of rays from one origin (3,) along directions (N, 3), world frame; a round side is face 0."""
    start = origin_m - obj.center_world_m
    if obj.shape in ("box_edge", "freeform"):
        depth = _march(obj, origin_m, directions)
        normal, face = _surface_at(obj, origin_m + _reach(depth) * directions)
    else:
        # a convex body: behind all of its planes and inside its quadric
        normals, offsets = flat_sides(obj)
        speed = directions @ normals.T
        speed = np.where(np.abs(speed) < 1e-12, 1e-12, speed)
        cross = (offsets - normals @ start) / speed
        enter, leave = np.where(speed < 0, cross, -np.inf), np.where(speed > 0, cross, np.inf)
        if obj.shape != "knife_edge":
            across, aside = directions @ obj.across, obj.across @ start
            into, out = _quadric((across**2).sum(axis=1), across @ aside, float(aside @ aside - obj.radius_m**2))
            enter, leave = np.column_stack([into, enter]), np.column_stack([out, leave])
        first, face = enter.max(axis=1), enter.argmax(axis=1)
        depth = np.where((first < leave.min(axis=1)) & (first > 0), first, np.inf)
        if obj.shape == "knife_edge":
            normal = normals[face]
        else:
            side = (aside + _reach(depth) * across) / obj.radius_m
            flat = np.vstack([np.zeros(3), normals])[face]
            normal = np.where((face == 0)[:, None], side, flat)
    missed = ~np.isfinite(depth)
    return _Hits(depth, np.where(missed[:, None], 0.0, normal), np.where(missed, -1, face))


def _reach(depth: np.ndarray) -> np.ndarray:
    """(N, 1) depth of the hits; zero for a miss."""
    return np.where(np.isfinite(depth), depth, 0.0)[:, None]


def _quadric(a: np.ndarray, half_b: np.ndarray, c: float) -> tuple[np.ndarray, np.ndarray]:
    """Entry and exit of a ray in a convex quadric, a·t² + 2·half_b·t + c < 0 inside; (inf, −inf) when it passes by."""
    root = half_b**2 - a * c
    passes = (root < 0) | (a <= 0)
    spread, safe = np.sqrt(np.maximum(root, 0.0)), np.where(a > 0, a, 1.0)
    return np.where(passes, np.inf, (-half_b - spread) / safe), np.where(passes, -np.inf, (-half_b + spread) / safe)


def flat_sides(obj: TouchObject) -> tuple[np.ndarray, np.ndarray]:
    """Half-spaces normal·(x − centre) ≤ offset, (K, 3) and (K,): faces and ends of what is drawn, if not round."""
    axis, into, radius, half = obj.axis_world, obj.wedge_world, obj.radius_m, obj.half_length_m
    if obj.shape == "knife_edge":
        side = np.cross(axis, into)
        sin, cos = np.sin(_BLADE_HALF_ANGLE_RAD), np.cos(_BLADE_HALF_ANGLE_RAD)
        normals = [-into, cos * side - sin * into, -cos * side - sin * into, into, axis, -axis]
        return np.stack(normals), np.array([radius, radius, radius, _BLADE_DEPTH_M, half, half])
    if obj.shape == "box_edge":
        return np.vstack([obj.into_faces, axis, -axis]), np.array([BOX_FACE_M] * 2 + [half] * 2)
    return (np.stack([axis, -axis]), np.full(2, half)) if obj.shape == "cylinder" else (np.zeros((0, 3)), np.zeros(0))


def _march(obj: TouchObject, origin_m: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Depth (N,) of the first hits, in lengths of the rays' vectors (N, 3), world frame; inf for a miss."""
    length = np.linalg.norm(directions, axis=1)
    start = origin_m - obj.center_world_m
    beyond = float(start @ start - (1.01 * _reach_m(obj)) ** 2)
    enter, leave = _quadric(np.ones(len(length)), directions / length[:, None] @ start, beyond)
    depth, found = np.maximum(enter, 0.0), np.full(len(enter), np.inf)
    rows = np.flatnonzero(depth < leave)
    for _ in range(_STEPS):
        if rows.size == 0:
            break
        room = _room(obj, origin_m + (depth[rows] / length[rows])[:, None] * directions[rows])
        hit = room < _HIT_M
        found[rows[hit]] = depth[rows[hit]]
        depth[rows] += room
        rows = rows[~hit & (depth[rows] < leave[rows])]
    return found / length


def _room(obj: TouchObject, points_m: np.ndarray) -> np.ndarray:
    """(N,) how far one may go on from points (N, 3) without passing the drawn surface of a box or a free form."""
    offset = points_m - obj.center_world_m
    if obj.shape == "freeform":
        steepest = 1.0 + _STEEPEST * sum(abs(one.height_m) / one.width_m for one in obj.bumps)
        return implicit(offset, obj.radius_m, obj.bumps)[0] / steepest
    normals, offsets = flat_sides(obj)
    return np.asarray(np.maximum((offset @ normals.T - offsets).max(axis=1), obj.signed_distance(points_m)[0]))


def _surface_at(obj: TouchObject, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outward normal (N, 3) and number of the face (N,) at points of the drawn surface."""
    offset = points_m - obj.center_world_m
    if obj.shape == "freeform":
        slope = implicit(offset, obj.radius_m, obj.bumps)[1]
        return slope / np.linalg.norm(slope, axis=1, keepdims=True), np.zeros(len(offset), int)
    (distance, normal), (normals, offsets) = obj.signed_distance(points_m), flat_sides(obj)
    face = np.column_stack([distance, offset @ normals.T - offsets]).argmax(axis=1)
    return np.where((face == 0)[:, None], normal, normals[np.maximum(face - 1, 0)]), face


def _reach_m(obj: TouchObject) -> float:
    """Radius about the centre that holds what is drawn."""
    if obj.shape == "freeform":
        return obj.radius_m + sum(max(one.height_m, 0.0) for one in obj.bumps)
    return math.hypot(obj.half_length_m, math.sqrt(2.0) * max(BOX_FACE_M, obj.radius_m))


def pressed_in(obj: TouchObject, depth_m: float) -> TouchObject:
    """The object with its skin drawn back: a soft one gives way to the antenna, which then is not buried in it."""
    if obj.shape in WEDGES:
        return replace(obj, center_world_m=obj.center_world_m + depth_m * obj.wedge_world)
    return replace(obj, radius_m=max(obj.radius_m - depth_m, 0.2 * obj.radius_m))


def _world_rays(rays: np.ndarray, T_world_camera: Pose) -> np.ndarray:
    """(N, 2) x/z, y/z to (N, 3) directions in the world whose length counts depth along the camera's z."""
    turn = T_world_camera.rotation
    return rays @ turn[:, :2].T + turn[:, 2]


def obstacle(place: Studio, obj: TouchObject, T_world_camera: Pose) -> DepthOfObstacle:
    """The object as something that may stand in front of the antenna."""

    def depth(pixels: np.ndarray) -> np.ndarray:
        return cast(obj, T_world_camera.translation_m, _world_rays(place.rays.at(pixels), T_world_camera)).depth

    return depth


def _bounding_points(obj: TouchObject) -> np.ndarray:
    axis = obj.axis_world if obj.shape in LINES else np.array([0.0, 0.0, 1.0])
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    side = np.cross(axis, helper) / np.linalg.norm(np.cross(axis, helper))
    reach = _BLADE_DEPTH_M * 1.2 if obj.shape == "knife_edge" else obj.radius_m
    half = obj.half_length_m if obj.shape in LINES else obj.radius_m
    if obj.shape in ("box_edge", "freeform"):
        reach = half = _reach_m(obj)
    corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
    return obj.center_world_m + corners @ np.stack([half * axis, reach * side, reach * np.cross(axis, side)])


def _shade(obj: TouchObject, hits: _Hits, origin_m: np.ndarray, directions: np.ndarray, albedo: float) -> np.ndarray:
    points = origin_m + _reach(hits.depth) * directions - obj.center_world_m
    stains = np.sin(points @ [310.0, 120.0, -90.0]) + np.sin(points @ [-70.0, 210.0, 260.0] + 1.0)
    light = _AMBIENT + (1.0 - _AMBIENT) * np.maximum(hits.normal @ LAMP_WORLD, 0.0)
    return albedo * light * (1.0 + 0.04 * stains) * np.isfinite(hits.depth)


def object_patch(place: Studio, obj: TouchObject, T_world_camera: Pose) -> Patch | None:
    """The object's picture, edges antialiased; None when it is outside the picture."""
    corners = T_world_camera.inverse() @ _bounding_points(obj)
    left, top, right, bottom = frame_around(place, project(place.rays.lens, corners))
    if right <= left or bottom <= top:
        return None
    origin, albedo = T_world_camera.translation_m, place.spec.object
    shape = (bottom - top, right - left)
    directions = _world_rays(place.rays.centres[top:bottom, left:right].reshape(-1, 2), T_world_camera)
    hits = cast(obj, origin, directions)
    brightness = _shade(obj, hits, origin, directions, albedo).reshape(shape)
    alpha = np.isfinite(hits.depth).astype(float).reshape(shape)

    faces = (hits.face + 1).astype(np.uint8).reshape(shape)
    around = np.ones((3, 3), np.uint8)
    rows, columns = np.nonzero(cv2.dilate(faces, around) != cv2.erode(faces, around))
    if rows.size:
        steps = (np.arange(_SUBPIXELS) + 0.5) / _SUBPIXELS - 0.5
        inner = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(1, -1, 2)
        samples = np.stack([columns + left, rows + top], axis=1)[:, None, :] + inner
        fine = _world_rays(place.rays.at(samples.reshape(-1, 2)), T_world_camera)
        fine_hits = cast(obj, origin, fine)
        brightness[rows, columns] = _shade(obj, fine_hits, origin, fine, albedo).reshape(len(rows), -1).mean(axis=1)
        alpha[rows, columns] = np.isfinite(fine_hits.depth).reshape(len(rows), -1).mean(axis=1)
    return Patch(left, top, 1, brightness.astype(np.float32), alpha.astype(np.float32))
