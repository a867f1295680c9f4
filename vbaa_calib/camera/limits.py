"""How far from the axis a lens with decentring or prism terms can be trusted, direction by direction.

Along each direction the symmetric part of the Jacobian is positive definite from the axis to the rim. Without prism
terms the Jacobian is symmetric, so the rim is where its determinant first reaches zero, the fold. The region is convex
(where the folds leave it notched, the largest disc inside is taken), and on a convex region the map is then one to one:
(F(a) − F(b))·(a − b) > 0 for any two of its points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from vbaa_calib.core.arrays import Array, as_index

from .models import LensModel

_DIRECTIONS = 90
_RADII = 160
_HALVINGS = 30


@dataclass(frozen=True, eq=False)
class _Rim:
    """A closed curve around the axis, as a radius in each of evenly spaced directions from −π on.

    radii, steps : radius in each direction, and from it to the next.
    inner : the smallest of them.
    """

    radii: np.ndarray
    steps: np.ndarray
    inner: float

    @staticmethod
    def of(radii: np.ndarray) -> _Rim:
        """From one radius for each direction."""
        closed = np.append(radii, radii[0])
        return _Rim(closed, np.append(np.diff(closed), 0.0), float(radii.min()))

    def encloses(self, xp: ModuleType, x: Array, y: Array) -> Array:
        """Whether points (...) lie inside."""
        radius2 = x * x + y * y
        inside = radius2 < self.inner * self.inner
        if bool(inside.all()):
            return inside
        radii, steps = self.radii, self.steps
        if xp is not np:
            radii, steps = (xp.as_tensor(a, dtype=x.dtype, device=x.device) for a in (radii, steps))
        place = (xp.arctan2(y, x) + math.pi) * (_DIRECTIONS / (2.0 * math.pi))
        index = as_index(xp.where(xp.isfinite(place), place, 0.0))
        return xp.sqrt(radius2) < radii[index] + (place - index) * steps[index]


@dataclass(frozen=True, eq=False)
class Sectors:
    """The trusted region of a lens.

    ideal : its rim.
    reach : nothing inside is distorted to a point outside this rim.
    distorted_radius : smallest distorted radius on the region's rim.
    """

    ideal: _Rim
    reach: _Rim
    distorted_radius: float


def definite(xx: Array, xy: Array, yx: Array, yy: Array) -> Array:
    """Whether the symmetric part of [[xx, xy], [yx, yy]] is positive definite (the determinant is then positive)."""
    shear = 0.5 * (xy + yx)
    return (xx + yy > 0) & (xx * yy - shear * shear > 0)


def sectors(model: LensModel, c: Sequence[float], farthest: float) -> Sectors:
    """Follow each direction from the axis until the Jacobian is no longer definite, or `farthest`."""
    angle = np.linspace(-math.pi, math.pi, _DIRECTIONS, endpoint=False)[:, None]
    cosine, sine = np.cos(angle), np.sin(angle)
    radius = np.tan(np.linspace(0.0, math.atan(farthest) * (1.0 - 1e-12), _RADII))
    xd, yd, *jacobian = model.linearize(radius * cosine, radius * sine, c)
    good = definite(*jacobian) & np.isfinite(xd) & np.isfinite(yd)
    good[:, 0] = True
    end = np.where(good.all(axis=1), _RADII, np.argmin(good, axis=1))
    low, high = radius[end - 1], radius[np.minimum(end, _RADII - 1)]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        _, _, *jacobian = model.linearize(middle * cosine[:, 0], middle * sine[:, 0], c)
        good_there = definite(*jacobian)
        low, high = np.where(good_there, middle, low), np.where(good_there, high, middle)
    if not _is_convex(low * cosine[:, 0], low * sine[:, 0]):
        # a rim with a notch can enclose two points with one image: fall back to the disc
        low = np.full_like(low, low.min())
        end = np.searchsorted(radius, low, side="right")
    edge_x, edge_y = model.distort(low * cosine[:, 0], low * sine[:, 0], c)
    inside = np.arange(_RADII) < end[:, None]
    every_x, every_y = np.append(xd[inside], edge_x), np.append(yd[inside], edge_y)
    return Sectors(_Rim.of(low), _reach(every_x, every_y), float(np.hypot(edge_x, edge_y).min()))


def _is_convex(x: np.ndarray, y: np.ndarray) -> bool:
    """Whether a polygon around the axis, given anticlockwise, turns left at every corner."""
    edge_x, edge_y = np.roll(x, -1) - x, np.roll(y, -1) - y
    return bool((edge_x * np.roll(edge_y, -1) - edge_y * np.roll(edge_x, -1) > 0.0).all())


def _reach(x: np.ndarray, y: np.ndarray) -> _Rim:
    """A rim around points: their greatest radius in each direction's neighbourhood, and a little more."""
    place = np.rint((np.arctan2(y, x) + math.pi) * (_DIRECTIONS / (2.0 * math.pi))).astype(int) % _DIRECTIONS
    farthest = np.zeros(_DIRECTIONS)
    np.maximum.at(farthest, place, np.hypot(x, y))
    around = np.max([np.roll(farthest, shift) for shift in (-1, 0, 1)], axis=0)
    return _Rim.of(1.003 * around)
