"""How far points are from an object, compiled; what is said of it in `objects` holds here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.newton import solve
from vbaa_calib.geometry.vectors import Vector, cross, dot, moved, scaled, turned, unit, vector

CYLINDER, SPHERE, KNIFE, BOX, FREEFORM = range(5)

_ITERATIONS = 30
_TOLERANCE = 1e-14
_RADIUS_ITERATIONS = 6


class ObjectNumbers(NamedTuple):
    """An object as the kernels know it: its kind, vectors (3,), and bumps (K, 5), directions, heights and widths."""

    kind: int
    center_m: np.ndarray
    axis: np.ndarray
    wedge: np.ndarray
    radius_m: float
    bumps: np.ndarray


@kernel
def signed_distances(obj: ObjectNumbers, points_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(K,) of points (K, 3); the normals (K, 3) are written."""
    distances = np.empty(len(points_m))
    for i, point in enumerate(points_m):
        distances[i], normal = signed_distance(obj, vector(point))
        for j in range(3):
            normals[i, j] = normal[j]
    return distances


@kernel
def rough_distances(obj: ObjectNumbers, points_m: np.ndarray) -> np.ndarray:
    """(K,) of points (K, 3): zero on the surface too, and without a search."""
    distances = np.empty(len(points_m))
    for i, point in enumerate(points_m):
        if obj.kind == FREEFORM:
            distances[i] = elevation(moved(vector(point), -1.0, vector(obj.center_m)), obj.radius_m, obj.bumps)[0]
        else:
            distances[i] = signed_distance(obj, vector(point))[0]
    return distances


@kernel
def first_within(
    obj: ObjectNumbers, rotations: np.ndarray, origins_m: np.ndarray, points_m: np.ndarray, room_m: float
) -> int:
    """The first of A poses (A, 3, 3), (A, 3) at which one of the points (N, 3) is nearer than that; A where none is."""
    # F grows no faster than this: where it is larger, nothing needs to be searched
    steepest = 1.0
    for bump in obj.bumps:
        steepest += abs(bump[3]) / bump[4]
    for i, rotation in enumerate(rotations):
        origin = vector(origins_m[i])
        for each in points_m:
            point = moved(turned(rotation, vector(each)), 1.0, origin)
            if obj.kind == FREEFORM:
                offset = moved(point, -1.0, vector(obj.center_m))
                if elevation(offset, obj.radius_m, obj.bumps)[0] > steepest * room_m:
                    continue
            if signed_distance(obj, point)[0] < room_m:
                return i
    return len(rotations)


@kernel
def signed_distance(obj: ObjectNumbers, point_m: Vector) -> tuple[float, Vector]:
    """Distance from the surface, negative inside, and its outward normal at the nearest point."""
    offset = moved(point_m, -1.0, vector(obj.center_m))
    if obj.kind == FREEFORM:
        return _from_freeform(offset, obj.radius_m, obj.bumps)
    axis, wedge = vector(obj.axis), vector(obj.wedge)
    if obj.kind == BOX:
        return _from_box(offset, axis, wedge, obj.radius_m)
    if obj.kind in (CYLINDER, KNIFE):
        offset = moved(offset, -dot(offset, axis), axis)
    if obj.kind == KNIFE:
        offset = moved(offset, -max(dot(offset, wedge), 0.0), wedge)
    return _grown(offset, obj.radius_m)


@kernel
def _grown(offset: Vector, radius_m: float) -> tuple[float, Vector]:
    """Distance and normal by the offset from the nearest point of the core."""
    away = np.sqrt(dot(offset, offset))
    return away - radius_m, scaled(1.0 / away if away > 1e-15 else np.nan, offset)


@kernel
def _from_box(offset: Vector, axis: Vector, wedge: Vector, radius_m: float) -> tuple[float, Vector]:
    side = cross(axis, wedge)
    one, other = unit(moved(wedge, -1.0, side)), unit(moved(wedge, 1.0, side))
    depth, deep = dot(offset, one), dot(offset, other)
    if depth > 0.0 and deep > 0.0:
        # inside the core the nearer face counts
        return -min(depth, deep) - radius_m, scaled(-1.0, one if depth <= deep else other)
    return _grown(moved(scaled(min(depth, 0.0), one), min(deep, 0.0), other), radius_m)


