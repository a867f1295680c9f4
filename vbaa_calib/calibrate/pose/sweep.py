"""Plane C by the actuator sweep: both joints move camera and antenna in front of a board that is fixed in the world.

Pan alone determines one line in the camera frame, the pan axis: the camera's turn about it and its place along it stay
open, for the unknown board can follow both. Tilt alone leaves the same open for the tilt axis. Two lines that are not
parallel leave nothing open: their common perpendicular is the actuator frame's x, its foot on the tilt axis the origin;
their angle and distance are the joints' skew and offset. The least motion is a cross.

Not observable:
- The zero of the pan: turning world and board together about the pan axis changes neither pictures nor camera pose.
- The zero of the tilt: another one turns the camera about the tilt axis and changes no picture. It is in the
  covariance; another method, fused with this one, finds it.
- The sense of a joint: with all its angles negated, a camera half a turn away fits as well. Another method shows it.
- Where the antenna is on the attachment: T_actuator_antenna of the session counts as exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.outliers import DroppedView, usable_views
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.robust import chi_square, chi_square_p
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.geometry.independent_axes import largest_std
from vbaa_calib.session import SweepPicture

from .board_pose import require_size
from .fusion import PoseEstimate
from .sweep_fit import (
    AXES,
    CAMERA,
    SweepCorners,
    SweepFit,
    SweepProblem,
    SweepState,
    initial_state,
    linearise,
    turned_over,
)

_LEAST_PICTURES = 5
"""A cross. Three fix the pose, but fewer than five do not determine the scatter of the readings: with four, and
0.3 mrad, 14 of 120 sweeps were off by over six of their standard deviations."""

_LEAST_TURN_RAD = 0.01
_GROSS_PICTURE, _GROSS_LEAST_PX, _GROSS_ANGLE, _ROUNDS = 5.0, 0.5, 5.0, 6
_FEW_PICTURES, _AGREE = 8, 0.1
_NO_ENCODER_RAD = 5e-3  # joints at rest scatter less: such a misfit is one wrong row's
_OWN_STEPS, _OWN_STEP_RAD, _OWN_FIT_PX = 20, 0.2, 5.0
_CROSS = "take a cross at least: the middle, pan to either side, tilt to either side, by 0.1 rad and more"
_MEND = "look the rows through; the board must not move, the joints be at rest, the angles in radians"
_AXIS_SKEW_STD_RAD = 5e-3
_AXIS_OFFSET_STD_M = 5e-4
"""Prior of skew and offset about the given ones, as a careful workshop keeps them. Fixed there, errors of 0.3 mrad and
0.02 mm, which a good sweep hardly sees, put the camera seven of its standard deviations off."""
_CONTRADICTED = 0.05
_LOOSE_RAD, _LOOSE_SHARE, _LOOSE_ANGLES_RAD = 0.02, 0.05, 0.02


@dataclass(frozen=True, eq=False)
class SweepSolution:
    """The result of a sweep."""

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


def solve_sweep(
    views: Sequence[BoardView],
    pictures: Sequence[SweepPicture],
    board: BoardShape,
    camera: Camera,
    kinematics: Kinematics,
    tilt_zero_std_rad: float,
) -> SweepSolution:
    """The camera's pose in the antenna frame from a sweep.

    views : the board in each picture. pictures : the joints' readings, in the same order.
    kinematics : how the antenna is mounted; its skew and offset are priors, with _AXIS_SKEW_STD_RAD and
        _AXIS_OFFSET_STD_M, unless the pictures contradict them (5 % level).

    Raises InputError for too few usable pictures, a joint that did not move or both too little, angles that do not
    belong to the pictures, or another picture size; SolveError when hardly any corners are those of the board.
    """
    seen, readings, dropped = _usable_pictures(views, pictures, board.nominal_m, camera)
    _refuse_one_joint(readings)
    corners = SweepCorners.of(seen, readings, board.points_m, kinematics)
    problem, zero = SweepProblem.of(camera, corners), kinematics.tilt_zero_rad
    state, kept, error_px = _consistent_pictures(problem, initial_state(camera, corners, kinematics))
    _refuse_one_joint([reading for reading, good in zip(readings, kept, strict=True) if good])
    free, used = problem.inlying(state, kept[corners.picture])
    chosen = _with_axes_prior(problem, free, used, kinematics)
    _refuse_loose(chosen)
    left_out = [
        DroppedView(view.name, _left_out_reason(problem, chosen.state, index, error_px[index], zero))
        for index, view in enumerate(seen)
        if not kept[index]
    ]
    estimate, with_pose = _estimate(chosen, kinematics.T_actuator_antenna, tilt_zero_std_rad)
    state, measured = chosen.state, free.state
    skew_std, offset_std = np.sqrt(np.diag(free.covariance[AXES, AXES]))
    return SweepSolution(
        estimate=estimate,
        kinematics=replace(kinematics, axis_skew_rad=state.axis_skew_rad, axis_offset_m=state.axis_offset_m),
        axes_covariance=block_diag(chosen.covariance[AXES, AXES], tilt_zero_std_rad**2),
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
    )


def _usable_pictures(
    views: Sequence[BoardView], pictures: Sequence[SweepPicture], nominal_m: np.ndarray, camera: Camera
) -> tuple[list[BoardView], list[SweepPicture], list[DroppedView]]:
    """Views that fix the board's pose, their readings, and the others with the reason."""
    for view in views:
        require_size(view.image_size, camera, view.name)
    usable, dropped = usable_views(views, nominal_m, 0)
    if len(usable) < _LEAST_PICTURES:
        what = f"{len(usable)} pictures of the sweep show the board, at least {_LEAST_PICTURES} are needed"
        raise InputError(what, remedy=_CROSS)
    readings = {id(view): reading for view, reading in zip(views, pictures, strict=True)}
    return usable, [readings[id(view)] for view in usable], dropped


