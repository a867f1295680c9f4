"""Lenses by their textbook formulas, and the rays of a picture: no code of the library's camera or simulator."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import RectBivariateSpline

FAMILIES = ("pinhole", "radial", "brown", "rational", "fisheye")
_CELLS, _NEWTON, _STEP = 96, 60, 1e-6
"""Cells of the grid of rays along a picture's longer side."""


@dataclass(frozen=True, eq=False)
class Optics:
    """A lens: of `FAMILIES`, focal lengths (fx, fy), centre (cx, cy), coefficients in OpenCV's order, all pixels.

    Pixel (0, 0) is the centre of the first pixel.
    """

    family: str
    size: tuple[int, int]
    focal_px: np.ndarray
    centre_px: np.ndarray
    coefficients: np.ndarray

    def pixels(self, points_camera_m: np.ndarray) -> np.ndarray:
        """(..., 2) of points (..., 3) in front of the camera."""
        return self.centre_px + self.focal_px * self._bent(points_camera_m[..., :2] / points_camera_m[..., 2:])

    def _bent(self, flat: np.ndarray) -> np.ndarray:
        x, y = flat[..., 0], flat[..., 1]
        k, square = np.pad(self.coefficients, (0, 8 - len(self.coefficients))), x * x + y * y
        if self.family == "fisheye":
            radius = np.sqrt(square).clip(1e-12)
            angle = np.arctan(radius)
            scale = angle * (1.0 + np.polyval([*k[3::-1], 0.0], angle**2)) / radius
            return np.asarray(flat * scale[..., None])
        scale = (1.0 + square * (k[0] + square * (k[1] + square * k[4]))) / (
            1.0 + square * (k[5] + square * (k[6] + square * k[7]))
        )
        aside = [2 * k[2] * x * y + k[3] * (square + 2 * x * x), k[2] * (square + 2 * y * y) + 2 * k[3] * x * y]
        return np.asarray(flat * scale[..., None] + np.stack(aside, axis=-1))

    @cached_property
    def _solved(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """Rows (R,), columns (C,), x/z and y/z (R, C, 2) there, and whether every pixel has one ray that leads back."""
        step = max(self.size) / _CELLS
        columns, rows = (np.arange(-2.0 * step, side + 2.5 * step, step) for side in self.size)
        wanted = (np.stack(np.meshgrid(columns, rows), axis=-1) - self.centre_px) / self.focal_px
        size = np.linalg.norm(wanted, axis=-1, keepdims=True).clip(1e-12)
        flat = wanted * (np.tan(size.clip(0.0, 1.4)) / size if self.family == "fisheye" else 1.0)
        with np.errstate(all="ignore"):
            for _ in range(_NEWTON):
                off = wanted - self._bent(flat)
                by_x, by_y = ((self._bent(flat + h) - self._bent(flat - h)) / (2 * _STEP) for h in _STEP * np.eye(2))
                area = by_x[..., 0] * by_y[..., 1] - by_x[..., 1] * by_y[..., 0]
                way = [off[..., 0] * by_y[..., 1] - off[..., 1] * by_y[..., 0]]
                way += [by_x[..., 0] * off[..., 1] - by_x[..., 1] * off[..., 0]]
                flat = flat + np.clip(np.stack(way, axis=-1) / area[..., None], -0.3, 0.3)
            sound = np.abs(off).max() < 1e-9 and bool((area > 0.1 * area.max()).all())
        return rows, columns, np.where(np.isfinite(flat), flat, 0.0), sound

    @property
    def grid(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows (R,), columns (C,) of a grid over the picture and a little beyond; x/z and y/z (R, C, 2) there."""
        return self._solved[:3]

    @property
    def sound(self) -> bool:
        """Whether every pixel of the picture has one ray."""
        return self._solved[3]

    def ray(self, pixel: np.ndarray) -> np.ndarray:
        """(2,) x/z and y/z at a pixel (2,) of the picture."""
        rows, columns, rays = self.grid
        return np.array([RectBivariateSpline(rows, columns, rays[..., axis])(*pixel[::-1])[0, 0] for axis in (0, 1)])
