"""Plane C by the actuator sweep: both joints move camera and antenna in front of a board that is fixed in the world.

Pan alone determines one line in the camera frame, the pan axis: the camera's turn about it and its place along it stay
open, for the unknown board can follow both. Tilt alone leaves the same open for the tilt axis. Two lines that are not
parallel leave nothing open: their common perpendicular is the actuator frame's x, its foot on the tilt axis the origin;
their angle and distance are the joints' skew and offset. The least motion is a cross.

Least squares in pixels: p_camera = X⁻¹ · Ry(tilt) · Rx(−skew) · Trans(−offset along x) · Rz(−pan) · B · p_board with
X = T_actuator_camera and B the board's pose in the world's directions, from the foot of the axes' common perpendicular
on the pan axis. An error of the angles shifts all corners of a picture alike and does not average out over them: two
unknown angle errors a picture, normal with one variance, are estimated by restricted maximum likelihood and eliminated
picture by picture (Schur complement).

Not observable:
- The zero of the pan: turning world and board together about the pan axis changes neither pictures nor camera pose.
- The zero of the tilt: another one turns the camera about the tilt axis and changes no picture. It is in the
  covariance; another method, fused with this one, finds it.
- The sense of a joint: with all its angles negated, a camera half a turn away fits as well. Another method shows it.
- Where the antenna is on the attachment: T_actuator_antenna of the session counts as exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.models import projected
from vbaa_calib.calibrate.lens.outliers import DroppedView, usable_views
from vbaa_calib.calibrate.pose.board_pose import mirrored, require_size, start_poses
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.calibrate.pose.hand_eye import robot_world
from vbaa_calib.calibrate.pose.settings import PoseSettings
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.least_squares import Rules, levenberg_marquardt, schur_complement, solve_scaled
from vbaa_calib.core.robust import chi_square, chi_square_p, radial_std, soft_l1_weights
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Kinematics, Pose, rotation_world_antenna
from vbaa_calib.geometry.covariance import largest_std
from vbaa_calib.session import Still

_CAMERA = slice(0, 6)  # columns of a step: tangent of X,
_BOARD = slice(6, 12)  # tangent of B,
_AXES = slice(12, 14)  # axis skew, rad, and axis offset, m

_RULES = Rules(100, tolerance=1e-14, standstill=1e-18, damping=1e-4)


@dataclass(frozen=True, eq=False)
class _SweepState:
    """Unknowns of a sweep: the camera's pose, the board's, skew and offset of the joints' axes."""

    T_actuator_camera: Pose
    T_foot_board: Pose
    axis_skew_rad: float
    axis_offset_m: float

    def moved(self, step: np.ndarray) -> _SweepState:
        """The state after a step (14,), with slices _CAMERA, _BOARD and _AXES."""
        return _SweepState(
            self.T_actuator_camera.retract(step[_CAMERA]),
            self.T_foot_board.retract(step[_BOARD]),
            self.axis_skew_rad + float(step[12]),
            self.axis_offset_m + float(step[13]),
        )


_SweepRows = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Reprojection residuals of all corners, (N, 2) px, observed less predicted, far off where the lens does not see the
point; and their negative derivatives by the state (N, 2, 14), by the picture's own pan and tilt (N, 2, 2), by the lens
(N, 2, 4 + k)."""


def _turns_actuator_foot(problem: _SweepProblem, axis_skew_rad: float) -> np.ndarray:
    """(P, 3, 3) rotations Ry(tilt)·Rx(−skew)·Rz(−pan) from the world's directions to the moving attachment's."""
    pan, tilt = problem.angles_rad.T
    return np.swapaxes(rotation_world_antenna(pan, tilt, axis_skew_rad), -1, -2)


def _tilted_x(problem: _SweepProblem) -> np.ndarray:
    """(P, 3) the panned x axis in the moving attachment's frame."""
    tilt = problem.angles_rad[:, 1]
    return np.stack([np.cos(tilt), np.zeros_like(tilt), -np.sin(tilt)], axis=1)


