"""What a sweep should look like: corners of a board fixed in the world, seen by a camera that two joints carry.

p_camera = X⁻¹ · Ry(tilt) · Rx(−skew) · Trans(−offset along x) · Rz(−pan) · B · p_board with X = T_actuator_camera and
B the board's pose in the world's directions, from where the pan axis is met by the axes' common perpendicular.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.models import PROJECTIONS
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import SolveError
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Kinematics, Pose, rotation_world_antenna
from vbaa_calib.session import SweepPicture

from .board_pose import mirrored

CAMERA, BOARD, AXES = slice(0, 6), slice(6, 12), slice(12, 14)
"""Columns of a step: tangents of X and of B, then axis skew and axis offset."""

STATE = 14
_OUT_OF_SIGHT_PX = 1e3
_Y, _Z = np.eye(3)[1:]


@dataclass(frozen=True, eq=False)
class SweepCorners:
    """All corners of all pictures, one after the other.

    points_m : (N, 3) board frame. pixels : (N, 2). picture : (N,) which picture each is of.
    angles_rad : (P, 2) readings of pan and tilt of the P pictures, the tilt with its zero.
    """

    points_m: np.ndarray
    pixels: np.ndarray
    picture: np.ndarray
    angles_rad: np.ndarray

    @staticmethod
    def of(
        views: Sequence[BoardView], pictures: Sequence[SweepPicture], spec: BoardSpec, kinematics: Kinematics
    ) -> SweepCorners:
        """From the board seen in every picture, and the joints' readings there."""
        points = corner_points(spec)
        return SweepCorners(
            np.concatenate([points[view.ids] for view in views]),
            np.concatenate([view.corners_px for view in views]),
            np.repeat(np.arange(len(views)), [len(view.ids) for view in views]),
            np.array([[seen.pan_rad, seen.tilt_rad + kinematics.tilt_zero_rad] for seen in pictures]),
        )

    @property
    def pictures(self) -> int:
        """How many pictures there are."""
        return len(self.angles_rad)


@dataclass(frozen=True, eq=False)
class SweepState:
    """What is solved for."""

    T_actuator_camera: Pose
    T_foot_board: Pose
    axis_skew_rad: float
    axis_offset_m: float

    def moved(self, step: np.ndarray) -> SweepState:
        """By a step (14,) as CAMERA, BOARD and AXES split it."""
        return SweepState(
            self.T_actuator_camera.retract(step[CAMERA]),
            self.T_foot_board.retract(step[BOARD]),
            self.axis_skew_rad + float(step[12]),
            self.axis_offset_m + float(step[13]),
        )


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals and their negative derivatives.

    residuals_px : (N, 2) observed less predicted; far off where the lens does not see the point.
    by_state : (N, 2, 14). by_angles : (N, 2, 2) by the picture's own pan and tilt. by_lens : (N, 2, 4 + k).
    """

    residuals_px: np.ndarray
    by_state: np.ndarray
    by_angles: np.ndarray
    by_lens: np.ndarray


def _turns_actuator_foot(corners: SweepCorners, axis_skew_rad: float) -> np.ndarray:
    """(P, 3, 3) Ry(tilt)·Rx(−skew)·Rz(−pan): directions of the world seen from the moving attachment."""
    pan, tilt = corners.angles_rad.T
    return np.swapaxes(rotation_world_antenna(pan, tilt, axis_skew_rad), -1, -2)


def _tilted_x(corners: SweepCorners) -> np.ndarray:
    """(P, 3) the panned x axis seen from the moving attachment."""
    tilt = corners.angles_rad[:, 1]
    return np.stack([np.cos(tilt), np.zeros_like(tilt), -np.sin(tilt)], axis=1)


def linearise(camera: Camera, state: SweepState, corners: SweepCorners) -> Linearised:
    """Residuals and derivatives of all corners at a state."""
    X, B = state.T_actuator_camera, state.T_foot_board
    world = _turns_actuator_foot(corners, state.axis_skew_rad)[corners.picture]
    across = _tilted_x(corners)[corners.picture]
    lever = corners.points_m @ B.rotation.T
    from_foot = np.einsum("nij,nj->ni", world, lever + B.translation_m)
    at = from_foot - state.axis_offset_m * across
    pixels, by_lens, by_point = _projected(camera, (at - X.translation_m) @ X.rotation)
    # how each step, then pan and tilt, moves the point as seen from the attachment: (N, 16, 3)
    moves = [
        np.cross((at - X.translation_m)[:, None], np.eye(3)),
        np.broadcast_to(-np.eye(3), world.shape),
        np.cross(np.eye(3), lever[:, None]) @ np.swapaxes(world, -1, -2),
        np.swapaxes(world, -1, -2),
        np.cross(at, across)[:, None],
        -across[:, None],
        np.cross(from_foot, world[..., 2])[:, None],
        np.cross(_Y, at)[:, None],
    ]
    by_state = by_point @ X.rotation.T @ np.swapaxes(np.concatenate(moves, axis=1), -1, -2)
    return Linearised(corners.pixels - pixels, by_state[..., :STATE], by_state[..., STATE:], by_lens)


def _projected(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (N, 2) and their derivatives by the lens (N, 2, 4 + k) and by the point (N, 2, 3)."""
    seen = camera.project(points)[1]
    intrinsics = camera.parameters
    ahead = np.where(seen[:, None], points, _Z)
    pixels, by_lens, by_pose = PROJECTIONS[camera.model](ahead, np.zeros(6), intrinsics)
    mask = seen[:, None, None]
    return (
        np.where(seen[:, None], pixels, _OUT_OF_SIGHT_PX * 10),
        np.where(mask, by_lens.reshape(len(points), 2, -1), 0.0),
        np.where(mask, by_pose[:, 3:].reshape(-1, 2, 3), 0.0),
    )


