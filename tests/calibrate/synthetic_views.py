"""Views of a board with exactly known corners, without pictures."""

from __future__ import annotations

import cv2
import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.models import DistortionModel
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

SPEC = BoardSpec(squares_x=9, squares_y=6, square_m=0.012, marker_m=0.009)
CENTRE = corner_points(SPEC).mean(axis=0)


def projection(
    camera_model: str, points: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray
) -> tuple[np.ndarray, ...]:
    """OpenCV's pixels (N, 2) of points (N, 3) through a pose (6,) and intrinsics (4 + k,), and the derivatives of the
    interleaved pixels by intrinsics (2N, 4 + k) and by the pose's rotation vector and translation (2N, 6)."""
    fx, fy, cx, cy, *distortion = intrinsics
    matrix, padded = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), np.array(distortion or [0.0] * 4)
    if camera_model == "fisheye":
        pixels, by = cv2.fisheye.projectPoints(points[:, None], pose[:3], pose[3:], matrix, padded)
        return pixels.reshape(-1, 2), by[:, :8], by[:, 8:14]
    pixels, by = cv2.projectPoints(points, pose[:3], pose[3:], matrix, padded)
    return pixels.reshape(-1, 2), by[:, 6 : 6 + len(intrinsics)], by[:, :6]


def pose_towards(rng: np.random.Generator, distance_m: float, tilt_rad: float, offset: float = 0.25) -> Pose:
    """The board about `distance_m` away, turned by up to `tilt_rad`, off the axis by up to `offset` of the distance."""
    axis = rng.normal(size=2)
    rotvec = np.append(axis / np.linalg.norm(axis) * rng.uniform(0.3, 1.0) * tilt_rad, 0.0)
    rotation = Pose.from_rotvec(np.array([0.0, 0.0, rng.uniform(-0.5, 0.5)]), np.zeros(3)) @ Pose.from_rotvec(
        rotvec, np.zeros(3)
    )
    distance = distance_m * rng.uniform(0.8, 1.2)
    position = np.array([*(offset * distance * rng.uniform(-1, 1, 2)), distance])
    return Pose(rotation.rotation, position - rotation.rotation @ CENTRE)


def project_board(model: DistortionModel, intrinsics: np.ndarray, pose: Pose) -> np.ndarray:
    """(corner_count, 2) pixels of all corners."""
    return projection(model.camera_model, corner_points(SPEC), pose.vector, intrinsics)[0]


def board_view(
    name: str, pixels: np.ndarray, image_size: tuple[int, int], rng: np.random.Generator, sigma_px: float = 0.0
) -> BoardView:
    """The corners that fall into the picture, with noise."""
    inside = np.flatnonzero(np.all((pixels > 0) & (pixels < np.array(image_size) - 1), axis=1))
    return BoardView(
        name, inside, pixels[inside] + sigma_px * rng.normal(size=(len(inside), 2)), image_size, np.arange(27)
    )


def views_of(
    model: DistortionModel,
    intrinsics: np.ndarray,
    image_size: tuple[int, int],
    poses: list[Pose],
    rng: np.random.Generator,
    sigma_px: float = 0.0,
) -> list[BoardView]:
    """One view per pose."""
    return [
        board_view(f"{index:02d}.png", project_board(model, intrinsics, pose), image_size, rng, sigma_px)
        for index, pose in enumerate(poses)
    ]