def _linearise(problem: _SweepProblem, state: _SweepState) -> _SweepRows:
    """Residuals and derivatives of all corners at a state."""
    X, B = state.T_actuator_camera, state.T_foot_board
    world = _turns_actuator_foot(problem, state.axis_skew_rad)[problem.picture]
    across = _tilted_x(problem)[problem.picture]
    lever = problem.points_m @ B.rotation.T
    from_foot = np.einsum("nij,nj->ni", world, lever + B.translation_m)
    at = from_foot - state.axis_offset_m * across
    pixels, by_point, by_lens = projected(problem.camera, (at - X.translation_m) @ X.rotation)
    # how each step, then pan and tilt, moves the point as seen from the attachment: (N, 16, 3)
    moves = [
        np.cross((at - X.translation_m)[:, None], np.eye(3)),
        np.broadcast_to(-np.eye(3), world.shape),
        np.cross(np.eye(3), lever[:, None]) @ np.swapaxes(world, -1, -2),
        np.swapaxes(world, -1, -2),
        np.cross(at, across)[:, None],
        -across[:, None],
        np.cross(from_foot, world[..., 2])[:, None],
        np.cross(np.eye(3)[1], at)[:, None],
    ]
    by_state = by_point @ X.rotation.T @ np.swapaxes(np.concatenate(moves, axis=1), -1, -2)
    return problem.pixels - pixels, by_state[..., : _AXES.stop], by_state[..., _AXES.stop :], by_lens


def _initial_state(problem: _SweepProblem, kinematics: Kinematics) -> _SweepState:
    """Initial state from the board's pose in each picture, robust to a few wrong ones."""
    poses, which = _board_poses(problem)
    if len(which) < 3:
        raise SolveError("no pose of the board explains its corners: is the lens that of this camera?")
    turns = _turns_actuator_foot(problem, kinematics.axis_skew_rad)[which]
    shifts = -kinematics.axis_offset_m * _tilted_x(problem)[which]
    X, B = robot_world([Pose(*known) for known in zip(turns, shifts, strict=True)], poses)
    return _SweepState(X, B, kinematics.axis_skew_rad, kinematics.axis_offset_m)


def _turned_over(state: _SweepState, problem: _SweepProblem) -> _SweepState:
    """The state with the board's normal reflected about the line of sight, which looks much alike: the second pose."""
    turn = _turns_actuator_foot(problem, state.axis_skew_rad)[0]
    camera_foot = state.T_actuator_camera.inverse() @ Pose(turn, -state.axis_offset_m * _tilted_x(problem)[0])
    other = mirrored(camera_foot @ state.T_foot_board, problem.points_m)
    return replace(state, T_foot_board=camera_foot.inverse() @ other)


def _board_poses(problem: _SweepProblem) -> tuple[list[Pose], np.ndarray]:
    """T_camera_board in closed form of the pictures that determine one, and their indices."""
    ideal, valid = problem.camera.unproject_normalized(problem.pixels)
    poses, which = [], []
    for index in range(problem.pictures):
        mine = valid & (problem.picture == index)
        if mine.sum() >= 4 and fixes_homography(problem.points_m[mine, :2]):
            with suppress(SolveError):
                poses.append(start_poses(problem.points_m[mine], ideal[mine])[0])
                which.append(index)
    return poses, np.array(which, int)


@dataclass(frozen=True, eq=False)
class _SweepFit:
    """Minimum of a sweep's problem and its uncertainty."""

    state: _SweepState
    angle_ratio: float  # (rad/px)² variance of the joint angles over that of a corner's coordinate
    variance_px2: float  # of a corner's coordinate
    residuals_px: np.ndarray  # (N, 2) once the pictures' angles are corrected
    covariance: np.ndarray  # (14, 14) of the state's step, zero where it was fixed
    by_lens: np.ndarray  # (14, 4 + k) derivative of the step

    @property
    def angle_std_rad(self) -> float:
        """Standard deviation of the joint angles' readings relative to the pictures."""
        return float(np.sqrt(self.angle_ratio * self.variance_px2))


