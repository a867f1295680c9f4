"""Uncertainty of a lens in the picture: covariance of the projection of each pixel's ray.

Errors of the lens and of the camera's rotation look much the same in the picture, and whoever solves for the camera
pose with this lens, as every rig does, absorbs that part in the pose. `compensated` removes from the uncertainty what a
rotation explains.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import cv2
import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.camera.lens import ray_derivatives
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry.independent_axes import independent_axes, largest_std

from .settings import LensSettings


def projection_uncertainty(
    camera: Camera, compensated: bool = True, grid: tuple[int, int] = LensSettings.uncertainty_grid
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (R, C, 2) on a grid over the picture, the covariances (R, C, 2, 2) px² of the projections of their fixed
    rays, and the standard deviations (R, C) px in the worst direction; NaN without a ray. grid : (columns, rows).

    compensated : without what a turn of the camera explains. Raises InputError when the camera has no covariance.
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


def expected_errors_px(
    cameras: Mapping[str, Camera], reference: str, corners_px: np.ndarray, left_out: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Expected errors (1 + V,) px of the lens from all views and of the lens with each view left out, by the focused
    information criterion (Claeskens & Hjort 2003): variance plus squared bias, where the bias is estimated by the
    difference from the reference less twice the mean that noise causes.

    cameras : by name, from the same corners (N, 2), with covariances. reference : one without bias. left_out : by how
    much the parameters (V, 4 + k) change without each view. What a turn of the camera explains among the corners is
    left out; the geometric mean over the picture is taken, so that a lens must not run wild beyond the corners, nor
    count for nothing else.
    """
    pixels = pixel_grid(cameras[reference].image_size).reshape(-1, 2)
    among = is_covered(pixels, corners_px)
    rays, valid = cameras[reference].unproject(pixels)
    variances, squares, moved = {}, {}, {}
    for name in sorted(cameras, key=lambda one: one != reference):
        seen, inside = cameras[name].project(rays)
        # a pixel that a lens does not see is one that it gets wrong
        wrong = ~(valid & inside)
        slopes = np.concatenate([projection_jacobian(cameras[name], seen), (seen - pixels)[..., None]], axis=-1)
        left = compensate(cameras[name], seen, slopes, among & ~wrong)
        jacobian, apart = left[..., :-1], left[..., -1:]
        moved[name] = jacobian @ left_out[name].T
        apart = np.concatenate([apart, apart + moved[name] - moved[reference]], axis=-1)
        carried = jacobian @ cameras[name].covariance @ np.swapaxes(jacobian, -1, -2)
        variances[name] = np.where(wrong, np.inf, np.trace(carried, axis1=-2, axis2=-1))[:, None]
        squares[name] = np.where(wrong[:, None], LensSettings.unseen_px**2, np.sum(apart**2, axis=1))
    expected = {}
    for name, variance in variances.items():
        with np.errstate(invalid="ignore"):
            noise = np.clip(np.nan_to_num(variances[reference] - variance), 0.0, None)
        square = np.nan_to_num(np.minimum(variance, LensSettings.unseen_px**2), nan=LensSettings.unseen_px**2)
        square = square + np.clip(
            np.nan_to_num(squares[name], nan=LensSettings.unseen_px**2) - LensSettings.chance_bias * noise, 0.0, None
        )
        expected[name] = np.exp(0.5 * np.mean(np.log(np.maximum(square, LensSettings.least_error_px**2)), axis=0))
    return expected


@lru_cache(maxsize=4)
def linear_axes(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Independent axes (P, P) of a lens's covariance, one standard deviation long, and the share (P,) of each within
    which the projection is linear and the visible region unchanged.

    Where the board's views leave a rational or wide lens open the covariance is an extrapolation: a small part of a
    standard deviation along one axis leads to a lens that folds inside the picture.
    """
    assert camera.covariance is not None
    axes, shares, within = independent_axes(camera.covariance), np.ones(len(camera.covariance)), LensSettings()
    pixels = pixel_grid(camera.image_size, within.grid).reshape(-1, 2)
    slopes, (rays, valid) = projection_jacobian(camera, pixels), camera.unproject(pixels)
    valid &= np.isfinite(slopes).all(axis=(-1, -2))
    pixels, rays, slopes = pixels[valid], rays[valid], slopes[valid]
    if not len(pixels):
        return axes, shares

    def linear(step: np.ndarray) -> bool:
        seen, inside = camera.moved(step).project(rays)
        moved = slopes @ step
        allowed = within.bend * np.linalg.norm(moved) + within.negligible_px * np.sqrt(len(pixels))
        return bool(inside.all() and np.linalg.norm(seen - pixels - moved) <= allowed)

    turned = axes @ np.linalg.svd((slopes @ axes).reshape(2 * len(pixels), -1), full_matrices=False)[2].T
    for index, axis in enumerate(turned.T):
        near = (share for share in within.shares if linear(share * axis) and linear(-share * axis))
        shares[index] = next(near, within.shares[-1])
    return (axes, shares) if (shares == 1.0).all() else (turned, shares)


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
