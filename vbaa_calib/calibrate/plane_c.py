"""Plane C from a session, by every method it has pictures for, and whether they agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from targets.board import BoardWithIds
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.settings import AntennaSettings
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.over_board.over_board import OverSetup, nominal_free_antenna, solve_over_board
from vbaa_calib.calibrate.pose.board_pose import BoardPose, jig_estimate, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import Difference, PoseEstimate, differences, fused, inflated, require_agreement
from vbaa_calib.calibrate.pose.settings import PoseSettings
from vbaa_calib.calibrate.pose.sweep import SweepSolution, solve_sweep
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import Diagnosis, InputError, VbaaError
from vbaa_calib.core.images import list_images, read_gray
from vbaa_calib.detect.board.corners import BoardView, detect_files, detect_folder
from vbaa_calib.detect.over_board.line import LineEnd
from vbaa_calib.diagnose.jig import SLIPS, JigEvidence, jig_diagnoses
from vbaa_calib.geometry import Kinematics
from vbaa_calib.geometry.covariance import conditioned
from vbaa_calib.session import OverBoard, Session, Still, has_over, has_sweep, read_noload, read_sweep


@dataclass(frozen=True, eq=False)
class PlaneC:
    """The camera's pose by every available method, and the difference of every pair of them.

    jig, sweep, over : what each found, None where the session has no pictures for it.
    kinematics : the session's, with what the sweep found of the joints.
    unused : pictures of a method that show too little, where another method shows plane C.
    """

    estimates: tuple[PoseEstimate, ...]
    differences: tuple[Difference, ...]
    jig: BoardPose | None
    sweep: SweepSolution | None
    over: BoardPose | None
    kinematics: Kinematics
    unused: tuple[Diagnosis, ...] = ()

    @property
    def by_antenna_alone(self) -> bool:
        """Whether the frame is defined by the antenna alone, without jig or sweep."""
        return [estimate.way for estimate in self.estimates] == ["over board"]

    @property
    def boards(self) -> dict[str, BoardPose]:
        """The single board poses from which an estimate comes: each may have a second solution that fits nearly as
        well."""
        boards = {"jig": self.jig, "over board": self.over}
        return {way: board for way, board in boards.items() if board is not None}

    def to_dict(self) -> dict[str, Any]:
        """The entry of rig.json."""
        ways = [
            {
                "way": one.way,
                "T_antenna_camera": one.T_antenna_camera.to_dict(),
                "std": np.sqrt(np.diag(one.covariance)).tolist(),
            }
            for one in self.estimates
        ]
        boards = {
            way: {"rms_px": board.rms_px, "second_solution_ratio": board.second_ratio}
            for way, board in self.boards.items()
        }
        numbers = ("rms_px", "pictures", "angle_std_rad", "axes_free")
        axes = ("axis_skew_rad", "axis_skew_std_rad", "axis_offset_m", "axis_offset_std_m")
        sweep = self.sweep and {name: getattr(self.sweep, name) for name in (*numbers, *axes)} | {
            "left_out": [vars(view) for view in self.sweep.left_out],
            "T_world_board": self.sweep.T_world_board.to_dict(),
        }
        apart = [one.to_dict() for one in self.differences]
        return {"ways": ways, "differences": apart, "boards": boards, "sweep": sweep}


def picture_folders(session: Session) -> list[str]:
    """The folders of the session with pictures of plane C. Raises InputError when there are none."""
    has = {"plane": session.T_antenna_board is not None, "sweep": has_sweep(session), "over": has_over(session)}
    folders = [name for name, there in has.items() if there]
    if not folders:
        raise InputError(
            "jig is missing, and nothing else shows where the camera is on the antenna's base",
            where=session.root / "session.yaml",
            remedy="give jig.T_antenna_board, the pose of the board in the jig, or take a sweep/ or over/ "
            "(docs/formats.md)",
        )
    return folders


def read_views(session: Session) -> dict[str, Any]:
    """The session's arguments `jig`, `sweep` and `over` of `find_plane`, with the boards detected. Raises InputError
    where a picture contains none, or another than session.yaml describes."""
    folders, spec = picture_folders(session), session.board
    views: dict[str, Any] = {}
    if "plane" in folders:
        views["jig"] = detect_folder(session.folder("plane"), spec)
    if "sweep" in folders:
        views["sweep"] = detect_files([one.image for one in read_sweep(session) if one.image is not None], spec)
    if "over" in folders:
        views["over"] = {str(path): read_gray(path) for path in list_images(session.root / "over")}
    return views


def find_plane(
    session: Session,
    camera: Camera,
    board: BoardShape,
    jig: Sequence[BoardView] | None = None,
    sweep: Sequence[BoardView] | None = None,
    over: Mapping[str, np.ndarray] | None = None,
) -> PlaneC:
    """Plane C by every method that has pictures.

    board : its shape from the lens's views. jig, sweep : views of the board. over : pictures (H, W) by name.
    Raises InputError where methods contradict each other.
    """
    by_jig = by_sweep = by_over = None
    estimates: list[PoseEstimate] = []
    unused: list[Diagnosis] = []
    if jig is not None and session.T_antenna_board is not None:
        by_jig = solve_board_pose(jig, board, camera)
        std = session.jig_translation_std_m, session.jig_rotation_std_rad
        estimates.append(jig_estimate(by_jig, session.T_antenna_board, *std))
    unused_for, another = None, bool(estimates or over)
    if sweep is not None:
        unused_for = SweepSolution.why_none(sweep, board.nominal_m)
        if not (unused_for and another):
            by_sweep = solve_sweep(
                sweep, read_sweep(session), board, camera, session.kinematics, session.tilt_zero_std_rad
            )
            unused_for = by_sweep.loose
        if unused_for and not another:
            raise unused_for
    if unused_for is not None:
        # another way shows where the camera is
        unused.append(Diagnosis("sweep_unused", f"the sweep was not used: {unused_for.what}", unused_for.remedy or ""))
        by_sweep = None
    elif by_sweep is not None:
        estimates.append(by_sweep.estimate)
    if over is not None and session.over is not None:
        setting = session.over
        rotation = session.kinematics.T_world_antenna(setting.pan_rad, setting.tilt_rad).rotation
        antenna = nominal_free_antenna(session.antenna, rotation.T @ session.gravity_world_m_s2)
        mark = None if setting.clamp_px is None else LineEnd(np.array(setting.clamp_px), setting.clamp_std_px)
        setup = OverSetup(session.board, camera, antenna, setting.height_m, setting.height_std_m, mark)
        try:
            estimate, by_over = solve_over_board(over, setup, fused(estimates) if estimates else None)
        except InputError as error:
            if not estimates:
                what = "; ".join([*(one.words for one in unused), error.what])
                raise InputError(what, remedy=error.remedy) from None
            what = f"the board under the antenna was not used: {error.what}"
            unused.append(Diagnosis("over_unused", what, error.remedy or ""))
        else:
            doubt = _clamp_doubt(estimate, session.over, session.board)
            estimates.append(inflated(estimate, *doubt) if estimates else estimate)
    estimates = [inflated(estimate, *_corner_bias(estimate, camera)) for estimate in estimates]
    # both rulers say which side of a stretched print is right
    unruled = board.scale_doubt if session.board.stretch_std is None else 0.0
    scale_std = float(np.hypot(session.print_scale_std, unruled))
    estimates = [inflated(estimate, *_print_doubt(estimate, session, scale_std), common=True) for estimate in estimates]
    apart = differences(estimates, np.zeros((0, 0)) if camera.covariance is None else camera.covariance)
    _require_agreement(apart, session, camera, by_jig, estimates)
    kinematics = _kinematics(session, by_sweep, estimates)
    return PlaneC(tuple(estimates), tuple(apart), by_jig, by_sweep, by_over, kinematics, tuple(unused))


def _require_agreement(
    apart: Sequence[Difference],
    session: Session,
    camera: Camera,
    jig: BoardPose | None,
    estimates: Sequence[PoseEstimate],
) -> None:
    """Raises InputError where estimates contradict each other, with the likely cause as far as the jig tells it."""
    try:
        require_agreement(apart, session.root)
    except InputError as error:
        evidence = _jig_evidence(session, camera, jig, estimates)
        found = [] if evidence is None else jig_diagnoses(evidence)
        named = [replace(one, words=f"{error.what}: {one.words}") for one in found]
        raise because(error, named, session) from None


def _jig_evidence(
    session: Session, camera: Camera, jig: BoardPose | None, estimates: Sequence[PoseEstimate]
) -> JigEvidence | None:
    """Evidence on whether the jig's pose is as session.yaml states, by all estimates of the camera's pose; None without
    a jig."""
    if jig is None or session.T_antenna_board is None:
        return None
    free: Sequence[Still] = ()
    with suppress(InputError):
        free = read_noload(session)
    return JigEvidence(session, camera, jig, [one for one in estimates if one.way != "jig"], free)


def jig_causes(
    session: Session, camera: Camera, plane: PlaneC, lines: Sequence[Observation] | None = None
) -> list[Diagnosis]:
    """Diagnoses of a jig with a wrong pose, or one that has moved since its picture, from the antenna's place; none
    without a jig.

    lines : of the antenna, with and without loads; None: the free antenna is searched for where each cause puts it.
    """
    evidence = _jig_evidence(session, camera, plane.jig, plane.estimates)
    return [] if evidence is None else jig_diagnoses(replace(evidence, lines=lines))


def is_slip(
    found: Sequence[Diagnosis], session: Session, camera: Camera, plane: PlaneC, lines: Sequence[Observation]
) -> bool:
    """Whether `jig_causes` found a mistake in session.yaml by the free antenna's lines, and gravity of another
    direction, or none, does not explain them as well."""
    evidence = _jig_evidence(session, camera, plane.jig, plane.estimates)
    if evidence is None or not any(one.name in SLIPS for one in found):
        return False
    turned = ([replace(one, gravity_m_s2=by * one.gravity_m_s2) for one in lines] for by in (0.0, -1.0))
    return not any(replace(evidence, lines=some).fits for some in turned)


def because(error: VbaaError, found: Sequence[Diagnosis], session: Session) -> VbaaError:
    """The error itself, or in its place an InputError with the likely cause."""
    if not found:
        return error
    return InputError(found[0].words, where=session.root / "session.yaml", remedy=found[0].remedy)


def _clamp_doubt(found: PoseEstimate, over: OverBoard, board: BoardWithIds) -> tuple[np.ndarray, np.ndarray]:
    """Directions (K, 6) and standard deviations (K,) of the antenna's own frame relative to the frame of jig and
    joints."""
    camera_m = found.T_antenna_camera.translation_m
    turns = np.hstack([np.eye(3), np.cross(np.eye(3), camera_m)])
    across = np.hstack([np.zeros((2, 4)), np.eye(2)])
    half_m = 0.5 * min(board.size_m)
    tilt = over.height_std_m / half_m
    return np.vstack([turns, across]), np.array(
        [tilt, tilt, AntennaSettings.clamp_angle_std_rad, *[AntennaSettings.clamp_offset_std_m] * 2]
    )


def _corner_bias(estimate: PoseEstimate, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Directions (2, 6) and standard deviations (2,) of the pose error due to a common shift of all corners, which is
    a rotation of the camera."""
    turns = np.hstack([estimate.T_antenna_camera.rotation[:, :2].T, np.zeros((2, 3))])
    return turns, PoseSettings.corner_bias_px / np.diag(camera.matrix)[[1, 0]]


