"""Raw pixels across a path: one profile for every column (or row) of pixels that the path crosses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.polyline import normals, resample
from vbaa_calib.core.smooth import END_VALUE, running_mean

_SPACING_PX = 0.95
"""Spacing of the path's points: below a pixel, so that no step passes two columns."""
_BOW_RUN = 23
"""So many points of the path tell how it bends."""


class Crossings(NamedTuple):
    """Where a path crosses the middles of columns (or rows), and the raw profiles there.

    Attributes
    ----------
    points : (N, 2) px.
    axis : (N,) index of the coordinate along the profile: 1 (v) where the path runs sideways, 0 (u) where upward.
    along : (N,) distance along the path from its start, px.
    stretch : (N,) length along the profile per length across the path, at most about √2.
    side : (N,) +1 or −1: whether the profile runs along the path's normal or against it.
    bow : (N,) how the distance across grows with the square of the distance along the profile where the path bends.
    across : (N, T) distance along the profile from the path, px.
    profiles : (N, T) grey levels, zero where not inside.
    inside : (N,) whether the whole profile is in the picture.
    """

    points: np.ndarray
    axis: np.ndarray
    along: np.ndarray
    stretch: np.ndarray
    side: np.ndarray
    bow: np.ndarray
    across: np.ndarray
    profiles: np.ndarray
    inside: np.ndarray


def crossings(image: np.ndarray, path_px: np.ndarray, half: int, bright: bool | None) -> Crossings:
    """Profiles of 2·half + 1 pixels of an (H, W) picture across a path (K, 2); negative ones for a dark line."""
    sign = -1.0 if bright is False else 1.0
    return crossed(np.ascontiguousarray(image), np.ascontiguousarray(path_px, np.float64), half, sign)


@kernel
def crossed(image: np.ndarray, path_px: np.ndarray, half: int, sign: float) -> Crossings:
    """The same, times `sign`."""
    found, first = _places(path_px, half)
    _read(image, first, sign, found)
    return found


@kernel
def _places(path_px: np.ndarray, half: int) -> tuple[Crossings, np.ndarray]:
    """The crossings, without their profiles, and every profile's first pixel (N, 2), u and v."""
    path, along = resample(path_px, _SPACING_PX)
    normal = normals(path)
    upward = np.abs(normal[:, 0]) > np.abs(normal[:, 1])
    line = np.empty(len(path) - 1)
    count = 0
    for k in range(len(path) - 1):
        crossed = int(upward[k])
        one, other = path[k, crossed], path[k + 1, crossed]
        line[k] = np.ceil(min(one, other))
        if line[k] < max(one, other):
            count += 1
        else:
            line[k] = np.nan
    bend = running_mean(_turning(normal), _BOW_RUN, END_VALUE)
    length = 2 * half + 1
    found = Crossings(
        np.empty((count, 2)),
        np.empty(count, np.int64),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty((count, length)),
        np.zeros((count, length)),
        np.zeros(count, np.bool_),
    )
    first = np.empty((count, 2), np.int64)
    n = 0
    for k in range(len(path) - 1):
        if np.isnan(line[k]):
            continue
        crossed = int(upward[k])
        axis = 1 - crossed
        part = (line[k] - path[k, crossed]) / (path[k + 1, crossed] - path[k, crossed])
        for i in range(2):
            found.points[n, i] = path[k, i] + part * (path[k + 1, i] - path[k, i])
        found.axis[n], found.along[n] = axis, along[k] + _SPACING_PX * part
        side = -1.0 if normal[k, axis] < 0.0 else 1.0
        leaning = normal[k, 1] if axis == 0 else -normal[k, 0]
        found.stretch[n], found.side[n] = 1.0 / max(abs(normal[k, axis]), 0.5), side
        found.bow[n] = -0.5 * side * bend[k] * leaning**2
        middle = np.rint(found.points[n, axis])
        for t in range(length):
            found.across[n, t] = t - half - (found.points[n, axis] - middle)
        first[n, crossed], first[n, axis] = int(np.rint(line[k])), int(middle) - half
        n += 1
    return found, first


