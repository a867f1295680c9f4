"""Many frames' data, padded to one length, in ideal image coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.core.arrays import Array, counted, namespace

from .rig_arrays import Known


@dataclass(frozen=True, eq=False)
class Frames:
    """B frames of N points at most.

    Attributes
    ----------
    points : (B, N, 2) in ideal normalized coordinates (the plane one unit before the camera).
    covariance : three (B, N) of each point: xx, xy, yy.
    usable : (B, N) 1 for a point, 0 for what is finite but means nothing.
    reading_Nm : (B, 2) of the moment sensors about y and z.
    felt : (B, 2) 1 where there is a reading, else 0.
    gravity_m_s2 : (B, 3) antenna frame.
    """

    known: Known
    points: Array
    covariance: tuple[Array, Array, Array]
    usable: Array
    reading_Nm: Array
    felt: Array
    gravity_m_s2: Array

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, most: int) -> tuple[Frames, Array]:
        """Every so manieth usable point of each frame, about `most` of them, and their places (B, W)."""
        xp = namespace(self.usable)
        rank = xp.cumsum(self.usable, 1) - 1.0
        every = xp.clip(xp.floor(self.usable.sum(1) / most), 1.0, None)[:, None]
        kept = (self.usable > 0.0) & (rank - every * xp.floor(rank / every) < 0.5)
        count = self.usable.shape[1]
        order = xp.where(kept, 0.0 * rank, 0.0 * rank + count) + counted(rank, count)
        places = xp.argsort(order, -1)[:, : max(int(kept.sum(1).max()), 1)]
        rows = counted(rank, len(rank))[:, None]
        thin = replace(
            self,
            points=self.points[rows, places],
            covariance=tuple(part[rows, places] for part in self.covariance),
            usable=(self.usable * kept)[rows, places],
        )
        return thin, places

    def picked(self, which: Array) -> Frames:
        """Some of the frames, by index; they may repeat."""
        return replace(
            self,
            points=self.points[which],
            covariance=tuple(part[which] for part in self.covariance),
            usable=self.usable[which],
            reading_Nm=self.reading_Nm[which],
            felt=self.felt[which],
            gravity_m_s2=self.gravity_m_s2[which],
        )


def frames_from_pixels(
    known: Known, points_px: Array, sigma_px: Array, reading_Nm: Array, gravity_m_s2: Array
) -> Frames:
    """Frames of pixels (B, N, 2) with deviations (B, N) across the antenna; what is not finite counts as missing.

    `reading_Nm` (B, 2): NaN where there is none. `gravity_m_s2` (B, 3) in the antenna frame.
    """
    xp = namespace(points_px)
    present = xp.isfinite(points_px).all(-1) & xp.isfinite(sigma_px)
    pixels = xp.where(present[..., None], points_px, xp.zeros_like(points_px))
    points, slopes, valid = known.rig.camera.normalized_with_slopes(pixels)
    usable = present & valid
    variance = xp.where(usable, sigma_px, xp.ones_like(sigma_px)) ** 2
    ux, uy, vx, vy = (slopes[..., row, column] for row in (0, 1) for column in (0, 1))
    ones, zeros = xp.ones_like(variance), xp.zeros_like(variance)
    xx, yy = (xp.where(usable, variance * part, ones) for part in (ux * ux + uy * uy, vx * vx + vy * vy))
    xy = xp.where(usable, variance * (ux * vx + uy * vy), zeros)
    felt = xp.isfinite(reading_Nm) & (known.gain != 0.0)
    return Frames(
        known,
        xp.where(usable[..., None], points, xp.zeros_like(points)),
        (xx, xy, yy),
        xp.where(usable, ones, zeros),
        xp.where(felt, reading_Nm, xp.zeros_like(reading_Nm)),
        xp.where(felt, xp.ones_like(reading_Nm), xp.zeros_like(reading_Nm)),
        gravity_m_s2,
    )