@kernel
def elevations(points_m: np.ndarray, radius_m: float, bumps: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """F (K,) of a free form at points (K, 3) from its centre; its gradients (K, 3) are written."""
    values = np.empty(len(points_m))
    for i, point in enumerate(points_m):
        values[i], slope = elevation(vector(point), radius_m, bumps)
        for j in range(3):
            slopes[i, j] = slope[j]
    return values


@kernel
def surface_radii(directions: np.ndarray, radius_m: float, bumps: np.ndarray) -> np.ndarray:
    """(K,) distance of a free form's surface from its centre along unit vectors (K, 3)."""
    radii = np.empty(len(directions))
    for i, direction in enumerate(directions):
        radii[i] = _surface_radius(vector(direction), radius_m, bumps)
    return radii


@kernel
def elevation(point_m: Vector, radius_m: float, bumps: np.ndarray) -> tuple[float, Vector]:
    """F at a point from the centre, and its gradient."""
    away = np.sqrt(dot(point_m, point_m))
    value, slope = away - radius_m, scaled(1.0 / away, point_m)
    for bump in bumps:
        offset = moved(point_m, -radius_m, vector(bump))
        square = bump[4] ** 2
        lift = bump[3] * np.exp(-0.5 * dot(offset, offset) / square)
        value -= lift
        slope = moved(slope, lift / square, offset)
    return value, slope


@kernel
def _bend(point_m: Vector, radius_m: float, bumps: np.ndarray, bend: np.ndarray) -> None:
    """Write F's second derivatives at a point from the centre in the upper left (3, 3)."""
    away = np.sqrt(dot(point_m, point_m))
    for i in range(3):
        for j in range(3):
            bend[i, j] = -point_m[i] * point_m[j] / away**3
        bend[i, i] += 1.0 / away
    for bump in bumps:
        offset = moved(point_m, -radius_m, vector(bump))
        square = bump[4] ** 2
        rate = bump[3] * np.exp(-0.5 * dot(offset, offset) / square) / square
        for i in range(3):
            for j in range(3):
                bend[i, j] -= rate * offset[i] * offset[j] / square
            bend[i, i] += rate


@kernel
def _surface_radius(direction: Vector, radius_m: float, bumps: np.ndarray) -> float:
    radius = radius_m
    for _ in range(_RADIUS_ITERATIONS):
        value, slope = elevation(scaled(radius, direction), radius_m, bumps)
        radius -= value / dot(slope, direction)
    return radius


@kernel
def _from_freeform(point_m: Vector, radius_m: float, bumps: np.ndarray) -> tuple[float, Vector]:
    """Where no nearest point is found, deep inside: F over its slope, and the slope's direction; NaN in the centre."""
    away = np.sqrt(dot(point_m, point_m))
    outward = scaled(1.0 / away, point_m)
    # the surface along the point's direction from the centre, and the multiplier that belongs to it
    radius = _surface_radius(outward, radius_m, bumps)
    foot, share = scaled(radius, outward), away - radius
    matrix, left = np.empty((4, 4)), np.empty((4, 1))
    for _ in range(_ITERATIONS):
        value, slope = elevation(foot, radius_m, bumps)
        beside = moved(moved(foot, share, slope), -1.0, point_m)
        if max(abs(beside[0]), abs(beside[1]), abs(beside[2]), abs(value)) <= _TOLERANCE:
            steep = np.sqrt(dot(slope, slope))
            return share * steep, scaled(1.0 / steep, slope)
        _bend(foot, radius_m, bumps, matrix)
        for i in range(3):
            for j in range(3):
                matrix[i, j] *= share
            matrix[i, i] += 1.0
            matrix[i, 3] = matrix[3, i] = slope[i]
            left[i, 0] = -beside[i]
        matrix[3, 3], left[3, 0] = 0.0, -value
        if not solve(matrix, left):
            break
        foot, share = moved(foot, 1.0, (left[0, 0], left[1, 0], left[2, 0])), share + left[3, 0]
    value, slope = elevation(point_m, radius_m, bumps)
    steep = np.sqrt(dot(slope, slope))
    return value / steep, scaled(1.0 / steep, slope)
