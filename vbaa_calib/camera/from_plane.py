"""Points on plane C back to pixels, with covariances: the inverse of the metric layer."""

from __future__ import annotations

from typing import Any

import numpy as np

from vbaa_calib.core.arrays import PLAUSIBLE, as_floats, check_each
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import PLANE_C, Pose

from .camera import Camera
from .plane import intersect_plane


def pixels_on_plane(
    camera: Camera, T_antenna_camera: Pose, plane_xy_m: Any, covariance_m2: Any = None
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Pixels (..., 2) of points (..., 2) m on plane C, antenna frame; with covariances also their standard deviation
    (...) px, the geometric mean of both axes, and the covariance divided by its square (..., 2, 2).

    Missing points (NaN) stay missing; those that the metric layer cannot give (behind the camera, beyond its
    lens, at a grazing angle) are put far outside the picture. Arrays, lists and tensors are taken alike.

    covariance_m2 : (..., 2, 2) of each point, or (2, 2) of all; None: no covariances.

    Raises
    ------
    InputError : other shapes, what is no number or no covariance, a camera that lies in plane C.
    """
    remedy = "give (..., 2) m on plane C, of one camera"
    xy = check_each(as_floats(plane_xy_m, "plane_xy_m", remedy), PLAUSIBLE.place_m, "plane_xy_m", remedy, "infinite")
    if xy.ndim == 0 or xy.shape[-1] != 2:
        raise InputError(f"plane_xy_m has shape {xy.shape}", remedy=remedy)
    if abs(T_antenna_camera.translation_m[2]) < 1e-9:
        raise InputError("the camera lies in plane C, which it sees from the edge", remedy="give the points in pixels")
    missing = ~np.isfinite(xy).all(axis=-1)
    points = np.concatenate([np.where(missing[..., None], 0.0, xy), np.zeros((*xy.shape[:-1], 1))], axis=-1)
    toward = points - T_antenna_camera.translation_m
    _, crosses = intersect_plane(
        T_antenna_camera.translation_m, toward / np.linalg.norm(toward, axis=-1, keepdims=True), PLANE_C
    )
    seen = T_antenna_camera.inverse() @ points
    pixels, valid = camera.project(seen)
    farthest_px = 0.1 * PLAUSIBLE.pixel_px
    pixels = np.where((valid & crosses)[..., None], np.clip(pixels, -farthest_px, farthest_px), -farthest_px)
    pixels = np.where(missing[..., None], np.nan, pixels)
    if covariance_m2 is None:
        return pixels, None, None
    covariance = _covariances(covariance_m2, xy.shape[:-1], missing)
    with np.errstate(invalid="ignore", divide="ignore"):
        # of X/Z and Y/Z by x and y, and by the pixel
        by_point = T_antenna_camera.rotation.T[:, :2] / seen[..., 2:, None]
        by_point = by_point[..., :2, :] - (seen[..., :2] / seen[..., 2:])[..., None] * by_point[..., 2:, :]
        by_pixel = camera.normalized_with_slopes(pixels)[1]
    known = np.isfinite(by_pixel).all(axis=(-1, -2), keepdims=True) & np.isfinite(by_point).all(
        axis=(-1, -2), keepdims=True
    )
    slopes = np.linalg.solve(np.where(known, by_pixel, np.eye(2)), np.where(known, by_point, np.eye(2)))
    covariance = np.where(known, slopes @ covariance @ np.swapaxes(slopes, -1, -2), np.eye(2))
    variance = np.sqrt(np.linalg.det(covariance))
    return pixels, np.sqrt(variance), covariance / variance[..., None, None]


def _covariances(covariance_m2: Any, shape: tuple[int, ...], missing: np.ndarray) -> np.ndarray:
    """(..., 2, 2) m² covariances; the unit matrix where a point (...) is missing. Raises InputError for an invalid
    one."""
    remedy = "give (..., 2, 2) m², one for each point, or (2, 2) for all"
    covariance = as_floats(covariance_m2, "covariance_m2", remedy)
    if covariance.shape not in ((2, 2), (*shape, 2, 2)):
        raise InputError(f"covariance_m2 has shape {covariance.shape}, plane_xy_m {(*shape, 2)}", remedy=remedy)
    covariance = np.where(missing[..., None, None], np.eye(2), covariance)
    xx, xy, yx, yy = (covariance[..., a, b] for a in range(2) for b in range(2))
    with np.errstate(invalid="ignore", over="ignore"):
        sound = (np.abs(xy - yx) <= 1e-6 * np.sqrt(xx * yy)) & (xx > 0.0) & (xx * yy - xy * yx > 1e-12 * xx * yy)
        sound &= np.isfinite(xx * yy)
    if not sound.all():
        place = np.unravel_index(int(np.flatnonzero(~sound)[0]), sound.shape)
        at = f"covariance_m2[{', '.join(map(str, place))}]"
        raise InputError(f"{at} is no covariance: not finite, symmetric and positive", remedy=remedy)
    return covariance
