"""Many frames' data, padded to one length, in ideal image coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.core.arrays import Array, arange_like, namespace

from .rig_arrays import RigArrays


@dataclass(frozen=True, eq=False)
class Frames:
    """B frames of N points at most.

    Attributes
    ----------
    points : (B, N, 2) in ideal normalized coordinates (the plane one unit before the camera).
    covariance : three (B, N) of each point: xx, xy, yy.
    usable : (B, N) 1 for a point, 0 for padding and missing points, whose values are finite.
    moment_Nm : (B, 2) read by the sensors about y and z.
    tip : (B, 2) the antenna's end, as the points. tip_covariance : three (B,) likewise.
    available : (B, 3) 1 where there is a reading about y, about z, and an end, else 0.
    gravity_m_s2 : (B, 3) antenna frame.
    """

    rig_arrays: RigArrays
    points: Array
    covariance: tuple[Array, Array, Array]
    usable: Array
    moment_Nm: Array
    tip: Array
    tip_covariance: tuple[Array, Array, Array]
    available: Array
    gravity_m_s2: Array

    def __len__(self) -> int:
        return len(self.points)

    @property
    def sensor_available(self) -> Array:
        """(B, 2) 1 where there is a reading, else 0."""
        return self.available[:, :2]

    def subsample(self, most: int) -> tuple[Frames, Array]:
        """Every n-th usable point of each frame, about `most` of them, and their indices (B, W)."""
        xp = namespace(self.usable)
        rank = xp.cumsum(self.usable, 1) - 1.0
        every = xp.clip(xp.floor(self.usable.sum(1) / most), 1.0, None)[:, None]
        kept = (self.usable > 0.0) & (rank - every * xp.floor(rank / every) < 0.5)
        count = self.usable.shape[1]
        order = xp.where(kept, 0.0 * rank, 0.0 * rank + count) + arange_like(rank, count)
        index = xp.argsort(order, -1)[:, : max(int(kept.sum(1).max()), 1)]
        rows = arange_like(rank, len(rank))[:, None]
        thin = replace(
            self,
            points=self.points[rows, index],
            covariance=tuple(part[rows, index] for part in self.covariance),
            usable=(self.usable * kept)[rows, index],
        )
        return thin, index


def frames_from_pixels(
    rig_arrays: RigArrays, points_px: Array, sigma_px: Array, moment_Nm: Array, tip_px: Array, gravity_m_s2: Array
) -> Frames:
    """Frames of pixels (B, N, 2) with deviations (B, N) across the antenna; what is not finite counts as missing.

    `moment_Nm` (B, 2): NaN where there is no reading. `tip_px` (B, 3): the antenna's end and its deviation along it.
    `gravity_m_s2` (B, 3) in the antenna frame.
    """
    xp = namespace(points_px)
    # the ends last, as one more point
    points, covariance, usable = _seen(
        rig_arrays,
        xp.concat([points_px, tip_px[:, None, :2]], 1),
        xp.concat([sigma_px, tip_px[:, 2:]], 1),
    )
    with_tip = usable[:, -1:] * (0.0 if rig_arrays.rig.tip is None else 1.0)
    read = xp.isfinite(moment_Nm) & (rig_arrays.gain != 0.0)
    return Frames(
        rig_arrays,
        points[:, :-1],
        (covariance[0][:, :-1], covariance[1][:, :-1], covariance[2][:, :-1]),
        usable[:, :-1],
        xp.where(read, moment_Nm, xp.zeros_like(moment_Nm)),
        points[:, -1],
        (covariance[0][:, -1], covariance[1][:, -1], covariance[2][:, -1]),
        xp.concat([xp.where(read, xp.ones_like(moment_Nm), xp.zeros_like(moment_Nm)), with_tip], 1),
        gravity_m_s2,
    )


def _seen(rig_arrays: RigArrays, points_px: Array, sigma_px: Array) -> tuple[Array, tuple[Array, Array, Array], Array]:
    """Pixels (B, N, 2) in normalized coordinates, their covariances xx, xy, yy (B, N), and 1 for usable ones (B, N)."""
    xp = namespace(points_px)
    present = xp.isfinite(points_px).all(-1) & xp.isfinite(sigma_px)
    pixels = xp.where(present[..., None], points_px, xp.zeros_like(points_px))
    points, slopes, valid = rig_arrays.rig.camera.normalized_with_slopes(pixels)
    usable = present & valid
    variance = xp.where(usable, sigma_px, xp.ones_like(sigma_px)) ** 2
    ux, uy, vx, vy = (slopes[..., row, column] for row in (0, 1) for column in (0, 1))
    ones, zeros = xp.ones_like(variance), xp.zeros_like(variance)
    xx, yy = (xp.where(usable, variance * part, ones) for part in (ux * ux + uy * uy, vx * vx + vy * vy))
    xy = xp.where(usable, variance * (ux * vx + uy * vy), zeros)
    return xp.where(usable[..., None], points, xp.zeros_like(points)), (xx, xy, yy), xp.where(usable, ones, zeros)
