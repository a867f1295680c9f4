"""Polylines in a plane: arc lengths, even spacing, normals, and how points lie beside them; in any unit."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

WHOLE = 1e-6
"""A number of spacings this near to a whole one is that one."""


def resample(polyline: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (K, 2) at equal spacing along a polyline, short of its end, and the arc length (K,) of each."""
    along = arc_lengths(polyline)
    # a spacing that divides the length: rounding must not decide whether the end is one of the points
    at = spacing * np.arange(np.ceil(along[-1] / spacing - WHOLE))
    return np.stack([np.interp(at, along, polyline[:, i]) for i in range(2)], axis=1), at


def arc_lengths(polyline: np.ndarray) -> np.ndarray:
    """(K,) distance of the points of a polyline (K, 2) along it, from its start."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(polyline, axis=0).T))])


def normals(polyline: np.ndarray) -> np.ndarray:
    """(K, 2) unit normals of a polyline with smooth directions."""
    tangent = np.gradient(polyline, axis=0)
    tangent /= np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)


def beside(polyline: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index (N,) of the nearest point of a finely spaced polyline (K, 2), and the distance from it along the normal.

    points : (N, 2).
    """
    nearest = cKDTree(polyline).query(points)[1]
    return nearest, np.einsum("ni,ni->n", points - polyline[nearest], normals(polyline)[nearest])
