"""Uncertainty of a lens in the picture: covariance of the projection of each pixel's ray.

Errors of the lens and of the camera's rotation look much the same in the picture, and whoever solves for the camera
pose with this lens, as every rig does, absorbs that part in the pose. `compensated` removes from the uncertainty what a
rotation explains.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from vbaa_calib.calibrate.lens.settings import LensSettings
from vbaa_calib.camera import Camera
from vbaa_calib.camera.lens import ray_derivatives
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry.covariance import largest_std


def projection_uncertainty(
    camera: Camera, compensated: bool = True, grid: tuple[int, int] = LensSettings.uncertainty_grid
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (R, C, 2) on a grid over the picture, the covariances (R, C, 2, 2) px² of the projections of their fixed
    rays, and the standard deviations (R, C) px in the worst direction; NaN without a ray. grid : (columns, rows).

    compensated : without the part that a rotation of the camera explains. Raises InputError when the camera has no
        covariance.
    """
    if camera.covariance is None:
        raise InputError("the camera has no covariance", remedy="calibrate it with vbaa intrinsics")
    pixels = pixel_grid(camera.image_size, grid)
    jacobian = projection_jacobian(camera, pixels)
    if compensated:
        jacobian = compensate(camera, pixels, jacobian)
    covariance = jacobian @ camera.covariance @ np.swapaxes(jacobian, -1, -2)
    return pixels, covariance, largest_std(covariance)


def pixel_grid(image_size: tuple[int, int], grid: tuple[int, int] = LensSettings.uncertainty_grid) -> np.ndarray:
    """(rows, columns, 2) pixels on a regular grid, borders included, of a (width, height) picture. grid : (columns,
    rows)."""
    columns, rows = (np.linspace(-0.5, size - 0.5, count) for size, count in zip(image_size, grid, strict=True))
    return np.stack(np.meshgrid(columns, rows), axis=-1)


def is_covered(pixels: np.ndarray, corners_px: np.ndarray) -> np.ndarray:
    """(M,) mask of the pixels (M, 2) that lie among corners (N, 2)."""
    hull = cv2.convexHull(corners_px.astype(np.float32))
    return np.array([cv2.pointPolygonTest(hull, one.tolist(), False) >= 0 for one in pixels], bool)


def projection_jacobian(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """(..., 2, 4 + k) derivatives of the projection of each pixel's fixed ray by the intrinsics; NaN without a ray."""
    return _slopes(camera, pixels)[0]


def compensate(camera: Camera, pixels: np.ndarray, jacobian: np.ndarray, where: np.ndarray | bool = True) -> np.ndarray:
    """Derivatives (..., 2, p) of projections with the best-fitting camera rotation removed from each of the p
    columns, by least squares over the pixels `where` (...)."""
    turn = _slopes(camera, pixels)[1]
    known = where & np.isfinite(jacobian).all(axis=(-1, -2)) & np.isfinite(turn).all(axis=(-1, -2))
    if not known.any():
        return np.full_like(jacobian, np.nan)
    design = turn[known].reshape(-1, 3)
    return jacobian - turn @ np.linalg.lstsq(design, jacobian[known].reshape(len(design), -1), rcond=None)[0]


def _slopes(camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the projections of pixels' fixed rays: (..., 2, 4 + k) by the intrinsics, (..., 2, 3) per rad of
    camera rotation."""
    pixels = np.asarray(pixels, float)
    return _slopes_at(camera, pixels.shape, pixels.tobytes())


@lru_cache(maxsize=4)
def _slopes_at(camera: Camera, shape: tuple[int, ...], pixels: bytes) -> tuple[np.ndarray, np.ndarray]:
    """`_slopes`, cached: `projection_jacobian` and `compensate` ask for the same pixels."""
    at = np.frombuffer(pixels).reshape(shape)
    rays, by_pixel, by_parameter, valid = ray_derivatives(camera.intrinsics, at)
    valid, turned = valid[..., None, None], np.cross(np.eye(3), rays[..., None, :])
    safe = np.where(valid, by_pixel, np.eye(3)[:, :2])
    transposed = np.swapaxes(safe, -1, -2)
    # from a tangent of the ray sphere to pixels; NaN where not valid
    by_ray = np.where(valid, np.linalg.solve(transposed @ safe, transposed), np.nan)
    return by_ray @ -by_parameter, by_ray @ np.swapaxes(turned, -1, -2)
