"""A sweep's first guess in closed form: where the camera sits on the attachment, and where the board stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import cv2
import numpy as np

from ..camera import Camera
from ..detect.view_quality import fixes_homography
from ..errors import SolveError
from ..geometry import Kinematics, Pose
from .plane_starts import mirrored
from .sweep_model import SweepCorners, SweepState, T_camera_foot, turns_actuator_foot

T = TypeVar("T")

_ROUNDS = 20
_SHARP_RAD = 0.01
_SHARP_M = 1e-3


def start(camera: Camera, corners: SweepCorners, kinematics: Kinematics) -> SweepState:
    """From the board's pose in each picture alone, pictures weighed so that a few wrong ones do not count.

    With K the turn that the joints give a picture, R_X·R_camera_board = K·R_B holds for all of them, which is linear in
    both rotations: they are the first singular vectors of the sum of the Kronecker products of the two known turns
    (Shah 2013). The two places then follow from linear least squares.
    """
    poses, which = _board_poses(camera, corners)
    if len(which) < 3:
        raise SolveError("no pose of the board explains its corners: is the lens that of this camera?")
    seen = np.array([pose.rotation for pose in poses])
    known = turns_actuator_foot(corners, kinematics.axis_skew_rad)[which]

    def turns(weights: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        X, B = _rotations(known, seen, weights)
        return (X, B), np.linalg.norm(X @ seen - known @ B, axis=(1, 2))

    X, B = _settled(turns, len(which), _SHARP_RAD)
    offset = kinematics.axis_offset_m * np.stack(
        [np.cos(corners.tilt_rad), np.zeros(corners.pictures), -np.sin(corners.tilt_rad)], axis=1
    )
    right = -offset[which] - np.array([pose.translation_m for pose in poses]) @ X.T
    design = np.concatenate([np.broadcast_to(np.eye(3), known.shape), -known], axis=-1)

    def places(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        root = np.sqrt(weights)[:, None]
        both = np.linalg.lstsq((design * root[..., None]).reshape(-1, 6), (right * root).ravel(), rcond=None)[0]
        return both, np.linalg.norm(design @ both - right, axis=1)

    both = _settled(places, len(which), _SHARP_M)
    return SweepState(Pose(X, both[:3]), Pose(B, both[3:]), kinematics.axis_skew_rad, kinematics.axis_offset_m)


def turned_over(state: SweepState, corners: SweepCorners) -> SweepState:
    """The same with the board leaning to the other side of the line of sight, which looks much alike."""
    camera_foot = T_camera_foot(state, corners, 0)
    other = mirrored(camera_foot @ state.T_foot_board, corners.points_m)
    return replace(state, T_foot_board=camera_foot.inverse() @ other)


def _settled(solve: Callable[[np.ndarray], tuple[T, np.ndarray]], count: int, sharp: float) -> T:
    """The solution whose misfits (P,), not their squares, are least: by weights that go with one over the misfit."""
    weights = np.ones(count)
    for _ in range(_ROUNDS):
        solution, misfit = solve(weights)
        weights = 1.0 / np.maximum(misfit, sharp)
    return solution


def _rotations(known: np.ndarray, seen: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R_X and R_B, (3, 3), that bring R_X·seen and known·R_B closest together; known and seen (P, 3, 3)."""
    product = np.einsum("p,pji,pkl->iljk", weights, known, seen).reshape(9, 9)
    left, _, right = np.linalg.svd(product)
    R_B, R_X = left[:, 0].reshape(3, 3), right[0].reshape(3, 3)
    return _nearest_rotation(R_X), _nearest_rotation(R_B)


def _nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    left, _, right = np.linalg.svd(matrix * np.sign(np.linalg.det(matrix)))
    return left @ right


def _board_poses(camera: Camera, corners: SweepCorners) -> tuple[list[Pose], np.ndarray]:
    """T_camera_board by homography, picture by picture, and which pictures allow it."""
    ideal, valid = camera.unproject_normalized(corners.pixels)
    poses, which = [], []
    for index in range(corners.pictures):
        mine = valid & (corners.picture == index)
        if mine.sum() < 4 or not fixes_homography(corners.points_m[mine, :2]):
            continue
        done, rotvec, translation = cv2.solvePnP(corners.points_m[mine], ideal[mine], np.eye(3), None)
        if done and np.isfinite(rotvec).all() and np.isfinite(translation).all() and translation[2, 0] > 0.0:
            poses.append(Pose.from_rotvec(rotvec.ravel(), translation))
            which.append(index)
    return poses, np.array(which, int)
