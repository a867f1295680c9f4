"""What the covariance of a lens means in the picture: how far each pixel's ray may be off.

A lens that is a little wrong and a camera that is a little turned look much the same. Who solves for the camera's pose
with this lens, as every rig does, has that part taken up by the pose. `compensated` leaves out of the uncertainty what
a turn of the camera explains.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import cv2
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


def covered_pixels(image_size: tuple[int, int], corners_px: np.ndarray) -> np.ndarray:
    """(M, 2) pixels of a grid over the picture that lie among corners (N, 2)."""
    hull = cv2.convexHull(corners_px.astype(np.float32))
    grid = pixel_grid(image_size).reshape(-1, 2)
    return np.array([one for one in grid if cv2.pointPolygonTest(hull, one.tolist(), False) >= 0]).reshape(-1, 2)


def expected_errors_px(cameras: Mapping[str, Camera], reference: str, pixels: np.ndarray) -> dict[str, float]:
    """How far each lens is expected to be off, rms over pixels (M, 2), what a turn of the camera explains left out.

    cameras : solutions of several lens models from the same corners, by name, with covariances. reference : one that is
        right but for noise.

    The focused information criterion (Claeskens & Hjort 2003): a lens' own variance, and the square of its bias, which
    is that of its difference from the reference less what noise makes of it.
    """
    rays, valid = cameras[reference].unproject(pixels)
    variances, squares = {}, {}
    for name, camera in cameras.items():
        assert camera.covariance is not None
        seen, inside = camera.project(rays)
        known = valid & inside
        jacobian = compensate(camera, seen, projection_jacobian(camera, seen))[known]
        carried = jacobian @ camera.covariance @ np.swapaxes(jacobian, -1, -2)
        variances[name] = float(np.nanmean(np.trace(carried, axis1=-2, axis2=-1))) if known.any() else np.inf
        apart = compensate(camera, seen, (seen - pixels)[..., None])[known, :, 0]
        # a pixel that a lens does not see is one that it gets wrong
        squares[name] = float(np.mean(np.sum(apart**2, axis=1))) if known.all() else np.inf
    noise = {name: max(variances[reference] - variance, 0.0) for name, variance in variances.items()}
    return {
        name: float(np.sqrt(variance + max(squares[name] - noise[name], 0.0))) for name, variance in variances.items()
    }


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