def _refuse_one_joint(readings: Sequence[SweepPicture]) -> None:
    spans = np.ptp([[reading.pan_rad, reading.tilt_rad] for reading in readings], axis=0)
    if (spans < _LEAST_TURN_RAD).all():
        raise InputError("neither joint moved in the pictures of the sweep", remedy=_CROSS)
    if (spans < _LEAST_TURN_RAD).any():
        moved, still = ("tilt", "pan") if spans[0] < spans[1] else ("pan", "tilt")
        raise InputError(
            f"only the {moved} moved in the sweep: the camera's turn about the {moved} axis and its place along it "
            "stay open",
            remedy=f"add pictures with the {still} turned by 0.1 rad and more",
        )


def _consistent_pictures(problem: SweepProblem, state: SweepState) -> tuple[SweepState, np.ndarray, np.ndarray]:
    """A robust state, which pictures it explains (P,) bool, and the median error of each (P,) px. Raises InputError
    when the angles belong to hardly more than half of the pictures, or one row is wrong and which is ambiguous."""
    corners = problem.corners
    # the better of the two in which the board leans to one side or the other
    fixed, every = SweepProblem.of(problem.camera, corners, axes=False), np.ones(len(corners.pixels), bool)
    first = fixed.robust(state, every)
    both = (first, fixed.robust(turned_over(first[0], corners), every))
    state = min(both, key=lambda one: float(np.linalg.norm(one[1], axis=1).sum()))[0]
    kept = np.ones(corners.pictures, bool)
    for _ in range(_ROUNDS):
        state, residuals = problem.robust(state, kept[corners.picture])
        error = _picture_errors_px(residuals, corners)
        before, kept = kept, error <= max(_GROSS_PICTURE * float(np.median(error[kept])), _GROSS_LEAST_PX)
        if np.array_equal(kept, before):
            break
    here = state
    for _ in range(_ROUNDS):
        if kept.all():
            break
        found, _ = problem.inlying(here, kept[corners.picture])
        own = [_own_angles(problem, found.state, index) for index in np.flatnonzero(~kept).tolist()]
        back = kept.copy()
        back[~kept] = np.abs(own - corners.angles_rad[~kept]).max(axis=1) <= _GROSS_ANGLE * found.angle_std_rad
        if np.array_equal(back, kept):
            break
        here, kept = found.state, back
    if _LEAST_PICTURES <= kept.sum() <= _FEW_PICTURES:
        state, kept = _without_the_odd_one(problem, state, kept)
    if kept.sum() < max(_LEAST_PICTURES, 0.6 * corners.pictures):
        what = f"the angles of sweep.csv explain {kept.sum()} of {corners.pictures} pictures, too few"
        raise InputError(what, remedy=_MEND)
    return state, kept, _picture_errors_px(linearise(problem.camera, state, corners).residuals_px, corners)


def _picture_errors_px(residuals: np.ndarray, corners: SweepCorners) -> np.ndarray:
    distance = np.linalg.norm(residuals, axis=1)
    return np.array([np.median(distance[corners.picture == index]) for index in range(corners.pictures)])


def _without_the_odd_one(problem: SweepProblem, state: SweepState, kept: np.ndarray) -> tuple[SweepState, np.ndarray]:
    """Without the one wrong row that, among few pictures, bends the fit so that all seem a little off."""
    picture = problem.corners.picture
    whole, _ = problem.inlying(state, kept[picture])
    if whole.angle_std_rad < _NO_ENCODER_RAD:
        return whole.state, kept
    places = np.arange(problem.corners.pictures)
    others = [kept & (places != index) for index in np.flatnonzero(kept)]
    fits = [problem.inlying(state, some[picture])[0] for some in others]
    agree = [i for i, found in enumerate(fits) if found.angle_std_rad < _AGREE * whole.angle_std_rad]
    if len(agree) > 1:
        raise InputError(
            f"one row of sweep.csv is off by {whole.angle_std_rad:.2g} rad or more, and nothing shows which",
            remedy="check the rows, or take a few more pictures",
        )
    return (fits[agree[0]].state, others[agree[0]]) if agree else (whole.state, kept)


