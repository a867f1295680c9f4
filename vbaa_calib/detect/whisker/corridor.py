"""Where in the picture the antenna can be, and paths through it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

WHOLE = 1e-6
"""A number of spacings this near to a whole one is that one."""
CLAMP_REACH_PX, CLAMP_TURN_RAD = 8.0, 0.12
"""How far off the clamp itself may be, and three deviations of its direction on a rig that is not calibrated."""


@dataclass(frozen=True, eq=False)
class Corridor:
    """Where the antenna can be in the picture.

    Attributes
    ----------
    axis_px : (M, 2) the free antenna from clamp to tip, pixels.
    reach_px : (M,) how far to either side it can be at each of these points.
    width_px : the antenna's width.
    clamp_px, clamp_rad : how far beside the axis, and how much turned from it, the antenna may leave its clamp.
    """

    axis_px: np.ndarray
    reach_px: np.ndarray
    width_px: float
    clamp_px: float = CLAMP_REACH_PX
    clamp_rad: float = CLAMP_TURN_RAD

    def aside(self, points_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where points (N, 2) lie: along the axis and aside of it, along its normals, (N,) px."""
        fine, along = resample(self.axis_px, 1.0)
        nearest = cKDTree(fine).query(points_px)[1]
        return along[nearest], np.einsum("ni,ni->n", points_px - fine[nearest], normals(fine)[nearest])


def resample(polyline: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (K, 2) at equal spacing along a polyline, short of its end, and the arc length (K,) of each."""
    along = arc_lengths_px(polyline)
    # a spacing that divides the length: rounding must not decide whether the end is one of the points
    at = spacing * np.arange(np.ceil(along[-1] / spacing - WHOLE))
    return np.stack([np.interp(at, along, polyline[:, i]) for i in range(2)], axis=1), at


def arc_lengths_px(polyline: np.ndarray) -> np.ndarray:
    """(K,) distance of the points of a polyline (K, 2) along it, from its start."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(polyline, axis=0).T))])


def normals(polyline: np.ndarray) -> np.ndarray:
    """(K, 2) unit normals of a polyline with smooth directions."""
    tangent = np.gradient(polyline, axis=0)
    tangent /= np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
