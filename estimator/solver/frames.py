"""Measurements of many frames, padded to one length, in ideal image coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.camera.lens import lens_of
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
    available : (B, K) 1 where there is such a reading, and an end, else 0; less where the deviation of the reading is
        more than the noise: its residual is multiplied by it.
    gravity_m_s2 : (B, 3) antenna frame.
    camera : (B, N) that sees each point, of the rig's in their order. tip_camera : (B,) likewise.
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
        """The frames with the readings weighted by a number, or (B, S) as `RigArrays.sensors`, and the antenna's end
        by one, or (B,)."""
        available, slots = self.available.copy(), self.rig_arrays.sensors
        available[:, slots] = sensors
        available[:, core.solver.END] = ends
        return replace(self, available=available)

    @staticmethod
    def together(rig_arrays: RigArrays, parts: Sequence[Frames], camera: np.ndarray, tip_camera: np.ndarray) -> Frames:
        """Frames of several cameras from one part for each, with the end by camera tip_camera (B,)."""
        rows = np.arange(len(tip_camera))
        points, covariance, usable = (
            np.concatenate([getattr(part, name) for part in parts], axis=1)
            for name in ("points", "covariance", "usable")
        )
        tip, tip_covariance, ends = (
            np.stack([getattr(part, name) for part in parts])[tip_camera, rows]
            for name in ("tip", "tip_covariance", "ends")
        )
        frames = replace(parts[0], rig_arrays=rig_arrays, points=points, covariance=covariance, usable=usable)
        frames = replace(frames, tip=tip, tip_covariance=tip_covariance, camera=camera, tip_camera=tip_camera)
        frames.available[:, core.solver.END] = ends
        return frames

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
) -> Frames:
    """Frames from pixels (B, N, 2) with standard deviations (B, N) across the antenna; what is not finite counts as
    missing.

    `readings_Nm` (B, 6) as `session.READINGS`: NaN where there is none. `tip_px` (B, 3): the antenna's end and its
    deviation along it. `gravity_m_s2` (B, 3) in the antenna frame, of a rig with one camera.
    """
    points, covariance, usable = _ideal(rig_arrays, points_px, sigma_px)
    slots, own = rig_arrays.sensors, readings_Nm[:, : len(rig_arrays.sensors)]
    read = np.isfinite(own) & rig_arrays.exists
    reading, available = np.zeros((2, len(points), len(rig_arrays.std)))
    reading[:, slots], available[:, slots] = np.where(read, own, 0.0), read
    if rig_arrays.rig.tip is None:
        tip, tip_covariance = np.zeros((len(points), 2)), np.tile([1.0, 0.0, 1.0], (len(points), 1))
    else:
        tip, tip_covariance, available[:, core.solver.END] = _ideal(rig_arrays, tip_px[:, :2], tip_px[:, 2])
    gravity = np.ascontiguousarray(gravity_m_s2, float)
    cameras = np.zeros(usable.shape, np.int64), np.zeros(len(usable), np.int64)
    measured = reading, tip, tip_covariance, available, gravity
    return Frames(rig_arrays, points, covariance, usable, *measured, *cameras)


def _ideal(
    rig_arrays: RigArrays, points_px: np.ndarray, sigma_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normalized coordinates of pixels (..., 2), their covariances (..., 3), and 1 for usable ones (...)."""
    shape, lens = points_px.shape[:-1], lens_of(rig_arrays.rig.camera.intrinsics)
    flat = np.ascontiguousarray(points_px, float).reshape(-1, 2)
    sigma = np.ascontiguousarray(sigma_px, float).reshape(-1)
    points, covariance, usable = core.solver.ideal_points(lens, flat, sigma)
    return points.reshape(*shape, 2), covariance.reshape(*shape, 3), usable.reshape(shape)
