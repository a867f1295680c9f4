"""Where rays meet an object that is drawn, compiled; `object` says which planes it has."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import kernel
from vbaa_calib.geometry.vectors import Vector, dot, moved, scaled, unit, vector
from vbaa_calib.simulate.scene.distance import BOX, FREEFORM, KNIFE, ObjectNumbers, elevation, signed_distance

_STEPS, _HIT_M = 100, 1e-6


class Body(NamedTuple):
    """What is drawn of an object.

    sides : (K, 4) half-spaces normal·(x − centre) ≤ offset. across : (3, 3) projects on the directions across its axis.
    reach_m : radius about the centre that holds it. steepest : how fast F grows at most along a way in a free form.
    """

    object: ObjectNumbers
    sides: np.ndarray
    across: np.ndarray
    reach_m: float
    steepest: float


@kernel
def cast_rays(
    body: Body, origin_m: np.ndarray, directions: np.ndarray, normals: np.ndarray, faces: np.ndarray
) -> np.ndarray:
    """First hits of rays from one origin (3,) along directions (N, 3), world frame.

    Returns
    -------
    (N,) depth in lengths of the ray's vector, inf for a miss. Normals (N, 3) and faces (N,) are written: a round side
    is face 0, a miss face −1 with the normal zero.
    """
    depths = np.empty(len(directions))
    start = moved(vector(origin_m), -1.0, vector(body.object.center_m))
    marched = body.object.kind in (BOX, FREEFORM)
    for i, ray in enumerate(directions):
        along = vector(ray)
        depth, normal, face = _march(body, start, along) if marched else _meet(body, start, along)
        depths[i], faces[i] = depth, face
        for j in range(3):
            normals[i, j] = normal[j]
    return depths


@kernel
def _missed() -> tuple[float, Vector, int]:
    return np.inf, (0.0, 0.0, 0.0), -1


@kernel
def _meet(body: Body, start: Vector, ray: Vector) -> tuple[float, Vector, int]:
    """A convex body: behind all of its planes and inside its quadric."""
    first, last, face, round_sides = -np.inf, np.inf, 0, 0
    across, aside, radius = ray, start, body.object.radius_m
    if body.object.kind != KNIFE:
        across = dot(vector(body.across[0]), ray), dot(vector(body.across[1]), ray), dot(vector(body.across[2]), ray)
        aside = (
            dot(vector(body.across[0]), start),
            dot(vector(body.across[1]), start),
            dot(vector(body.across[2]), start),
        )
        first, last = _quadric(dot(across, across), dot(across, aside), dot(aside, aside) - radius**2)
        round_sides = 1
    for k, side in enumerate(body.sides):
        speed = dot(vector(side), ray)
        speed = 1e-12 if abs(speed) < 1e-12 else speed
        crossed = (side[3] - dot(vector(side), start)) / speed
        if speed > 0.0:
            last = min(last, crossed)
        elif crossed > first:
            first, face = crossed, k + round_sides
    if not (0.0 < first < last):
        return _missed()
    if face < round_sides:
        return first, scaled(1.0 / radius, moved(aside, first, across)), face
    return first, vector(body.sides[face - round_sides]), face


@kernel
def _quadric(a: float, half_b: float, c: float) -> tuple[float, float]:
    """Entry and exit of a ray in a convex quadric, a·t² + 2·half_b·t + c < 0 inside; (inf, −inf) when it passes by."""
    root = half_b**2 - a * c
    if root < 0.0 or a <= 0.0:
        return np.inf, -np.inf
    return (-half_b - np.sqrt(root)) / a, (-half_b + np.sqrt(root)) / a


@kernel
def _march(body: Body, start: Vector, ray: Vector) -> tuple[float, Vector, int]:
    """A body of which only the distance is known."""
    length = np.sqrt(dot(ray, ray))
    way = scaled(1.0 / length, ray)
    depth, leave = _quadric(1.0, dot(way, start), dot(start, start) - (1.01 * body.reach_m) ** 2)
    depth = max(depth, 0.0)
    for _ in range(_STEPS):
        if not depth < leave:
            break
        room, normal, face = _room(body, moved(start, depth, way))
        if room < _HIT_M:
            return depth / length, normal, face
        depth += room
    return _missed()


@kernel
def _room(body: Body, offset: Vector) -> tuple[float, Vector, int]:
    """How far one may go on from a point without passing the drawn surface; the normal and the face there."""
    if body.object.kind == FREEFORM:
        value, slope = elevation(offset, body.object.radius_m, body.object.bumps)
        return value / body.steepest, unit(slope), 0
    room, normal = signed_distance(body.object, moved(offset, 1.0, vector(body.object.center_m)))
    face = 0
    for k, side in enumerate(body.sides):
        away = dot(vector(side), offset) - side[3]
        if away > room:
            room, normal, face = away, vector(side), k + 1
    return room, normal, face


@kernel
def shade(
    body: Body, origin_m: np.ndarray, directions: np.ndarray, depths: np.ndarray, lights: np.ndarray
) -> np.ndarray:
    """(N,) how much of the light on a hit comes back, stains included: `lights` (N,) of it arrive; zero for a miss."""
    shades = np.zeros(len(depths))
    start = moved(vector(origin_m), -1.0, vector(body.object.center_m))
    for i, depth in enumerate(depths):
        if depth < np.inf:
            point = moved(start, depth, vector(directions[i]))
            stains = np.sin(dot(point, (310.0, 120.0, -90.0))) + np.sin(dot(point, (-70.0, 210.0, 260.0)) + 1.0)
            shades[i] = lights[i] * (1.0 + 0.04 * stains)
    return shades
