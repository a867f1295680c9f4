"""Where in the picture the antenna can be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.core.polyline import beside, resample

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
        nearest, distance = beside(fine, points_px)
        return along[nearest], distance
