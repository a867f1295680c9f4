"""What a sweep should look like: corners of a board fixed in the world, seen by a camera that two joints carry.

p_camera = X⁻¹ · Ry(tilt) · Rx(−skew) · Trans(−offset along x) · Rz(−pan) · B · p_board with X = T_actuator_camera and
B the board's pose in the world's directions, from where the pan axis is met by the axes' common perpendicular.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec
from targets.charuco import corner_points

from ..camera import Camera
from ..detect.corners import BoardView
from ..geometry import Kinematics, Pose
from ..session import SweepPicture
from .lens_models import PROJECTIONS

CAMERA, BOARD, AXES = slice(0, 6), slice(6, 12), slice(12, 14)
"""Columns of a step: tangents of X and of B, then axis skew and axis offset."""

STATE = 14
_OUT_OF_SIGHT_PX = 1e3
_Y = np.array([0.0, 1.0, 0.0])
_Z = np.array([0.0, 0.0, 1.0])
_X = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class SweepCorners:
    """All corners of all pictures, one after the other.

    Attributes
    ----------
    points_m : (N, 3) board frame. pixels : (N, 2). picture : (N,) which picture each is of.
    pan_rad, tilt_rad : (P,) readings of the P pictures, the tilt with its zero.
    """

    points_m: np.ndarray
    pixels: np.ndarray
    picture: np.ndarray
    pan_rad: np.ndarray
    tilt_rad: np.ndarray

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
            np.array([seen.pan_rad for seen in pictures]),
            np.array([seen.tilt_rad for seen in pictures]) + kinematics.tilt_zero_rad,
        )

    @property
    def pictures(self) -> int:
        """How many pictures there are."""
        return len(self.pan_rad)


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

    Attributes
    ----------
    residuals_px : (N, 2) observed less predicted; far off where the lens does not see the point.
    by_state : (N, 2, 14). by_angles : (N, 2, 2) by the picture's own pan and tilt. by_lens : (N, 2, 4 + k).
    """

    residuals_px: np.ndarray
    by_state: np.ndarray
    by_angles: np.ndarray
    by_lens: np.ndarray


def turns_actuator_foot(corners: SweepCorners, axis_skew_rad: float) -> np.ndarray:
    """(P, 3, 3) Ry(tilt)·Rx(−skew)·Rz(−pan): directions of the world seen from the moving attachment."""
    tilt = Rotation.from_rotvec(corners.tilt_rad[:, None] * _Y)
    pan = Rotation.from_rotvec(-corners.pan_rad[:, None] * _Z)
    return (tilt * Rotation.from_rotvec(-axis_skew_rad * _X) * pan).as_matrix()


def T_camera_foot(state: SweepState, corners: SweepCorners, picture: int) -> Pose:
    """Where one picture's camera sees the foot on the pan axis, the world's directions."""
    turn = turns_actuator_foot(corners, state.axis_skew_rad)[picture]
    tilt = corners.tilt_rad[picture]
    foot = -state.axis_offset_m * np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    return state.T_actuator_camera.inverse() @ Pose(turn, foot)


def linearise(camera: Camera, state: SweepState, corners: SweepCorners) -> Linearised:
    """Residuals and derivatives of all corners at a state."""
    X, B = state.T_actuator_camera, state.T_foot_board
    whole = turns_actuator_foot(corners, state.axis_skew_rad)
    tilts = Rotation.from_rotvec(corners.tilt_rad[:, None] * _Y).as_matrix()
    # directions of the foot frame, and of the frame between the joints, seen from the camera: (N, 3, 3)
    camera_foot = (X.rotation.T @ whole)[corners.picture]
    camera_tilted = (X.rotation.T @ tilts)[corners.picture]
    lever = corners.points_m @ B.rotation.T
    at_foot = lever + B.translation_m
    at_actuator = np.einsum("nij,nj->ni", whole[corners.picture], at_foot)
    at_actuator -= state.axis_offset_m * (tilts @ _X)[corners.picture]
    points = (at_actuator - X.translation_m) @ X.rotation
    pixels, by_lens, by_point = _projected(camera, points)
    # moving a point by ω × q changes the pixel by g·(ω × q) = ω·(q × g)
    by_actuator = by_point @ X.rotation.T
    by_foot = np.einsum("nkj,njl->nkl", by_point, camera_foot)
    by_tilted = np.einsum("nkj,njl->nkl", by_point, camera_tilted)
    at_tilted = np.einsum("nji,nj->ni", tilts[corners.picture], at_actuator)
    by_tilt = np.cross(at_actuator[:, None], by_actuator) @ _Y
    by_state = np.concatenate(
        [
            -np.cross((at_actuator - X.translation_m)[:, None], by_actuator),
            -by_actuator,
            np.cross(lever[:, None], by_foot),
            by_foot,
            -np.cross(at_tilted[:, None], by_tilted)[..., :1],
            -by_tilted[..., :1],
        ],
        axis=-1,
    )
    by_pan = -np.cross(at_foot[:, None], by_foot) @ _Z
    by_angles = np.stack([by_pan, by_tilt], axis=-1)
    return Linearised(corners.pixels - pixels, by_state, by_angles, by_lens)


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