class _SweepEquations(NamedTuple):
    """Normal equations A·step = b with the angle errors eliminated; `cost` is the sum of squares at step 0."""

    state: _SweepState
    at: _SweepRows
    blocks: np.ndarray
    A: np.ndarray
    b: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class _SweepProblem:
    """The corners of all pictures of a sweep, concatenated, seen by a camera."""

    camera: Camera
    points_m: np.ndarray  # (N, 3) board frame
    pixels: np.ndarray  # (N, 2)
    picture: np.ndarray  # (N,) index of the picture
    angles_rad: np.ndarray  # (P, 2) readings of pan and tilt of the P pictures, the tilt with its zero
    free: np.ndarray  # (14,) mask of the columns of a step that are solved for

    @staticmethod
    def of(
        camera: Camera,
        views: Sequence[BoardView],
        pictures: Sequence[Still],
        points_m: np.ndarray,
        kinematics: Kinematics,
    ) -> _SweepProblem:
        """The corners of a board (C, 3) detected in every picture, with the joints' readings; all unknowns are free."""
        return _SweepProblem(
            camera,
            np.concatenate([points_m[view.ids] for view in views]),
            np.concatenate([view.corners_px for view in views]),
            np.repeat(np.arange(len(views)), [len(view.ids) for view in views]),
            np.array([[seen.pan_rad, seen.tilt_rad + kinematics.tilt_zero_rad] for seen in pictures]),
            np.ones(_AXES.stop, bool),
        )

    @property
    def axes_fixed(self) -> _SweepProblem:
        """The problem with the axes' skew and offset fixed at the state's."""
        return replace(self, free=np.arange(_AXES.stop) < _AXES.start)

    @property
    def pictures(self) -> int:
        """Number of pictures."""
        return len(self.angles_rad)

    def _blocks(self, at: _SweepRows, weights: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(P, m, m) per-picture products of columns (N, 2, ...), then the residual, then the picture's own angle
        errors."""
        residuals_px, _, by_angles, _ = at
        whole = np.concatenate([columns, residuals_px[..., None], by_angles], axis=-1)
        bounds = np.searchsorted(self.picture, np.arange(self.pictures + 1))
        whole *= np.sqrt(weights)[:, None, None]
        flat = [whole[first:last].reshape(-1, whole.shape[-1]) for first, last in pairwise(bounds)]
        return np.array([block.T @ block for block in flat])

    def _descended(self, state: _SweepState, weights: np.ndarray, angle_ratio: float, rules: Rules) -> _SweepEquations:
        def linearised(state: _SweepState) -> _SweepEquations:
            at = _linearise(self, state)
            blocks = self._blocks(at, weights, at[1][..., self.free])
            whole = _without_angles(blocks, angle_ratio)
            return _SweepEquations(state, at, blocks, whole[:-1, :-1], whole[:-1, -1], float(whole[-1, -1]))

        def step(system: _SweepEquations, damping: float) -> tuple[np.ndarray, float]:
            move = solve_scaled(system.A, system.b, damping)
            return move, float(system.b @ move)

        def moved(system: _SweepEquations, move: np.ndarray) -> _SweepEquations:
            whole = np.zeros(_AXES.stop)
            whole[self.free] = move
            return linearised(system.state.moved(whole))

        return levenberg_marquardt(linearised(state), step, moved, rules)[0]

    def robust(self, state: _SweepState, used: np.ndarray) -> tuple[_SweepState, np.ndarray]:
        """A state by iteratively reweighted least absolute distances over the corners used (N,), and all residuals
        (N, 2) px.

        A redescending loss would fit some pictures all but exactly and give up others, where the angles scatter.
        """
        weights = used.astype(float)
        residuals = _linearise(self, state)[0]
        for _ in range(PoseSettings.reweightings):
            distance = np.linalg.norm(residuals, axis=1)
            scale = PoseSettings.soft * max(radial_std(distance[used]), 1e-9)
            before, weights = weights, used * soft_l1_weights(distance, scale)
            system = self._descended(state, weights, 0.0, replace(_RULES, iterations=3))
            state, residuals = system.state, system.at[0]
            if np.abs(weights - before).max() < PoseSettings.weights_change:
                break
        return state, residuals

    def fit(self, state: _SweepState, used: np.ndarray) -> _SweepFit:
        """The minimum over the corners used, a mask (N,), with the scatter of the joint angles (REML)."""
        weights, ratio = used.astype(float), 0.0
        for _ in range(PoseSettings.ratio_rounds):
            system = self._descended(state, weights, ratio, _RULES)
            state, before = system.state, ratio
            ratio = _angle_variance_ratio(system.blocks, 2 * int(used.sum()))
            if abs(ratio - before) <= PoseSettings.ratio_change * before:
                break
        system = self._descended(state, weights, ratio, _RULES)
        (residuals, by_state, by_angles, by_lens), free = system.at, self.free
        count, lens = int(free.sum()), by_lens.shape[-1]
        blocks = self._blocks(system.at, weights, np.concatenate([by_state[..., free], by_lens], axis=-1))
        whole = _without_angles(blocks, ratio)
        A, coupling, cost = whole[:count, :count], whole[:count, count:-1], float(whole[-1, -1])
        variance = max(cost / max(2 * weights.sum() - count, 1.0), PoseSettings.rounding_px**2)
        covariance, of_lens = np.zeros((_AXES.stop, _AXES.stop)), np.zeros((_AXES.stop, lens))
        covariance[np.ix_(free, free)] = variance * solve_scaled(A, np.eye(count))
        of_lens[free] = -solve_scaled(A, coupling)
        if ratio > 0.0:
            shift = np.linalg.solve(blocks[:, -2:, -2:] + np.eye(2) / ratio, blocks[:, -2:, -3, None])[..., 0]
            residuals = residuals - np.einsum("nij,nj->ni", by_angles, shift[self.picture])
        return _SweepFit(system.state, ratio, variance, residuals, covariance, of_lens)

    def inlying(self, state: _SweepState, candidates: np.ndarray) -> tuple[_SweepFit, np.ndarray]:
        """The fit to the candidate corners (N,) without outliers relative to the others' spread, and the mask of its
        corners."""
        used = candidates
        for _ in range(PoseSettings.outlier_rounds):
            found = self.fit(state, used)
            distance = np.linalg.norm(found.residuals_px, axis=1)
            limit = max(PoseSettings.outlier * radial_std(distance[used]), PoseSettings.outlier_px)
            state, before, used = found.state, used, candidates & (distance <= limit)
            if np.array_equal(used, before):
                break
        return found, before


def _without_angles(blocks: np.ndarray, angle_ratio: float) -> np.ndarray:
    """(m − 2, m − 2) sum of the pictures' blocks (P, m, m) with the last two columns, the angle errors,
    marginalised."""
    total = blocks[:, :-2, :-2].sum(axis=0)
    if angle_ratio == 0.0:
        return total
    return schur_complement(total, blocks[:, -2:, :-2], blocks[:, -2:, -2:] + np.eye(2) / angle_ratio)[0]


def _angle_variance_ratio(blocks: np.ndarray, rows: int) -> float:
    """Ratio of the joint angles' variance to the corners', (rad/px)², by REML. blocks : (P, m, m) of free steps,
    residual, angles."""
    freedom = rows - (blocks.shape[-1] - 3)
    angles = blocks[:, -2:, -2:]
    per_angle = float(np.mean(np.trace(angles, axis1=1, axis2=2))) / 2

    def badness(power: float) -> float:
        ratio = 10**power / per_angle
        whole = _without_angles(blocks, ratio)
        A, b = whole[:-1, :-1], whole[:-1, -1]
        square = max(float(whole[-1, -1]) - float(b @ solve_scaled(A, b)), 1e-30)
        shrink = float(np.linalg.slogdet(np.eye(2) + ratio * angles)[1].sum())
        # the determinant of a positive matrix that may be singular to working precision
        diagonal = np.maximum(np.diag(A), 1e-30)
        values = np.linalg.eigvalsh(A / np.sqrt(np.outer(diagonal, diagonal)))
        log_determinant = float(np.log(diagonal).sum() + np.log(np.maximum(values, 1e-15)).sum())
        return shrink + log_determinant + freedom * np.log(square)

    # there may be several minima, and a flat stretch where the angles count as exact
    powers = np.arange(*PoseSettings.ratio_powers)
    best = powers[np.argmin([badness(power) for power in powers])]
    found = _least_between(badness, (best - 1.0, best + 1.0), 1e-5)
    return float(10**found / per_angle) if badness(found) < badness(-np.inf) else 0.0


def _least_between(function: Callable[[float], float], ends: tuple[float, float], tolerance: float) -> float:
    """The place of a function's minimum between two ends, to within `tolerance`, by golden section."""
    shrink = 0.5 * (5.0**0.5 - 1.0)
    low, high = ends
    left, right = high - shrink * (high - low), low + shrink * (high - low)
    at_left, at_right = function(left), function(right)
    while high - low > tolerance:
        if at_left <= at_right:
            high, right, at_right = right, left, at_left
            left = high - shrink * (high - low)
            at_left = function(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + shrink * (high - low)
            at_right = function(right)
    return left if at_left <= at_right else right


_CROSS = "take a cross at least: the middle, pan to either side, tilt to either side, by 0.1 rad and more"


@dataclass(frozen=True, eq=False)
class SweepSolution:
    """Result of a sweep: the camera's pose, the joints' axes, and the outlier pictures."""

    estimate: PoseEstimate  # the camera's pose in the antenna frame; its covariance holds the tilt zero's
    kinematics: Kinematics  # as given, with the axes as solved
    axes_covariance: np.ndarray  # (3, 3) of skew, offset and tilt zero
    axes_with_pose: np.ndarray  # (3, 6) their covariance with the estimate
    axes_free: bool  # whether the axes were solved without their prior, because the data contradict it
    axis_skew_rad: float  # this and the offset by the pictures alone
    axis_skew_std_rad: float
    axis_offset_m: float
    axis_offset_std_m: float
    T_world_board: Pose
    rms_px: float  # over the corners used, angles corrected
    angle_std_rad: float  # scatter of the joint angles' readings; 0 where they count as exact
    pictures: int  # how many were used
    left_out: tuple[DroppedView, ...]
    loose: InputError | None = None  # why it is too uncertain to be used alone

    @staticmethod
    def why_none(views: Sequence[BoardView], nominal_m: np.ndarray) -> InputError | None:
        """The error that refuses a sweep in which too few pictures show the board of corners (C, 3)."""
        count = len(usable_views(views, nominal_m, 0)[0])
        if count >= PoseSettings.fewest_pictures:
            return None
        least = PoseSettings.fewest_pictures
        what = f"{count} pictures of the sweep show the board's markers, at least {least} are needed"
        return InputError(what, remedy=f"{_CROSS}; the board so near that a marker's modules are 2 px wide")


def solve_sweep(
    views: Sequence[BoardView],
    pictures: Sequence[Still],
    board: BoardShape,
    camera: Camera,
    kinematics: Kinematics,
    tilt_zero_std_rad: float,
) -> SweepSolution:
    """The camera's pose in the antenna frame from a sweep.

    views : the board in each picture. pictures : the joints' readings, in the same order.
    kinematics : how the antenna is mounted; its skew and offset are priors, as wide as `PoseSettings` says, unless the
        pictures contradict them (5 % level).

    Raises InputError for too few usable pictures, a joint that did not move or both too little, angles that do not
    belong to the pictures, or another picture size; SolveError when hardly any corners are those of the board.
    """
    seen, readings, dropped = _usable_pictures(views, pictures, board.nominal_m, camera)
    _refuse_one_joint(readings)
    problem, zero = _SweepProblem.of(camera, seen, readings, board.points_m, kinematics), kinematics.tilt_zero_rad
    state, kept, error_px = _consistent_pictures(problem, _initial_state(problem, kinematics))
    _refuse_one_joint([reading for reading, good in zip(readings, kept, strict=True) if good])
    free, used = problem.inlying(state, kept[problem.picture])
    chosen = _with_axes_prior(problem, free, used, kinematics)
    loose = _loose(chosen)
    left_out = [
        DroppedView(view.name, _left_out_reason(problem, chosen.state, index, error_px[index], zero))
        for index, view in enumerate(seen)
        if not kept[index]
    ]
    estimate, with_pose = _estimate(chosen, kinematics.T_actuator_antenna, tilt_zero_std_rad)
    state, measured = chosen.state, free.state
    axes = np.diag([0.0, 0.0, tilt_zero_std_rad**2])
    axes[:2, :2] = chosen.covariance[_AXES, _AXES]
    skew_std, offset_std = np.sqrt(np.diag(free.covariance[_AXES, _AXES]))
    return SweepSolution(
        estimate=estimate,
        kinematics=replace(kinematics, axis_skew_rad=state.axis_skew_rad, axis_offset_m=state.axis_offset_m),
        axes_covariance=axes,
        axes_with_pose=with_pose,
        axes_free=chosen is free,
        axis_skew_rad=measured.axis_skew_rad,
        axis_skew_std_rad=float(skew_std),
        axis_offset_m=measured.axis_offset_m,
        axis_offset_std_m=float(offset_std),
        T_world_board=Pose(np.eye(3), kinematics.position_world_m) @ state.T_foot_board,
        rms_px=float(np.sqrt(np.mean(np.sum(chosen.residuals_px[used] ** 2, axis=1)))),
        angle_std_rad=chosen.angle_std_rad,
        pictures=int(kept.sum()),
        left_out=(*dropped, *left_out),
        loose=loose,
    )


def _usable_pictures(
    views: Sequence[BoardView], pictures: Sequence[Still], nominal_m: np.ndarray, camera: Camera
) -> tuple[list[BoardView], list[Still], list[DroppedView]]:
    """Splits the views into those that determine the board's pose, with their readings, and the others with the
    reason."""
    for view in views:
        require_size(view.image_size, camera, view.name)
    if error := SweepSolution.why_none(views, nominal_m):
        raise error
    usable, dropped = usable_views(views, nominal_m, 0)
    readings = {id(view): reading for view, reading in zip(views, pictures, strict=True)}
    return usable, [readings[id(view)] for view in usable], dropped


def _refuse_one_joint(readings: Sequence[Still]) -> None:
    spans = np.ptp([[reading.pan_rad, reading.tilt_rad] for reading in readings], axis=0)
    if (spans < PoseSettings.least_turn_rad).all():
        raise InputError("neither joint moved in the pictures of the sweep", remedy=_CROSS)
    if (spans < PoseSettings.least_turn_rad).any():
        moved, fixed = ("tilt", "pan") if spans[0] < spans[1] else ("pan", "tilt")
        raise InputError(
            f"only the {moved} moved in the sweep: the camera's turn about the {moved} axis and its place along it "
            "stay open",
            remedy=f"add pictures with the {fixed} turned by 0.1 rad and more",
        )


def _consistent_pictures(problem: _SweepProblem, state: _SweepState) -> tuple[_SweepState, np.ndarray, np.ndarray]:
    """A robust state, the mask (P,) of pictures that it explains, and the median residual (P,) px of each. Raises
    InputError when the angles fit hardly more than half of the pictures, or when one row is wrong but which one is
    ambiguous."""
    # the better of the two in which the board is tilted to one side or the other
    fixed, every = problem.axes_fixed, np.ones(len(problem.pixels), bool)
    first = fixed.robust(state, every)
    both = (first, fixed.robust(_turned_over(first[0], problem), every))
    state = min(both, key=lambda one: float(np.linalg.norm(one[1], axis=1).sum()))[0]
    kept = np.ones(problem.pictures, bool)
    for _ in range(PoseSettings.picture_rounds):
        state, residuals = problem.robust(state, kept[problem.picture])
        error = _picture_errors_px(residuals, problem)
        limit_px = max(PoseSettings.gross_picture * float(np.median(error[kept])), PoseSettings.gross_picture_px)
        before, kept = kept, error <= limit_px
        if np.array_equal(kept, before):
            break
    here = state
    for _ in range(PoseSettings.picture_rounds):
        if kept.all():
            break
        found, _ = problem.inlying(here, kept[problem.picture])
        own = [_own_angles(problem, found.state, index) for index in np.flatnonzero(~kept).tolist()]
        back = kept.copy()
        back[~kept] = (
            np.abs(own - problem.angles_rad[~kept]).max(axis=1) <= PoseSettings.gross_angle * found.angle_std_rad
        )
        if np.array_equal(back, kept):
            break
        here, kept = found.state, back
    if PoseSettings.fewest_pictures <= kept.sum() <= PoseSettings.few_pictures:
        state, kept = _without_wrong_row(problem, state, kept)
    if kept.sum() < max(PoseSettings.fewest_pictures, PoseSettings.explained * problem.pictures):
        what = f"the angles of sweep.csv explain {kept.sum()} of {problem.pictures} pictures, too few"
        raise InputError(
            what, remedy="look the rows through; the board must not move, the joints be at rest, the angles in radians"
        )
    return state, kept, _picture_errors_px(_linearise(problem, state)[0], problem)


def _picture_errors_px(residuals: np.ndarray, problem: _SweepProblem) -> np.ndarray:
    distance = np.linalg.norm(residuals, axis=1)
    return np.array([np.median(distance[problem.picture == index]) for index in range(problem.pictures)])


def _without_wrong_row(problem: _SweepProblem, state: _SweepState, kept: np.ndarray) -> tuple[_SweepState, np.ndarray]:
    """The state and the mask of kept pictures without the one wrong row that, among few pictures, biases the fit so
    that all deviate a little."""
    picture = problem.picture
    whole, _ = problem.inlying(state, kept[picture])
    if whole.angle_std_rad < PoseSettings.wrong_row_rad:
        return whole.state, kept
    places = np.arange(problem.pictures)
    others = [kept & (places != index) for index in np.flatnonzero(kept)]
    fits = [problem.inlying(state, some[picture])[0] for some in others]
    agree = [i for i, found in enumerate(fits) if found.angle_std_rad < PoseSettings.agreement * whole.angle_std_rad]
    if len(agree) > 1:
        raise InputError(
            f"one row of sweep.csv is off by {whole.angle_std_rad:.2g} rad or more, and nothing shows which",
            remedy="check the rows, or take a few more pictures",
        )
    return (fits[agree[0]].state, others[agree[0]]) if agree else (whole.state, kept)


def _own_angles(problem: _SweepProblem, state: _SweepState, picture: int) -> np.ndarray:
    """(2,) pan and tilt at which one picture's corners fit a state best; NaN where no nearby angles fit."""
    angles, mine = problem.angles_rad[picture], problem.picture == picture
    own = {"points_m": problem.points_m[mine], "pixels": problem.pixels[mine]}
    alone = replace(problem, picture=np.zeros(int(mine.sum()), int), **own)
    for _ in range(PoseSettings.own_steps):
        residuals_px, _, by_angles, _ = _linearise(replace(alone, angles_rad=angles[None]), state)
        step = np.linalg.lstsq(by_angles.reshape(-1, 2), residuals_px.ravel(), rcond=None)[0]
        angles = angles + np.clip(step, -PoseSettings.own_step_rad, PoseSettings.own_step_rad)
    error = float(np.median(np.linalg.norm(residuals_px, axis=1)))
    return angles if error < PoseSettings.own_fit_px else np.full(2, np.nan)


def _left_out_reason(problem: _SweepProblem, state: _SweepState, index: int, error_px: float, zero_rad: float) -> str:
    what = f"its corners lie {error_px:.1f} px from where its angles put them"
    angles = _own_angles(problem, state, index)
    if np.isnan(angles).any():
        return f"{what}; did the board or the camera move?"
    (pan, tilt), (read_pan, read_tilt) = angles - [0, zero_rad], problem.angles_rad[index] - [0, zero_rad]
    return f"{what}: it looks like pan {pan:.3f}, tilt {tilt:.3f}, its row says {read_pan:.3f}, {read_tilt:.3f}"


def _with_axes_prior(problem: _SweepProblem, free: _SweepFit, used: np.ndarray, kinematics: Kinematics) -> _SweepFit:
    """The fit with a prior of the axes about session.yaml's, unless the data contradict it."""
    nominal = np.array([kinematics.axis_skew_rad, kinematics.axis_offset_m])
    off = nominal - [free.state.axis_skew_rad, free.state.axis_offset_m]
    spread = free.covariance[_AXES, _AXES] + np.diag(
        np.square([PoseSettings.axis_skew_std_rad, PoseSettings.axis_offset_std_m])
    )
    if chi_square_p(chi_square(off, spread), 2) < PoseSettings.axes_contradicted:
        return free
    gain = free.covariance[:, _AXES] @ np.linalg.inv(spread)
    skew, offset = nominal - off + (gain @ off)[_AXES]
    fixed = problem.axes_fixed.fit(replace(free.state, axis_skew_rad=skew, axis_offset_m=offset), used)
    # Joseph's form: no difference of covariances
    complement = np.eye(len(gain))
    known = np.diag(np.square([PoseSettings.axis_skew_std_rad, PoseSettings.axis_offset_std_m]))
    complement[:, _AXES] -= gain
    covariance = complement @ free.covariance @ complement.T + gain @ known @ gain.T
    return replace(fixed, covariance=covariance, by_lens=free.by_lens - gain @ free.by_lens[_AXES])


def _loose(found: _SweepFit) -> InputError | None:
    """The error that refuses a fit as too uncertain where no other method gives the camera's pose."""
    if found.angle_std_rad > PoseSettings.loose_angles_rad:
        raise InputError(
            f"the angles of sweep.csv scatter by {found.angle_std_rad:.2g} rad about what the pictures show",
            remedy="take every picture with the joints at rest, the board fixed and the angles in radians",
        )
    of_camera = found.covariance[_CAMERA, _CAMERA]
    turn, place = (float(largest_std(part)) for part in (of_camera[:3, :3], of_camera[3:, 3:]))
    reach = float(np.linalg.norm(found.state.T_actuator_camera.translation_m - found.state.T_foot_board.translation_m))
    if turn > PoseSettings.loose_rad or place > PoseSettings.loose_share * reach:
        what = f"the sweep leaves the camera's pose open to {turn:.2g} rad and {1e3 * place:.2g} mm"
        return InputError(
            what, remedy="turn pan and tilt further, each by itself, with the board large in the pictures"
        )
    return None


def _estimate(found: _SweepFit, T_actuator_antenna: Pose, tilt_zero_std_rad: float) -> tuple[PoseEstimate, np.ndarray]:
    """The camera's pose in the antenna frame, and its covariance (3, 6) with skew, offset and the tilt's zero."""
    T_actuator_camera = found.state.T_actuator_camera
    to_antenna = np.kron(np.eye(2), T_actuator_antenna.rotation.T)
    # another zero of the tilt turns the camera about the tilt axis
    tilt_axis = np.array([0.0, 1.0, 0.0])
    by_zero = to_antenna @ np.concatenate([tilt_axis, np.cross(tilt_axis, T_actuator_camera.translation_m)])
    estimate = PoseEstimate(
        "sweep",
        T_actuator_antenna.inverse() @ T_actuator_camera,
        to_antenna @ found.covariance[_CAMERA, _CAMERA] @ to_antenna.T
        + tilt_zero_std_rad**2 * np.outer(by_zero, by_zero),
        to_antenna @ found.by_lens[_CAMERA],
    )
    of_axes = found.covariance[_AXES, _CAMERA] @ to_antenna.T
    return estimate, np.vstack([of_axes, tilt_zero_std_rad**2 * by_zero])