def _print_doubt(estimate: PoseEstimate, session: Session, scale_std: float) -> tuple[np.ndarray, np.ndarray]:
    """Direction (1, 6) and standard deviation (1,) of the pose error due to the print's scale, which changes the
    distance."""
    camera_m = estimate.T_antenna_camera.translation_m
    origin_m = np.zeros(3)
    if estimate.way == "jig" and session.T_antenna_board is not None:
        origin_m = session.T_antenna_board.translation_m
    elif estimate.way == "sweep":
        # the sweep sees the camera from the joints' crossing
        origin_m = session.kinematics.T_actuator_antenna.inverse().translation_m
    reach_m = camera_m - origin_m
    return np.concatenate([np.zeros(3), reach_m])[None], np.array([scale_std])


def _kinematics(session: Session, sweep: SweepSolution | None, estimates: Sequence[PoseEstimate]) -> Kinematics:
    """The session's kinematics with axes and tilt zero from the sweep and all estimates, with their uncertainty."""
    if sweep is None:
        return session.kinematics
    swept = next(estimate for estimate in estimates if estimate.way == sweep.estimate.way)
    both = [[swept.covariance, sweep.axes_with_pose.T], [sweep.axes_with_pose, sweep.axes_covariance]]
    by_pose, axes_std = conditioned(np.block(both), len(swept.covariance))
    skew, offset, zero = by_pose @ fused(estimates).tangent_from(swept.T_antenna_camera)
    return replace(
        sweep.kinematics,
        axis_skew_rad=sweep.kinematics.axis_skew_rad + skew,
        axis_offset_m=sweep.kinematics.axis_offset_m + offset,
        tilt_zero_rad=sweep.kinematics.tilt_zero_rad + zero,
        axes_std=axes_std,
        axes_by_pose=by_pose,
    )
