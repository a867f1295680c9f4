"""Whether touches were made side by side across the antenna, so that the shape can tell the normal's turn about it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from .directions import Axes

NEAR = 0.3
"""Touches within so much of the patch's extent of each are looked at: where it stuck there may be many in one place."""
SHARE = 0.2
"""They must spread across the antenna by so much of what they spread along it: a shape that was only felt along the
antenna has no slope across it, and small errors of the points along it pass for one."""
NOISE = 4.0
"""And by so many of the deviations that they usually have."""


def side_by_side(point_m: np.ndarray, own_m2: np.ndarray, axes: Axes, patch: np.ndarray) -> np.ndarray:
    """(P,) bool, of points (P, 3) with own covariances (P, 3, 3) on patches (P,); False where these are not known."""
    same = patch[:, None] == patch
    apart = np.where(same, cdist(point_m, point_m), 0.0)
    extent = np.array([apart[patch == label].max() for label in patch])
    near = same & (apart <= NEAR * extent[:, None])
    offset = point_m - point_m[:, None]
    across, along = (_spread(np.einsum("pni,pi->pn", offset, axis), near) for axis in (axes.lateral, axes.along))
    noise = np.sqrt(np.maximum(np.einsum("pi,pij,pj->p", axes.lateral, own_m2, axes.lateral), 0.0))
    usual = np.array([np.median(noise[each]) for each in near])
    return (across > SHARE * along) & (across > NOISE * usual)


def _spread(values: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """(P,) standard deviations of the counted ones of (P, N)."""
    number = counted.sum(axis=1)
    mean = np.where(counted, values, 0.0).sum(axis=1) / number
    return np.sqrt(np.where(counted, (values - mean[:, None]) ** 2, 0.0).sum(axis=1) / number)