def _own_angles(problem: SweepProblem, state: SweepState, picture: int) -> np.ndarray:
    """(2,) pan and tilt at which one picture's corners would fit a state best; NaN where no angles near by do."""
    corners, angles = problem.corners, problem.corners.angles_rad[picture]
    mine = corners.picture == picture
    alone = SweepCorners(corners.points_m[mine], corners.pixels[mine], np.zeros(int(mine.sum()), int), angles[None])
    for _ in range(_OWN_STEPS):
        moved = linearise(problem.camera, state, replace(alone, angles_rad=angles[None]))
        step = np.linalg.lstsq(moved.by_angles.reshape(-1, 2), moved.residuals_px.ravel(), rcond=None)[0]
        angles = angles + np.clip(step, -_OWN_STEP_RAD, _OWN_STEP_RAD)
    error = float(np.median(np.linalg.norm(moved.residuals_px, axis=1)))
    return angles if error < _OWN_FIT_PX else np.full(2, np.nan)


def _left_out_reason(problem: SweepProblem, state: SweepState, index: int, error_px: float, zero_rad: float) -> str:
    what = f"its corners lie {error_px:.1f} px from where its angles put them"
    angles = _own_angles(problem, state, index)
    if np.isnan(angles).any():
        return f"{what}; did the board or the camera move?"
    (pan, tilt), (said_pan, said_tilt) = angles - [0, zero_rad], problem.corners.angles_rad[index] - [0, zero_rad]
    return f"{what}: it looks like pan {pan:.3f}, tilt {tilt:.3f}, its row says {said_pan:.3f}, {said_tilt:.3f}"


def _with_axes_prior(problem: SweepProblem, free: SweepFit, used: np.ndarray, kinematics: Kinematics) -> SweepFit:
    """The fit with a prior on the axes where they were given, unless the data contradict it."""
    given = np.array([kinematics.axis_skew_rad, kinematics.axis_offset_m])
    off = given - [free.state.axis_skew_rad, free.state.axis_offset_m]
    spread = free.covariance[AXES, AXES] + np.diag(np.square([_AXIS_SKEW_STD_RAD, _AXIS_OFFSET_STD_M]))
    if chi_square_p(chi_square(off, spread), 2) < _CONTRADICTED:
        return free
    gain = free.covariance[:, AXES] @ np.linalg.inv(spread)
    skew, offset = given - off + (gain @ off)[AXES]
    held = SweepProblem.of(problem.camera, problem.corners, axes=False).fit(
        replace(free.state, axis_skew_rad=skew, axis_offset_m=offset), used
    )
    # Joseph's form: no difference of covariances
    left, known = np.eye(len(gain)), np.diag(np.square([_AXIS_SKEW_STD_RAD, _AXIS_OFFSET_STD_M]))
    left[:, AXES] -= gain
    covariance = left @ free.covariance @ left.T + gain @ known @ gain.T
    return replace(held, covariance=covariance, by_lens=free.by_lens - gain @ free.by_lens[AXES])


def _refuse_loose(found: SweepFit) -> None:
    if found.angle_std_rad > _LOOSE_ANGLES_RAD:
        raise InputError(
            f"the angles of sweep.csv scatter by {found.angle_std_rad:.2g} rad about what the pictures show",
            remedy="take every picture with the joints at rest, the board fixed and the angles in radians",
        )
    of_camera = found.covariance[CAMERA, CAMERA]
    turn, place = (float(largest_std(part)) for part in (of_camera[:3, :3], of_camera[3:, 3:]))
    reach = float(np.linalg.norm(found.state.T_actuator_camera.translation_m - found.state.T_foot_board.translation_m))
    if turn > _LOOSE_RAD or place > _LOOSE_SHARE * reach:
        raise InputError(
            f"the sweep leaves the camera's pose open to {turn:.2g} rad and {1e3 * place:.2g} mm",
            remedy="turn pan and tilt further, each by itself, with the board large in the pictures",
        )


def _estimate(found: SweepFit, T_actuator_antenna: Pose, tilt_zero_std_rad: float) -> tuple[PoseEstimate, np.ndarray]:
    """The camera in the antenna frame, and its covariance (3, 6) with skew, offset and the tilt's zero."""
    T_actuator_camera = found.state.T_actuator_camera
    to_antenna = np.kron(np.eye(2), T_actuator_antenna.rotation.T)
    # another zero of the tilt turns the camera about the tilt axis
    tilt_axis = np.array([0.0, 1.0, 0.0])
    by_zero = to_antenna @ np.concatenate([tilt_axis, np.cross(tilt_axis, T_actuator_camera.translation_m)])
    estimate = PoseEstimate(
        "sweep",
        T_actuator_antenna.inverse() @ T_actuator_camera,
        to_antenna @ found.covariance[CAMERA, CAMERA] @ to_antenna.T
        + tilt_zero_std_rad**2 * np.outer(by_zero, by_zero),
        to_antenna @ found.by_lens[CAMERA],
    )
    of_axes = found.covariance[AXES, CAMERA] @ to_antenna.T
    return estimate, np.vstack([of_axes, tilt_zero_std_rad**2 * by_zero])
