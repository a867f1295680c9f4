"""Rays against objects without a closed form: steps along the ray that a bound of the distance allows."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .bumps import elevation, implicit
from .objects import TouchObject

BOX_FACE_M = 0.03
"""How deep a box's two faces are drawn."""
_STEPS, _HIT_M = 100, 1e-6
_STEEPEST = math.exp(-0.5)
"""Largest slope of a bump, in its height over its width."""


def march(obj: TouchObject, origin_m: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Depth (N,) of the first hits, in lengths of the rays' vectors (N, 3), world frame; inf for a miss."""
    bound = _from_box(obj) if obj.shape == "box_edge" else _from_freeform(obj)
    length = np.linalg.norm(directions, axis=1)
    enter, leave = _ball(obj, origin_m, directions / length[:, None])
    depth, found = enter.copy(), np.full(len(enter), np.inf)
    rows = np.flatnonzero(enter < leave)
    for _ in range(_STEPS):
        if rows.size == 0:
            break
        room = bound(origin_m + (depth[rows] / length[rows])[:, None] * directions[rows])
        hit = room < _HIT_M
        found[rows[hit]] = depth[rows[hit]]
        depth[rows] += room
        rows = rows[~hit & (depth[rows] < leave[rows])]
    return found / length


def surface_at(obj: TouchObject, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outward normal (N, 3) and number of the face (N,) at points of the drawn surface."""
    offset = points_m - obj.center_world_m
    if obj.shape == "freeform":
        slope = implicit(offset, obj.radius_m, obj.bumps)[1]
        return slope / np.linalg.norm(slope, axis=1, keepdims=True), np.zeros(len(offset), int)
    ends = _box_ends(obj)
    room = np.column_stack([obj.signed_distance(points_m)[0], offset @ ends[0].T - ends[1]])
    face = room.argmax(axis=1)
    normals = np.where((face == 0)[:, None], obj.signed_distance(points_m)[1], ends[0][np.maximum(face - 1, 0)])
    return normals, face


def reach_m(obj: TouchObject) -> float:
    """Radius about the centre that holds what is drawn."""
    if obj.shape == "freeform":
        return obj.radius_m + sum(max(one.height_m, 0.0) for one in obj.bumps)
    return math.hypot(obj.half_length_m, math.sqrt(2.0) * max(BOX_FACE_M, obj.radius_m))


def _box_ends(obj: TouchObject) -> tuple[np.ndarray, np.ndarray]:
    """Half-spaces normal·(x − centre) ≤ offset, (4, 3) and (4,), that end the box's faces and its edge."""
    axis = np.asarray(obj.axis_world, float)
    return np.vstack([obj.into_faces, axis, -axis]), np.array([BOX_FACE_M] * 2 + [obj.half_length_m] * 2)


def _from_box(obj: TouchObject) -> Callable[[np.ndarray], np.ndarray]:
    normals, offsets = _box_ends(obj)

    def bound(points_m: np.ndarray) -> np.ndarray:
        ends = ((points_m - obj.center_world_m) @ normals.T - offsets).max(axis=1)
        return np.asarray(np.maximum(ends, obj.signed_distance(points_m)[0]))

    return bound


def _from_freeform(obj: TouchObject) -> Callable[[np.ndarray], np.ndarray]:
    steepest = 1.0 + _STEEPEST * sum(abs(one.height_m) / one.width_m for one in obj.bumps)

    def bound(points_m: np.ndarray) -> np.ndarray:
        return elevation(points_m - obj.center_world_m, obj.radius_m, obj.bumps) / steepest

    return bound


def _ball(obj: TouchObject, origin_m: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where unit rays enter and leave the ball of `reach_m`, m; (inf, −inf) for those that pass by."""
    start = origin_m - obj.center_world_m
    half = directions @ start
    root = half**2 - float(start @ start - (1.01 * reach_m(obj)) ** 2)
    spread = np.sqrt(np.maximum(root, 0.0))
    enter = np.where(root < 0, np.inf, np.maximum(-half - spread, 0.0))
    return enter, np.where(root < 0, -np.inf, -half + spread)
