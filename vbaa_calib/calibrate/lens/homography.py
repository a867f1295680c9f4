"""Homographies of a flat board to its picture, of which less than half of the corners may be wrong."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vbaa_calib.geometry import Pose
from vbaa_calib.native import core

from .settings import LensSettings


@lru_cache(maxsize=256)
def _picks(count: int) -> np.ndarray:
    """Indices (S, 4) of random samples of four out of `count` corners."""
    return np.ascontiguousarray(
        np.random.default_rng(0).random((LensSettings.homography_samples, count)).argsort(axis=1)[:, :4]
    )


def homography(points: np.ndarray, image: np.ndarray, division: float = 0.0) -> tuple[np.ndarray, float] | None:
    """Homography (3, 3) of points (N, 2) to their image (N, 2), and the noise per axis as the median corner has it; or
    None.

    Least median of squares (Rousseeuw 1984), then least squares of the points that it fits. OpenCV's finds none on
    small boards: most of its samples have three points on a line, and it gives up.

    division : λ of the undistortion x / (1 + λr²) of the image, about its origin; the noise is the distorted image's.
    """
    known = np.isfinite(image).all(axis=1)
    if known.sum() < 4:
        return None
    if not known.all():
        points, image = points[known], image[known]
    points, image = (np.ascontiguousarray(each, float) for each in (points, image))
    found, noise = core.bundle.homography(points, image, _picks(len(points)), division)
    return (found, noise) if np.isfinite(noise) else None


def board_poses(homographies: list[np.ndarray | None]) -> np.ndarray:
    """(V, 6) rotation vectors and translations of a board's plane, from its homographies (3, 3) to ideal image
    coordinates; ahead of the camera where there is none."""
    poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(homographies), 1))
    known = [view for view, found in enumerate(homographies) if found is not None]
    if known:
        every = np.array([homographies[view] for view in known])
        lengths = np.linalg.norm(every[:, :, :2], axis=1).sum(axis=1)
        every *= np.copysign(2.0 / np.maximum(lengths, 1e-300), every[:, 2, 2])[:, None, None]
        axes = np.stack([every[:, :, 0], every[:, :, 1], np.cross(every[:, :, 0], every[:, :, 1])], axis=2)
        vectors, _, others = np.linalg.svd(axes)
        vectors[:, :, 2] *= np.linalg.det(vectors @ others)[:, None]
        pairs = zip(vectors @ others, every[:, :, 2], strict=True)
        poses[known] = [Pose(rotation, shift).vector for rotation, shift in pairs]
    return poses
