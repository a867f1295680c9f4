"""What the covariance of a lens means in the picture: how far each pixel's ray may be off.

A lens that is a little wrong and a camera that is a little turned look much the same. Who solves for the camera's pose
with this lens, as every rig does, has that part taken up by the pose. `compensated` leaves out of the uncertainty what
a turn of the camera explains.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.camera.projection import ray_derivatives
from vbaa_calib.core.errors import InputError

_GRID = (17, 13)


class _ProjectionUncertainty(NamedTuple):
    """Over a grid of pixels (R, C, 2), covariance (R, C, 2, 2) of the projection of each one's fixed ray; or NaN."""

    pixels: np.ndarray
    covariance_px2: np.ndarray

    @property
    def std_px(self) -> np.ndarray:
        """(R, C) in the worst direction."""
        values = np.full(self.pixels.shape[:-1], np.nan)
        known = np.isfinite(self.covariance_px2).all(axis=(-1, -2))
        values[known] = np.sqrt(np.linalg.eigvalsh(self.covariance_px2[known])[:, -1].clip(0.0))
        return values


def projection_uncertainty(
    camera: Camera, compensated: bool = True, grid: tuple[int, int] = _GRID
) -> _ProjectionUncertainty:
    """Covariance of the projection over the whole picture, on `grid` = (columns, rows).

    compensated : without what a turn of the camera explains. Raises InputError when the camera has no covariance.
    """
    if camera.covariance is None:
        raise InputError("the camera has no covariance", remedy="calibrate it with vbaa intrinsics")
    pixels = pixel_grid(camera.image_size, grid)
    jacobian = projection_jacobian(camera, pixels)
    if compensated:
        jacobian = compensate(camera, pixels, jacobian)
    return _ProjectionUncertainty(pixels, jacobian @ camera.covariance @ np.swapaxes(jacobian, -1, -2))


def pixel_grid(image_size: tuple[int, int], grid: tuple[int, int] = _GRID) -> np.ndarray:
    """(rows, columns, 2) pixels from border to border of a (width, height) picture, for `grid` = (columns, rows)."""
    columns, rows = (np.linspace(-0.5, size - 0.5, count) for size, count in zip(image_size, grid, strict=True))
    return np.stack(np.meshgrid(columns, rows), axis=-1)


def projection_jacobian(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """(..., 2, 4 + k) how the projection of each pixel's fixed ray moves with the lens; NaN without a ray."""
    moved = ray_derivatives(camera.intrinsics, np.asarray(pixels, float))
    return _by_ray(moved.by_pixel, moved.valid) @ -moved.by_parameter


def turn_jacobian(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """(..., 2, 3) how the projection of each pixel's ray moves when the ray is turned by a rotation vector, per rad."""
    moved = ray_derivatives(camera.intrinsics, np.asarray(pixels, float))
    turned = np.cross(np.eye(3), moved.rays[..., None, :])
    return _by_ray(moved.by_pixel, moved.valid) @ np.swapaxes(turned, -1, -2)


def compensate(camera: Camera, pixels: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """(..., 2, p) what derivatives by p causes leave when the camera turns to meet each best, in mean square."""
    turn = turn_jacobian(camera, pixels)
    known = np.isfinite(jacobian).all(axis=(-1, -2)) & np.isfinite(turn).all(axis=(-1, -2))
    if not known.any():
        return np.full_like(jacobian, np.nan)
    design = turn[known].reshape(-1, 3)
    return jacobian - turn @ np.linalg.lstsq(design, jacobian[known].reshape(len(design), -1), rcond=None)[0]


def _by_ray(by_pixel: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """(..., 2, 3) from a tangent of the ray sphere to pixels; NaN where not valid."""
    safe = np.where(valid[..., None, None], by_pixel, np.eye(3)[:, :2])
    transposed = np.swapaxes(safe, -1, -2)
    return np.where(valid[..., None, None], np.linalg.solve(transposed @ safe, transposed), np.nan)