T = TypeVar("T")

_ROUNDS = 20
_SHARP_RAD = 0.01
_SHARP_M = 1e-3


def initial_state(camera: Camera, corners: SweepCorners, kinematics: Kinematics) -> SweepState:
    """From the board's pose in each picture alone, pictures weighed so that a few wrong ones do not count.

    With K the turn that the joints give a picture, R_X·R_camera_board = K·R_B holds for all of them, which is linear in
    both rotations: they are the first singular vectors of the sum of the Kronecker products of the two known turns
    (Shah 2013). The two places then follow from linear least squares.
    """
    poses, which = _board_poses(camera, corners)
    if len(which) < 3:
        raise SolveError("no pose of the board explains its corners: is the lens that of this camera?")
    seen = np.array([pose.rotation for pose in poses])
    known = _turns_actuator_foot(corners, kinematics.axis_skew_rad)[which]

    def turns(weights: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        X, B = _rotations(known, seen, weights)
        return (X, B), np.linalg.norm(X @ seen - known @ B, axis=(1, 2))

    X, B = _least_absolute(turns, len(which), _SHARP_RAD)
    seen_from = np.array([pose.translation_m for pose in poses]) @ X.T
    right = -kinematics.axis_offset_m * _tilted_x(corners)[which] - seen_from
    design = np.concatenate([np.broadcast_to(np.eye(3), known.shape), -known], axis=-1)

    def places(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        root = np.sqrt(weights)[:, None]
        both = np.linalg.lstsq((design * root[..., None]).reshape(-1, 6), (right * root).ravel(), rcond=None)[0]
        return both, np.linalg.norm(design @ both - right, axis=1)

    both = _least_absolute(places, len(which), _SHARP_M)
    return SweepState(Pose(X, both[:3]), Pose(B, both[3:]), kinematics.axis_skew_rad, kinematics.axis_offset_m)


def turned_over(state: SweepState, corners: SweepCorners) -> SweepState:
    """The same with the board leaning to the other side of the line of sight, which looks much alike."""
    turn = _turns_actuator_foot(corners, state.axis_skew_rad)[0]
    camera_foot = state.T_actuator_camera.inverse() @ Pose(turn, -state.axis_offset_m * _tilted_x(corners)[0])
    other = mirrored(camera_foot @ state.T_foot_board, corners.points_m)
    return replace(state, T_foot_board=camera_foot.inverse() @ other)


def _least_absolute(solve: Callable[[np.ndarray], tuple[T, np.ndarray]], count: int, sharp: float) -> T:
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
