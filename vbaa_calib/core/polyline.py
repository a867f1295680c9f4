"""Polylines in a plane: arc lengths, even spacing, normals, and how points lie beside them; in any unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .compiled import kernel

_WHOLE = 1e-6
"""A number of spacings this near to a whole one is that one."""


@kernel
def arc_lengths(polyline: np.ndarray) -> np.ndarray:
    """(K,) distance of the points of a polyline (K, 2) along it, from its start."""
    along = np.zeros(len(polyline))
    for k in range(1, len(polyline)):
        u, v = polyline[k, 0] - polyline[k - 1, 0], polyline[k, 1] - polyline[k - 1, 1]
        along[k] = along[k - 1] + np.sqrt(u * u + v * v)
    return along


def followed(path_px: np.ndarray, image_size: Sequence[int]) -> np.ndarray:
    """The part (M, 2) of a path (K, 2) that an antenna can take in or near a picture (width, height).

    Whatever proposes a path — a fit, a contact, a rig — may be wrong, and arrays are as long as the path: it begins
    where it is first no farther from the picture than width and height together, and ends where it is again, where it
    is not finite, and where it has become longer than once around all that, for no antenna winds up.
    """
    half = 0.5 * np.asarray(image_size, float)
    room = 2.0 * half.sum()
    near = (np.abs(path_px - half) <= half + room).all(axis=1)
    if not near.all():
        path_px, near = path_px[int(near.argmax()) :], near[int(near.argmax()) :]
        path_px = path_px if near.all() else path_px[: int(near.argmin())]
    if len(path_px) < 2:
        return path_px
    short = np.hypot(*np.diff(path_px, axis=0).T).cumsum() <= 10.0 * room
    return path_px if short[-1] else path_px[: 1 + int(short.argmin())]


@kernel
def resample(polyline: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (K, 2) at equal spacing along a polyline, short of its end, and the arc length (K,) of each."""
    along = arc_lengths(polyline)
    # a spacing that divides the length: rounding must not decide whether the end is one of the points
    spacings = np.ceil(along[-1] / spacing - _WHOLE)
    if not np.isfinite(spacings):
        raise ValueError("a polyline's points must be numbers")
    at = spacing * np.arange(max(int(spacings), 0))
    points = np.empty((len(at), 2))
    k = 0
    for n in range(len(at)):
        while k < len(along) - 2 and along[k + 1] <= at[n]:
            k += 1
        part = (at[n] - along[k]) / (along[k + 1] - along[k])
        for axis in range(2):
            points[n, axis] = polyline[k, axis] + part * (polyline[k + 1, axis] - polyline[k, axis])
    return points, at


@kernel
def normals(polyline: np.ndarray) -> np.ndarray:
    """(K, 2) unit normals of a polyline, K ≥ 2, with smooth directions."""
    last = len(polyline) - 1
    if last < 1:
        raise ValueError("a polyline has two points at least")
    normal = np.empty((last + 1, 2))
    for k in range(last + 1):
        before, after = max(k - 1, 0), min(k + 1, last)
        u, v = polyline[after, 0] - polyline[before, 0], polyline[after, 1] - polyline[before, 1]
        length = np.sqrt(u * u + v * v)
        normal[k, 0], normal[k, 1] = -v / length, u / length
    return normal


@kernel
def beside(polyline: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index (N,) of the nearest point of a finely spaced polyline (K, 2), and the distance from it along the normal.

    points : (N, 2).
    """
    normal, along = normals(polyline), arc_lengths(polyline)
    step = 0.0
    for k in range(1, len(along)):
        step = max(step, along[k] - along[k - 1])
    nearest, distance = np.zeros(len(points), np.int64), np.empty(len(points))
    last = 0
    for n in range(len(points)):
        best = last  # the nearest of the point before begins well
        least = _distance(polyline[best], points[n])
        k = 0
        while k < len(polyline):
            here = _distance(polyline[k], points[n])
            if here < least:
                best, least = k, here
            # so many points on, none can be nearer
            k += max(1, int((here - least) / max(step, 1e-12)))
        nearest[n], last = best, best
        distance[n] = 0.0
        for axis in range(2):
            distance[n] += (points[n, axis] - polyline[best, axis]) * normal[best, axis]
    return nearest, distance


@kernel
def _distance(one: np.ndarray, other: np.ndarray) -> float:
    u, v = one[0] - other[0], one[1] - other[1]
    return float(np.sqrt(u * u + v * v))
