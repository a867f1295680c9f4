"""Measurements of many frames, padded to one length, in ideal image coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.core.arrays import Rows
from vbaa_calib.native import core

from .rig_arrays import RigArrays


@dataclass(frozen=True, eq=False)
class Frames(Rows):
    """B frames of at most N points, in contiguous float arrays.

    Attributes
    ----------
    points : (B, N, 2) in ideal normalized coordinates (the plane one unit before the camera).
    covariance : (B, N, 3) of each point: xx, xy, yy.
    usable : (B, N) 1 for a point, 0 for padding and missing points, which have finite values.
    reading : (B, K) as `RigArrays.std`, in N·m or N; that of the end is not used.
    tip : (B, 2) the antenna's end, as the points. tip_covariance : (B, 3) likewise.
    available : (B, K) 1 where there is such a reading, and an end, else 0; less where the reading's standard deviation
        exceeds the sensor's noise: the residual is multiplied by it.
    gravity_m_s2 : (B, 3) antenna frame.
    camera : (B, N) index of the rig's camera that sees each point. tip_camera : (B,) of the one that sees the end.
    """

    rig_arrays: RigArrays
    points: np.ndarray
    covariance: np.ndarray
    usable: np.ndarray
    reading: np.ndarray
    tip: np.ndarray
    tip_covariance: np.ndarray
    available: np.ndarray
    gravity_m_s2: np.ndarray
    camera: np.ndarray
    tip_camera: np.ndarray

    def with_available(self, sensors: np.ndarray | float, ends: np.ndarray | float) -> Frames:
        """The frames with other weights of the readings, a number or (B, S) in the order of `RigArrays.sensors`, and of
        the antenna's end, a number or (B,)."""
        available, slots = self.available.copy(), self.rig_arrays.sensors
        available[:, slots] = sensors
        available[:, core.solver.END] = ends
        return replace(self, available=available)

    @property
    def ends(self) -> np.ndarray:
        """(B,) weights `available` of the antenna's end."""
        return self.available[:, core.solver.END]


def frames_from_pixels(
    rig_arrays: RigArrays,
    points_px: np.ndarray,
    sigma_px: np.ndarray,
    readings_Nm: np.ndarray,
    tip_px: np.ndarray,
    gravity_m_s2: np.ndarray,
    *cameras: np.ndarray,
) -> Frames:
    """Frames from pixels (B, N, 2) with standard deviations (B, N) across the antenna; what is not finite counts as
    missing.

    `readings_Nm` (B, 6) as `session.READINGS`: NaN where there is none. `tip_px` (B, 3): the antenna's end and its
    deviation along it. `gravity_m_s2` (B, 3) in the antenna frame. `cameras` : `Frames.camera`, of every frame the same
    and in order, and `Frames.tip_camera`; by default the first.
    """
    count, wide = points_px.shape[:2]
    camera, of_tip = cameras or (np.zeros((count, wide), np.int64), np.zeros(count, np.int64))
    several = 1 + len(rig_arrays.rig.others)
    ends = np.searchsorted(camera[0], np.arange(1, several + 1)) if count else np.zeros(several, int)
    points, covariance, usable = _ideal(rig_arrays, points_px, sigma_px, ends)
    slots, own = rig_arrays.sensors, readings_Nm[:, : len(rig_arrays.sensors)]
    read = np.isfinite(own) & rig_arrays.exists
    reading, available = np.zeros((2, count, len(rig_arrays.std)))
    reading[:, slots], available[:, slots] = np.where(read, own, 0.0), read
    tip, tip_covariance = np.zeros((count, 2)), np.tile([1.0, 0.0, 1.0], (count, 1))
    for index in range(0 if rig_arrays.rig.tip is None or np.isnan(tip_px[:, 2]).all() else several):
        (rows,) = np.nonzero(of_tip == index)
        ends = np.arange(several) >= index
        seen = _ideal(rig_arrays, tip_px[rows, None, :2], tip_px[rows, None, 2], ends)
        tip[rows], tip_covariance[rows], available[rows, core.solver.END] = (each[:, 0] for each in seen)
    gravity = np.ascontiguousarray(gravity_m_s2, float)
    measured = reading, tip, tip_covariance, available, gravity
    return Frames(rig_arrays, points, covariance, usable, *measured, camera, of_tip)


def _ideal(
    rig_arrays: RigArrays, points_px: np.ndarray, sigma_px: np.ndarray, ends: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (B, N, 2) in normalized coordinates, their covariances (B, N, 3), and 1 for usable ones (B, N). `ends` :
    for each camera the column at which its points end."""
    lines = (np.ascontiguousarray(each, float) for each in (points_px, sigma_px))
    points, covariance, usable = core.solver.ideal_points(rig_arrays.core, *lines, ends.astype(np.int64))
    return points, covariance, usable
