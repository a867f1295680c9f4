"""Least squares of a sweep in pixels: a board fixed in the world, seen by a camera that two joints carry.

p_camera = X⁻¹ · Ry(tilt) · Rx(−skew) · Trans(−offset along x) · Rz(−pan) · B · p_board with X = T_actuator_camera and
B the board's pose in the world's directions, from the foot of the axes' common perpendicular on the pan axis.

An error of the angles shifts all corners of a picture alike and does not average out over them. The model therefore has
two unknown angle errors a picture, normal with one variance, estimated by restricted maximum likelihood and eliminated
picture by picture (Schur complement).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import minimize_scalar

from vbaa_calib.calibrate.lens.models import projected
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import SolveError
from vbaa_calib.core.least_squares import Rules, levenberg_marquardt, schur_complement, solve_scaled, view_products
from vbaa_calib.core.robust import radial_std, soft_l1_weights
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Kinematics, Pose, rotation_world_antenna
from vbaa_calib.session import SweepPicture

from .board_pose import mirrored
from .hand_eye_start import robot_world

CAMERA, _BOARD, AXES = slice(0, 6), slice(6, 12), slice(12, 14)
"""Columns of a step: tangents of X and of B, then axis skew and axis offset."""

_STATE = 14
_AXES_FIXED = np.arange(_STATE) < AXES.start
_SOFT_PER_SIGMA = 1.5
_REWEIGHTINGS, _CONVERGED_WEIGHTS = 15, 1e-2
_RULES = Rules(100, tolerance=1e-14, standstill=1e-18, damping=1e-4)
_FEW_STEPS = replace(_RULES, iterations=3)
_ROUNDING_PX = 1e-7
_RATIO_POWERS = (-2.0, 12.0)
_RATIO_ROUNDS, _SAME_RATIO = 6, 1e-4
_CORNER_ROUNDS = 6
_CHANCE_SIGMAS = 6.4  # one good corner in 1e9 lies further off
_LEAST_PX = 0.25
_Y = np.eye(3)[1]


@dataclass(frozen=True, eq=False)
class SweepCorners:
    """All corners of all pictures, concatenated."""

    points_m: np.ndarray  # (N, 3) board frame
    pixels: np.ndarray  # (N, 2)
    picture: np.ndarray  # (N,) index of the picture
    angles_rad: np.ndarray  # (P, 2) readings of pan and tilt of the P pictures, the tilt with its zero

    @staticmethod
    def of(
        views: Sequence[BoardView], pictures: Sequence[SweepPicture], points_m: np.ndarray, kinematics: Kinematics
    ) -> SweepCorners:
        """From the board (C, 3) seen in every picture, and the joints' readings there."""
        return SweepCorners(
            np.concatenate([points_m[view.ids] for view in views]),
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
        """By a step (14,) as CAMERA, _BOARD and AXES split it."""
        return SweepState(
            self.T_actuator_camera.retract(step[CAMERA]),
            self.T_foot_board.retract(step[_BOARD]),
            self.axis_skew_rad + float(step[12]),
            self.axis_offset_m + float(step[13]),
        )


class _SweepRows(NamedTuple):
    """Residuals and their negative derivatives."""

    residuals_px: np.ndarray  # (N, 2) observed less predicted; far off where the lens does not see the point
    by_state: np.ndarray  # (N, 2, 14)
    by_angles: np.ndarray  # (N, 2, 2) by the picture's own pan and tilt
    by_lens: np.ndarray  # (N, 2, 4 + k)


def _turns_actuator_foot(corners: SweepCorners, axis_skew_rad: float) -> np.ndarray:
    """(P, 3, 3) Ry(tilt)·Rx(−skew)·Rz(−pan): directions of the world seen from the moving attachment."""
    pan, tilt = corners.angles_rad.T
    return np.swapaxes(rotation_world_antenna(pan, tilt, axis_skew_rad), -1, -2)


def _tilted_x(corners: SweepCorners) -> np.ndarray:
    """(P, 3) the panned x axis seen from the moving attachment."""
    tilt = corners.angles_rad[:, 1]
    return np.stack([np.cos(tilt), np.zeros_like(tilt), -np.sin(tilt)], axis=1)


def linearise(camera: Camera, state: SweepState, corners: SweepCorners) -> _SweepRows:
    """Residuals and derivatives of all corners at a state."""
    X, B = state.T_actuator_camera, state.T_foot_board
    world = _turns_actuator_foot(corners, state.axis_skew_rad)[corners.picture]
    across = _tilted_x(corners)[corners.picture]
    lever = corners.points_m @ B.rotation.T
    from_foot = np.einsum("nij,nj->ni", world, lever + B.translation_m)
    at = from_foot - state.axis_offset_m * across
    pixels, by_point, by_lens = projected(camera, (at - X.translation_m) @ X.rotation)
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
    return _SweepRows(corners.pixels - pixels, by_state[..., :_STATE], by_state[..., _STATE:], by_lens)


def initial_state(camera: Camera, corners: SweepCorners, kinematics: Kinematics) -> SweepState:
    """From the board's pose in each picture alone, robust against a few wrong ones."""
    poses, which = _board_poses(camera, corners)
    if len(which) < 3:
        raise SolveError("no pose of the board explains its corners: is the lens that of this camera?")
    turns = _turns_actuator_foot(corners, kinematics.axis_skew_rad)[which]
    shifts = -kinematics.axis_offset_m * _tilted_x(corners)[which]
    X, B = robot_world([Pose(*known) for known in zip(turns, shifts, strict=True)], poses)
    return SweepState(X, B, kinematics.axis_skew_rad, kinematics.axis_offset_m)


def turned_over(state: SweepState, corners: SweepCorners) -> SweepState:
    """The state with the board leaning to the other side of the line of sight, which looks much alike."""
    turn = _turns_actuator_foot(corners, state.axis_skew_rad)[0]
    camera_foot = state.T_actuator_camera.inverse() @ Pose(turn, -state.axis_offset_m * _tilted_x(corners)[0])
    other = mirrored(camera_foot @ state.T_foot_board, corners.points_m)
    return replace(state, T_foot_board=camera_foot.inverse() @ other)


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


@dataclass(frozen=True, eq=False)
class SweepFit:
    """A minimum and its uncertainty."""

    state: SweepState
    angle_ratio: float  # (rad/px)² variance of the joint angles over that of a corner's coordinate
    variance_px2: float  # of a corner's coordinate
    residuals_px: np.ndarray  # (N, 2) once the pictures' angles are corrected
    covariance: np.ndarray  # (14, 14) of the state's step, zero where it was fixed
    by_lens: np.ndarray  # (14, 4 + k) derivative of the step

    @property
    def angle_std_rad(self) -> float:
        """Scatter of the joint angles' readings about what the pictures show."""
        return float(np.sqrt(self.angle_ratio * self.variance_px2))


class _SweepEquations(NamedTuple):
    """Normal equations A·step = b with the angles eliminated; `cost` is the sum of squares at no step."""

    state: SweepState
    at: _SweepRows
    blocks: np.ndarray
    A: np.ndarray
    b: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class SweepProblem:
    """The corners of a sweep, seen by a camera; `free` (14,) are the columns of a step that are solved for."""

    camera: Camera
    corners: SweepCorners
    free: np.ndarray

    @staticmethod
    def of(camera: Camera, corners: SweepCorners, axes: bool = True) -> SweepProblem:
        """With the axes' skew and offset free, or fixed where they are."""
        return SweepProblem(camera, corners, np.ones(_STATE, bool) if axes else _AXES_FIXED)

    def _blocks(self, at: _SweepRows, weights: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(P, m, m) products of columns (N, 2, ...), then the residual, then the picture's own angles."""
        whole = np.concatenate([columns, at.residuals_px[..., None], at.by_angles], axis=-1)
        bounds = np.searchsorted(self.corners.picture, np.arange(self.corners.pictures + 1))
        return view_products(whole * np.sqrt(weights)[:, None, None], bounds)

    def _descended(self, state: SweepState, weights: np.ndarray, angle_ratio: float, rules: Rules) -> _SweepEquations:
        def linearised(state: SweepState) -> _SweepEquations:
            at = linearise(self.camera, state, self.corners)
            blocks = self._blocks(at, weights, at.by_state[..., self.free])
            whole = _without_angles(blocks, angle_ratio)
            return _SweepEquations(state, at, blocks, whole[:-1, :-1], whole[:-1, -1], float(whole[-1, -1]))

        def step(system: _SweepEquations, damping: float) -> tuple[np.ndarray, float]:
            move = solve_scaled(system.A, system.b, damping)
            return move, float(system.b @ move)

        def moved(system: _SweepEquations, move: np.ndarray) -> _SweepEquations:
            whole = np.zeros(_STATE)
            whole[self.free] = move
            return linearised(system.state.moved(whole))

        return levenberg_marquardt(linearised(state), step, moved, rules).at

    def robust(self, state: SweepState, used: np.ndarray) -> tuple[SweepState, np.ndarray]:
        """A state by IRLS of distances of the corners used (N,), and all residuals (N, 2) px.

        A redescending loss would fit some pictures all but exactly and give up others, where the angles scatter.
        """
        weights = used.astype(float)
        residuals = linearise(self.camera, state, self.corners).residuals_px
        for _ in range(_REWEIGHTINGS):
            distance = np.linalg.norm(residuals, axis=1)
            scale = _SOFT_PER_SIGMA * max(radial_std(distance[used]), 1e-9)
            before, weights = weights, used * soft_l1_weights(distance, scale)
            system = self._descended(state, weights, 0.0, _FEW_STEPS)
            state, residuals = system.state, system.at.residuals_px
            if np.abs(weights - before).max() < _CONVERGED_WEIGHTS:
                break
        return state, residuals

    def fit(self, state: SweepState, used: np.ndarray) -> SweepFit:
        """The minimum over the corners used (N,) bool, with the scatter of the joint angles (REML)."""
        weights, ratio = used.astype(float), 0.0
        for _ in range(_RATIO_ROUNDS):
            system = self._descended(state, weights, ratio, _RULES)
            state, before = system.state, ratio
            ratio = _angle_variance_ratio(system.blocks, 2 * int(used.sum()))
            if abs(ratio - before) <= _SAME_RATIO * before:
                break
        system = self._descended(state, weights, ratio, _RULES)
        at, free = system.at, self.free
        count, lens = int(free.sum()), at.by_lens.shape[-1]
        blocks = self._blocks(at, weights, np.concatenate([at.by_state[..., free], at.by_lens], axis=-1))
        whole = _without_angles(blocks, ratio)
        A, coupling, cost = whole[:count, :count], whole[:count, count:-1], float(whole[-1, -1])
        variance = max(cost / max(2 * weights.sum() - count, 1.0), _ROUNDING_PX**2)
        covariance, by_lens = np.zeros((_STATE, _STATE)), np.zeros((_STATE, lens))
        covariance[np.ix_(free, free)] = variance * solve_scaled(A, np.eye(count))
        by_lens[free] = -solve_scaled(A, coupling)
        residuals = at.residuals_px
        if ratio > 0.0:
            shift = np.linalg.solve(blocks[:, -2:, -2:] + np.eye(2) / ratio, blocks[:, -2:, -3, None])[..., 0]
            residuals = residuals - np.einsum("nij,nj->ni", at.by_angles, shift[self.corners.picture])
        return SweepFit(system.state, ratio, variance, residuals, covariance, by_lens)

    def inlying(self, state: SweepState, candidates: np.ndarray) -> tuple[SweepFit, np.ndarray]:
        """The fit to the candidates (N,) without outliers, judged by the spread of the others; and which are in it."""
        used = candidates
        for _ in range(_CORNER_ROUNDS):
            found = self.fit(state, used)
            distance = np.linalg.norm(found.residuals_px, axis=1)
            limit = max(_CHANCE_SIGMAS * radial_std(distance[used]), _LEAST_PX)
            state, before, used = found.state, used, candidates & (distance <= limit)
            if np.array_equal(used, before):
                break
        return found, before


def _without_angles(blocks: np.ndarray, angle_ratio: float) -> np.ndarray:
    """(m − 2, m − 2) sum of blocks (P, m, m) with the last two columns, the angles, marginalised."""
    total = blocks[:, :-2, :-2].sum(axis=0)
    if angle_ratio == 0.0:
        return total
    return schur_complement(total, blocks[:, -2:, :-2], blocks[:, -2:, -2:] + np.eye(2) / angle_ratio)[0]


def _angle_variance_ratio(blocks: np.ndarray, rows: int) -> float:
    """(rad/px)² joint angles over corners; blocks (P, m, m) : free steps, residual, angles."""
    freedom = rows - (blocks.shape[-1] - 3)
    angles = blocks[:, -2:, -2:]
    per_angle = float(np.mean(np.trace(angles, axis1=1, axis2=2))) / 2

    def badness(power: float) -> float:
        ratio = 10**power / per_angle
        whole = _without_angles(blocks, ratio)
        A, b = whole[:-1, :-1], whole[:-1, -1]
        left = max(float(whole[-1, -1]) - float(b @ solve_scaled(A, b)), 1e-30)
        shrink = float(np.linalg.slogdet(np.eye(2) + ratio * angles)[1].sum())
        # the determinant of a positive matrix that may be singular to working precision
        diagonal = np.maximum(np.diag(A), 1e-30)
        values = np.linalg.eigvalsh(A / np.sqrt(np.outer(diagonal, diagonal)))
        log_determinant = float(np.log(diagonal).sum() + np.log(np.maximum(values, 1e-15)).sum())
        return shrink + log_determinant + freedom * np.log(left)

    # there may be several minima, and a flat stretch where the angles count as exact
    powers = np.arange(*_RATIO_POWERS)
    best = powers[np.argmin([badness(power) for power in powers])]
    found = minimize_scalar(badness, bounds=(best - 1.0, best + 1.0), method="bounded", options={"xatol": 1e-5})
    return float(10**found.x / per_angle) if found.fun < badness(-np.inf) else 0.0