@kernel
def _turning(normal: np.ndarray) -> np.ndarray:
    """(K,) by how much the direction turns per px at each point of a path, towards its normal (K, 2)."""
    last = len(normal) - 1
    turning = np.empty(last + 1)
    for k in range(last + 1):
        before, after = max(k - 1, 0), min(k + 1, last)
        u, v = normal[after, 1] - normal[before, 1], normal[before, 0] - normal[after, 0]
        turning[k] = (u * normal[k, 0] + v * normal[k, 1]) / ((after - before) * _SPACING_PX)
    return turning


@kernel
def _read(image: np.ndarray, first: np.ndarray, sign: float, found: Crossings) -> None:
    """Fill in the profiles, times `sign`, that lie in the picture (H, W)."""
    height, width = image.shape
    length = found.profiles.shape[1]
    for n in range(len(first)):
        u, v, axis = first[n, 0], first[n, 1], found.axis[n]
        last_u, last_v = u + (length - 1) * (1 - axis), v + (length - 1) * axis
        found.inside[n] = u >= 0 and v >= 0 and last_u < width and last_v < height
        if found.inside[n]:
            for t in range(length):
                found.profiles[n, t] = sign * (image[v + t, u] if axis else image[v, u + t])


@kernel
def every(found: Crossings, step: int) -> Crossings:
    """Every so many of the crossings."""
    return Crossings(
        found.points[::step].copy(),
        found.axis[::step].copy(),
        found.along[::step].copy(),
        found.stretch[::step].copy(),
        found.side[::step].copy(),
        found.bow[::step].copy(),
        found.across[::step].copy(),
        found.profiles[::step].copy(),
        found.inside[::step].copy(),
    )


@kernel
def shares(found: Crossings) -> np.ndarray:
    """(N,) how far along the path the crossings lie, as fractions of the last one's distance."""
    return found.along / max(found.along[-1], 1e-6)


@kernel
def distances(found: Crossings, n: int, centre: float, across: np.ndarray) -> None:
    """Distance of profile n's pixels from a line through its `centre`, px, positive along the normal: into (T,)."""
    linear, square = found.side[n] / found.stretch[n], found.side[n] * found.bow[n]
    for t in range(len(across)):
        along = found.across[n, t] - centre
        across[t] = along * (linear + square * along)


@kernel
def tapered(found: Crossings, part: float) -> Crossings:
    """The same with distances in widths of a line that grows broader by this part of its width on its way."""
    width = 1.0 + part * (shares(found) - 0.5)
    return Crossings(
        found.points,
        found.axis,
        found.along,
        found.stretch * width,
        found.side,
        found.bow / width,
        found.across,
        found.profiles,
        found.inside,
    )


@kernel
def moved(found: Crossings, shift: np.ndarray) -> np.ndarray:
    """(N, 2) the points moved along their profiles by (N,)."""
    points = found.points.copy()
    for n in range(len(points)):
        points[n, found.axis[n]] += shift[n]
    return points


@kernel
def remove_background(rows: np.ndarray) -> None:
    """Take level and slope off each of the rows (M, T)."""
    several, length = rows.shape
    middle, per_spread = 0.5 * (length - 1), 12.0 / (length * (length**2 - 1.0))
    for m in range(several):
        level, slope = 0.0, 0.0
        for t in range(length):
            level += rows[m, t]
            slope += (t - middle) * rows[m, t]
        for t in range(length):
            rows[m, t] -= level / length + slope * per_spread * (t - middle)


@kernel
def dot(one: np.ndarray, other: np.ndarray) -> float:
    """Σ of the products of two rows (T,)."""
    total = 0.0
    for t in range(len(one)):
        total += one[t] * other[t]
    return total


@kernel
def pixels_off(distance: float, length: int) -> int:
    """A distance in whole pixels, below twice the length of a profile."""
    return int(min(abs(distance), 2.0 * length - 1.0))


def too_short(path_px: np.ndarray) -> bool:
    """Whether a path (K, 2) is too short for a line to be measured along it."""
    return len(path_px) < 2 or bool(np.hypot(*np.diff(path_px, axis=0).T).sum() < 8.0)
