"""Raw pixels across a path: one profile for every column (or row) of pixels that the path crosses."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from vbaa_calib.core.polyline import normals, resample

SPACING_PX = 0.95
"""Spacing of the path's points: below a pixel, so that no step passes two columns."""


@dataclass(frozen=True, eq=False)
class Crossings:
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

    def every(self, step: int) -> Crossings:
        """Every so many of them."""
        return Crossings(*(getattr(self, part.name)[::step] for part in fields(self)))

    def distances(self, centre: np.ndarray) -> np.ndarray:
        """(N, T) distance of every pixel from a line through centres (N,), px; positive along the normal."""
        along = self.across - centre[:, None]
        return along * ((self.side / self.stretch)[:, None] + (self.side * self.bow)[:, None] * along)

    def tapered(self, part: float) -> Crossings:
        """The same with distances in widths of a line that grows broader by this part of its width on its way."""
        width = 1.0 + part * (self.along / max(float(self.along[-1]), 1e-6) - 0.5)
        return replace(self, stretch=self.stretch * width, bow=self.bow / width)

    def moved(self, shift: np.ndarray) -> np.ndarray:
        """(N, 2) the points moved along their profiles by (N,)."""
        points = self.points.copy()
        points[np.arange(len(points)), self.axis] += shift
        return points


def crossings(image: np.ndarray, path_px: np.ndarray, half: int, bright: bool | None) -> Crossings:
    """Profiles of 2·half + 1 pixels of an (H, W) picture across a path (K, 2); negative ones for a dark line."""
    path, along = resample(path_px, SPACING_PX)
    normal = normals(path)
    upward = np.abs(normal[:, 0]) > np.abs(normal[:, 1])
    start, end = path[:-1], path[1:]
    first = np.ceil(np.minimum(start, end))
    hit = (first < np.maximum(start, end)) & np.stack([~upward[:-1], upward[:-1]], axis=1)
    at = np.argwhere(hit)
    index, crossed = at[:, 0], at[:, 1]
    axis = 1 - crossed
    part = (first[index, crossed] - start[index, crossed]) / (end - start)[index, crossed]
    points = start[index] + part[:, None] * (end - start)[index]
    middle = np.rint(points[np.arange(len(index)), axis]).astype(np.intp)
    line = np.rint(first[index, crossed]).astype(np.intp)
    profiles, inside = _raw(image, line, middle, axis, half)
    tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    turning = (np.gradient(tangent, axis=0) * normal).sum(axis=1) / SPACING_PX
    leaning = tangent[index, axis]
    side = np.where(normal[index, axis] < 0, -1.0, 1.0)
    offsets = np.arange(-half, half + 1.0)
    across = offsets - (points[np.arange(len(index)), axis] - middle)[:, None]
    return Crossings(
        points=points,
        axis=axis,
        along=along[index] + SPACING_PX * part,
        stretch=1.0 / np.maximum(np.abs(normal[index, axis]), 0.5),
        side=side,
        bow=-0.5 * side * uniform_filter1d(turning, 23, mode="nearest")[index] * leaning**2,
        across=across,
        profiles=-profiles if bright is False else profiles,
        inside=inside,
    )


def _raw(
    image: np.ndarray, line: np.ndarray, middle: np.ndarray, axis: np.ndarray, half: int
) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2·half + 1) pixels about `middle` in the column or row `line`, and whether all are in the picture."""
    height, width = image.shape
    sideways = axis == 1
    # of the column or row, and how many of them there are
    length, count = width + (height - width) * axis, height + (width - height) * axis
    inside = (line >= 0) & (line < count) & (middle >= half) & (middle < length - half)
    step = np.where(sideways, width, 1)
    first = np.where(sideways, line, line * width) + (middle - half) * step
    at = np.where(inside, first, 0)[:, None] + step[:, None] * np.arange(2 * half + 1)
    # an index outside the picture belongs to a profile that is not inside
    profiles = np.ascontiguousarray(image).ravel().take(at, mode="clip").astype(float)
    profiles[~inside] = 0.0
    return profiles, inside
