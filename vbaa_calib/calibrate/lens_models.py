"""The lens models that can be solved for: one row each, and the two projections behind them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from ..camera import Camera

OPENCV_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
FISHEYE_NAMES = ("k1", "k2", "k3", "k4")


@dataclass(frozen=True)
class LensModel:
    """A lens model: which distortion coefficients it has, and which of them are free.

    Attributes
    ----------
    name : as `--model` takes it.
    camera_model : "opencv" or "fisheye".
    distortion_count : coefficients stored, in OpenCV's order.
    free : indices of those that are solved for; the others stay zero.
    simpler : the model whose solution is a good start for this one.
    """

    name: str
    camera_model: str
    distortion_count: int
    free: tuple[int, ...]
    simpler: str | None

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """fx, fy, cx, cy, then the distortion in OpenCV's order."""
        names = FISHEYE_NAMES if self.camera_model == "fisheye" else OPENCV_NAMES
        return ("fx", "fy", "cx", "cy", *names[: self.distortion_count])


LENS_MODELS = {
    model.name: model
    for model in (
        LensModel("none", "opencv", 0, (), None),
        LensModel("radial", "opencv", 4, (0, 1), "none"),
        LensModel("opencv4", "opencv", 4, (0, 1, 2, 3), "radial"),
        # from the solution without k3: a free k3 from a cold start ends far from the minimum on long lenses
        LensModel("opencv5", "opencv", 5, (0, 1, 2, 3, 4), "opencv4"),
        # from the fisheye, whose curve is smooth: from polynomials it often ends with a pole inside the picture
        LensModel("rational", "opencv", 8, tuple(range(8)), "fisheye"),
        LensModel("thin", "opencv", 12, tuple(range(12)), "rational"),
        LensModel("tilted", "opencv", 14, tuple(range(14)), "thin"),
        LensModel("fisheye", "fisheye", 4, (0, 1, 2, 3), None),
    )
}
"""By name, from simple to rich."""

Projection = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


def camera_matrix(intrinsics: np.ndarray) -> np.ndarray:
    """(3, 3) camera matrix from (fx, fy, cx, cy, *distortion)."""
    fx, fy, cx, cy = intrinsics[:4]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _project_opencv(
    points: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    distortion = intrinsics[4:] if len(intrinsics) > 4 else np.zeros(4)
    pixels, jacobian = cv2.projectPoints(points, pose[:3], pose[3:], camera_matrix(intrinsics), distortion)
    return pixels.reshape(-1, 2), jacobian[:, 6 : 6 + len(intrinsics)], jacobian[:, :6]


def _project_fisheye(
    points: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    pixels, jacobian = cv2.fisheye.projectPoints(
        points.reshape(-1, 1, 3),
        pose[:3].reshape(3, 1),
        pose[3:].reshape(3, 1),
        camera_matrix(intrinsics),
        intrinsics[4:].reshape(4, 1),
    )
    return pixels.reshape(-1, 2), jacobian[:, :8], jacobian[:, 8:14]


PROJECTIONS: dict[str, Projection] = {"opencv": _project_opencv, "fisheye": _project_fisheye}
"""Camera model → projection of points (N, 3), pose (6,) = rotation vector and translation, intrinsics (4 + k,), to
pixels (N, 2) and the derivatives of the interleaved pixels by intrinsics (2N, 4 + k) and by the pose (2N, 6)."""


def camera_of(model: LensModel, intrinsics: np.ndarray, image_size: tuple[int, int]) -> Camera:
    """The camera of intrinsics (fx, fy, cx, cy, *distortion), without a covariance."""
    return Camera(model.camera_model, image_size, camera_matrix(intrinsics), intrinsics[4:])
