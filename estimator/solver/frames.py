"""Many frames' data, padded to one length, in ideal image coordinates; one frame's, as compiled functions take it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from vbaa_calib.camera.compiled_lens import Lens, normalized_of_pixels
from vbaa_calib.core.arrays import Rows
from vbaa_calib.core.compiled import compiled, kernel, record

from .rig_arrays import RigArrays


@dataclass(frozen=True, eq=False)
class Frames(Rows):
    """B frames of N points at most.

    Attributes
    ----------
    points : (B, N, 2) in ideal normalized coordinates (the plane one unit before the camera).
    covariance : (B, N, 3) of each point: xx, xy, yy.
    usable : (B, N) 1 for a point, 0 for padding and missing points, whose values are finite.
    moment_Nm : (B, 2) read by the sensors about y and z.
    tip : (B, 2) the antenna's end, as the points. tip_covariance : (B, 3) likewise.
    available : (B, 3) 1 where there is a reading about y, about z, and an end, else 0; less where the deviation of the
        reading is more than the noise: its residual is multiplied by it.
    gravity_m_s2 : (B, 3) antenna frame.
    """

    rig_arrays: RigArrays
    points: np.ndarray
    covariance: np.ndarray
    usable: np.ndarray
    moment_Nm: np.ndarray
    tip: np.ndarray
    tip_covariance: np.ndarray
    available: np.ndarray
    gravity_m_s2: np.ndarray

    @property
    def tables(self) -> _FrameTables:
        """For compiled functions."""
        return _FrameTables(*(np.ascontiguousarray(getattr(self, f.name), float) for f in fields(self)[1:]))


class _FrameTables(NamedTuple):
    """The arrays of `Frames`."""

    points: np.ndarray
    covariance: np.ndarray
    usable: np.ndarray
    moment_Nm: np.ndarray
    tip: np.ndarray
    tip_covariance: np.ndarray
    available: np.ndarray
    gravity_m_s2: np.ndarray


@record
class Frame:
    """One frame: u, v, xx, xy, yy (N,) of its usable points alone, and the rest as in `Frames`."""

    u: np.ndarray
    v: np.ndarray
    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray
    moment_Nm: np.ndarray
    tip: np.ndarray
    tip_covariance: np.ndarray
    available: np.ndarray
    gravity_m_s2: np.ndarray


@compiled
def frame_of(tables, index):
    """One of the frames."""
    usable = tables.usable[index]
    count = 0
    for i in range(len(usable)):
        count += usable[i] > 0.0
    u, v, xx, xy, yy = np.empty(count), np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    row = 0
    for i in range(len(usable)):
        if usable[i] > 0.0:
            u[row], v[row] = tables.points[index, i, 0], tables.points[index, i, 1]
            xx[row] = tables.covariance[index, i, 0]
            xy[row] = tables.covariance[index, i, 1]
            yy[row] = tables.covariance[index, i, 2]
            row += 1
    readings = tables.moment_Nm[index], tables.tip[index], tables.tip_covariance[index], tables.available[index]
    return Frame(u, v, xx, xy, yy, readings[0], readings[1], readings[2], readings[3], tables.gravity_m_s2[index])


@compiled
def thinned(frame, most):
    """Every n-th point of a frame, about `most` of them, and n."""
    every = max(len(frame.u) // most, 1)
    parts = frame.u[::every].copy(), frame.v[::every].copy()
    spread = frame.xx[::every].copy(), frame.xy[::every].copy(), frame.yy[::every].copy()
    few = Frame(
        parts[0],
        parts[1],
        spread[0],
        spread[1],
        spread[2],
        frame.moment_Nm,
        frame.tip,
        frame.tip_covariance,
        frame.available,
        frame.gravity_m_s2,
    )
    return few, every


def frames_from_pixels(
    rig_arrays: RigArrays,
    points_px: np.ndarray,
    sigma_px: np.ndarray,
    moment_Nm: np.ndarray,
    tip_px: np.ndarray,
    gravity_m_s2: np.ndarray,
) -> Frames:
    """Frames of pixels (B, N, 2) with deviations (B, N) across the antenna; what is not finite counts as missing.

    `moment_Nm` (B, 2): NaN where there is no reading. `tip_px` (B, 3): the antenna's end and its deviation along it.
    `gravity_m_s2` (B, 3) in the antenna frame.
    """
    if rig_arrays.rig.tip is None:
        tip_px = np.full_like(tip_px, np.nan)
    seen_px = np.concatenate([points_px, tip_px[:, None, :2]], axis=1)
    points, covariance, usable = _ideal(rig_arrays, seen_px, np.concatenate([sigma_px, tip_px[:, 2:]], axis=1))
    read = np.isfinite(moment_Nm) & (rig_arrays.gain != 0.0)
    available = np.empty((len(tip_px), 3))
    available[:, :2], available[:, 2] = read, usable[:, -1]
    return Frames(
        rig_arrays,
        points[:, :-1],
        covariance[:, :-1],
        usable[:, :-1],
        np.where(read, moment_Nm, 0.0),
        points[:, -1],
        covariance[:, -1],
        available,
        np.array(gravity_m_s2, float),
    )


def _ideal(
    rig_arrays: RigArrays, points_px: np.ndarray, sigma_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (..., 2) in normalized coordinates, their covariances (..., 3), and 1 for usable ones (...)."""
    shape = points_px.shape[:-1]
    flat = np.ascontiguousarray(points_px, float).reshape(-1, 2)
    sigma = np.ascontiguousarray(sigma_px, float).reshape(-1)
    points, covariance, usable = np.empty_like(flat), np.empty((len(flat), 3)), np.empty(len(flat))
    _covariances(rig_arrays.lens, flat, sigma, points, covariance, usable)
    hard = np.flatnonzero(usable < 0.0)
    if len(hard):
        values, slopes, valid = rig_arrays.rig.camera.normalized_with_slopes(flat[hard])
        variance = (sigma[hard] ** 2)[:, None]
        spread = np.stack([(slopes[:, a] * slopes[:, b]).sum(-1) for a, b in ((0, 0), (0, 1), (1, 1))], axis=-1)
        points[hard] = np.where(valid[:, None], values, 0.0)
        covariance[hard] = np.where(valid[:, None], variance * spread, [1.0, 0.0, 1.0])
        usable[hard] = valid
    return points.reshape(*shape, 2), covariance.reshape(*shape, 3), usable.reshape(shape)


@kernel
def _covariances(tables, pixels, sigma_px, points, covariance, usable):
    """What `_ideal` gives; −1 for a point that `Camera` must be asked about."""
    lens, count = Lens(*tables), len(pixels)
    slopes, valid = np.empty((count, 4)), np.empty(count, np.bool_)
    normalized_of_pixels(lens, pixels, points, slopes, valid)
    for i in range(count):
        finite = np.isfinite(pixels[i, 0]) and np.isfinite(pixels[i, 1]) and np.isfinite(sigma_px[i])
        if finite and valid[i] and not lens.tilted:
            variance = sigma_px[i] * sigma_px[i]
            ux, uy, vx, vy = slopes[i]
            covariance[i, 0] = variance * (ux * ux + uy * uy)
            covariance[i, 1] = variance * (ux * vx + uy * vy)
            covariance[i, 2] = variance * (vx * vx + vy * vy)
            usable[i] = 1.0
        else:
            points[i, 0], points[i, 1] = 0.0, 0.0
            covariance[i, 0], covariance[i, 1], covariance[i, 2] = 1.0, 0.0, 1.0
            usable[i] = -1.0 if finite else 0.0
