"""Many frames' data, padded to one length, in ideal image coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.camera.lens import lens_of
from vbaa_calib.core.arrays import Rows
from vbaa_calib.native import core
from vbaa_calib.rig import Rig

from .rig_arrays import RigArrays


@dataclass(frozen=True, eq=False)
class Frames(Rows):
    """B frames of N points at most, in contiguous arrays of floats.

    Attributes
    ----------
    points : (B, N, 2) in ideal normalized coordinates (the plane one unit before the camera).
    covariance : (B, N, 3) of each point: xx, xy, yy.
    usable : (B, N) 1 for a point, 0 for padding and missing points, whose values are finite.
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
        """The readings weighted by numbers, or (B, S), as `RigArrays.sensors`, the antenna's end by one, or (B,)."""
        available, slots = self.available.copy(), self.rig_arrays.sensors
        available[:, slots] = sensors
        available[:, core.solver.END] = ends
        return replace(self, available=available)

    @property
    def ends(self) -> np.ndarray:
        """(B,) `available` of the antenna's end."""
        return self.available[:, core.solver.END]


def frames_from_pixels(
    rig_arrays: RigArrays,
    points_px: np.ndarray,
    sigma_px: np.ndarray,
    readings_Nm: np.ndarray,
    tip_px: np.ndarray,
    gravity_m_s2: np.ndarray,
    camera: np.ndarray | None = None,
    tip_camera: np.ndarray | None = None,
) -> Frames:
    """Frames of pixels (B, N, 2) with deviations (B, N) across the antenna; what is not finite counts as missing.

    `readings_Nm` (B, 6) as `session.READINGS`: NaN where there is none. `tip_px` (B, 3): the antenna's end and its
    deviation along it. `gravity_m_s2` (B, 3) in the antenna frame. `camera` (B, N), `tip_camera` (B,) see `Frames`, by
    default the first.
    """
    if rig_arrays.rig.tip is None:
        tip_px = np.full_like(tip_px, np.nan)
    camera = np.zeros(points_px.shape[:2], np.int64) if camera is None else camera
    tip_camera = np.zeros(len(points_px), np.int64) if tip_camera is None else tip_camera
    points, covariance, usable = _ideal(rig_arrays.rig, points_px, sigma_px, camera)
    tip, tip_covariance, with_tip = (
        each[:, 0] for each in _ideal(rig_arrays.rig, tip_px[:, None, :2], tip_px[:, None, 2], tip_camera[:, None])
    )
    slots, own = rig_arrays.sensors, readings_Nm[:, : len(rig_arrays.sensors)]
    read = np.isfinite(own) & rig_arrays.exists
    reading, available = np.zeros((2, len(points), len(rig_arrays.std)))
    reading[:, slots], available[:, slots], available[:, core.solver.END] = np.where(read, own, 0.0), read, with_tip
    gravity = np.ascontiguousarray(gravity_m_s2, float)
    return Frames(
        rig_arrays, points, covariance, usable, reading, tip, tip_covariance, available, gravity, camera, tip_camera
    )


def _ideal(
    rig: Rig, points_px: np.ndarray, sigma_px: np.ndarray, camera: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (B, N, 2) of cameras (B, N) in normalized coordinates, covariances (B, N, 3), and 1 for usable ones."""
    if rig.others and len(camera):
        parts = []
        for index, one in enumerate(rig.cameras.values()):
            own = camera == index
            if (own == own[0]).all():  # the same columns of every frame
                own = np.s_[:, slice(*np.searchsorted(camera[0], [index, index + 1]))]
            parts.append((own, _ideal(one, points_px[own], sigma_px[own], camera[own])))
        points, covariance, usable = (np.empty((*camera.shape, *size)) for size in ((2,), (3,), ()))
        for own, each in parts:
            points[own], covariance[own], usable[own] = each
        return points, covariance, usable
    shape, lens = points_px.shape[:-1], lens_of(rig.camera.intrinsics)
    flat = np.ascontiguousarray(points_px, float).reshape(-1, 2)
    sigma = np.ascontiguousarray(sigma_px, float).reshape(-1)
    points, covariance, usable = core.solver.ideal_points(lens, flat, sigma)
    return points.reshape(*shape, 2), covariance.reshape(*shape, 3), usable.reshape(shape)
