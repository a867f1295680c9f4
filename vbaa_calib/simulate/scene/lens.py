"""The lens of the simulated camera, by OpenCV alone: deliberately not the camera model that the pictures will test.

Pixel (0, 0) is the centre of the first pixel. Camera frame: x right, y down, z forward.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.native import core


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics of the simulated camera.

    Attributes
    ----------
    model : "opencv" or "fisheye", OpenCV's two lens models.
    image_size : (width, height), px.
    matrix : (3, 3).
    distortion : (k,) in OpenCV's order, k in 0, 4, 5, 8, 12, 14; 4 for the fisheye.
    """

    model: str
    image_size: tuple[int, int]
    matrix: np.ndarray
    distortion: np.ndarray


def project(lens: Lens, points_camera_m: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of points (..., 3) in the camera frame; NaN for points that are not in front of the camera."""
    points = np.asarray(points_camera_m, float).reshape(-1, 1, 3)
    in_front = points[:, 0, 2] > 1e-6
    safe = np.where(in_front[:, None, None], points, [0.0, 0.0, 1.0])
    function = cv2.fisheye.projectPoints if lens.model == "fisheye" else cv2.projectPoints
    # OpenCV makes a Jacobian too: of few points at a time it stays in the processor's cache
    count = 4000
    parts = np.split(safe, range(count, len(safe), count))
    pixels = np.concatenate(
        [function(p, np.zeros((3, 1)), np.zeros((3, 1)), lens.matrix, lens.distortion)[0] for p in parts]
    )
    pixels = np.asarray(pixels, float).reshape(-1, 2)
    return np.where(in_front[:, None], pixels, np.nan).reshape(*np.shape(points_camera_m)[:-1], 2)


def normalise(lens: Lens, pixels: np.ndarray) -> np.ndarray:
    """(N, 2) x/z and y/z of the rays through pixels (N, 2); meaningless where the lens cannot be inverted."""
    points = np.asarray(pixels, float).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
    if lens.model == "fisheye":
        return cv2.fisheye.undistortPoints(points, lens.matrix, lens.distortion, criteria=criteria).reshape(-1, 2)
    if not lens.distortion.size:
        return (points[:, 0] - lens.matrix[:2, 2]) / np.diag(lens.matrix)[:2]
    turned = cv2.undistortPointsIter(points, lens.matrix, lens.distortion, np.eye(3), np.eye(3), criteria)
    return turned.reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class RayMap:
    """Rays of all pixels, computed once for a scene.

    Attributes
    ----------
    lens : the lens they belong to.
    padded : (height + 2, width + 2, 2) float32 x/z and y/z at the pixel centres, with one pixel more on every side.
    """

    lens: Lens
    padded: np.ndarray

    def block(self, left: int, top: int, right: int, bottom: int, factor: int) -> np.ndarray:
        """(rows·factor, columns·factor, 2) float32 rays of the sub-pixels of pixels [left, right) × [top, bottom).

        Between pixel centres the map is interpolated linearly: its bend within a pixel is below 1e-3 px.
        """
        around = self.padded[top : bottom + 2, left : right + 2]
        size = (around.shape[1] * factor, around.shape[0] * factor)
        fine = cv2.resize(around, size, interpolation=cv2.INTER_LINEAR)
        return fine[factor:-factor, factor:-factor]

    def at(self, pixels: np.ndarray) -> np.ndarray:
        """(N, 2) x/z and y/z at pixels (N, 2) inside the picture, interpolated linearly."""
        return np.asarray(core.simulate.rays_between(self.padded, pixels))


def invertible(lens: Lens) -> bool:
    """Whether every pixel has its own ray, tested every few pixels and one pixel beyond the picture."""
    return _inverted(lens, step_px=8)[1]


def ray_map(lens: Lens) -> RayMap:
    """The rays of a lens. Raises InputError when the distortion folds back inside the picture."""
    step_px = 4 if min(lens.image_size) > 16 else 1  # between which a cubic is right to 1e-6 px
    coarse, sound = _inverted(lens, step_px)
    width, height = lens.image_size
    sizes = zip((height + 2, width + 2), coarse.shape, strict=False)
    down, across = (_between(np.arange(size) / step_px, count) for size, count in sizes)
    rays = np.stack([(down @ axis @ across.T).astype(np.float32) for axis in np.moveaxis(coarse, 2, 0)], axis=-1)
    if not sound:
        raise InputError("folds back or has a pole inside the picture", where="lens", remedy="distort less")
    return RayMap(lens, rays)


def _between(place: np.ndarray, count: int) -> np.ndarray:
    """(P, K) cubic interpolation weights of K evenly spaced values at places (P,), relative to the first value."""
    first = np.clip(place.astype(int) - 1, 0, count - 4)
    off, nodes = place - first, np.arange(4.0)
    found = np.zeros((len(place), count))
    for node in range(4):
        others = np.delete(nodes, node)
        found[np.arange(len(place)), first + node] = np.prod((off[:, None] - others) / (node - others), axis=1)
    return found


def _right_way_round(rays: np.ndarray) -> bool:
    """Whether rays (rows, columns, 2) have the orientation of the pixels, without a fold."""
    along_u, along_v = np.diff(rays, axis=1)[:-1], np.diff(rays, axis=0)[:, :-1]
    return bool((along_u[..., 0] * along_v[..., 1] > along_u[..., 1] * along_v[..., 0]).all())


def _inverted(lens: Lens, step_px: int) -> tuple[np.ndarray, bool]:
    """(rows, columns, 2) rays on a grid from pixel −1 on, and whether they project back and have the right
    orientation."""
    width, height = lens.image_size
    u, v = np.meshgrid(np.arange(-1.0, width + step_px, step_px), np.arange(-1.0, height + step_px, step_px))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    rays = normalise(lens, pixels)
    again = project(lens, np.concatenate([rays, np.ones((len(rays), 1))], axis=1))
    grid = rays.reshape(*u.shape, 2)
    return grid, bool((np.abs(again - pixels) < 1e-4).all()) and _right_way_round(grid)
