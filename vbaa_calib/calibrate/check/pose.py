"""Has the camera moved against the antenna? The board in the jig says where the camera is now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.board_flex import Bend
from vbaa_calib.calibrate.pose.board_pose import AMBIGUOUS, jig_estimate, solve_board_pose
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, Rig

from .finding import FAILS, HOLDS, LOOK, Evidence, Finding, joint_covariance, judged

POSE_FLOOR_MM = 0.1
"""A board taken out of its jig and put back lies within this, and a point on plane C moves with it."""
_ALONG_SIGHT = 0.97


@dataclass(frozen=True, eq=False)
class PoseEvidence:
    """Where the camera is now, against where the rig has it.

    Attributes
    ----------
    T_antenna_camera : pose of the camera from the jig. covariance : (6, 6) of it, the lens' share included.
    by_lens : (6, P) how it moves with the lens' parameters.
    step : (6,) from the rig's pose, `Pose.retract`'s tangent. step_covariance : (6, 6) of the predicted difference.
    on_plane_mm : how far points of the antenna's axis seem to move on plane C, the largest.
    along_sight : cosine between the camera's motion and its line of sight to the board.
    second_ratio : reprojection error of the other pose that a plane allows, over that of this one; None without.
    """

    T_antenna_camera: Pose
    covariance: np.ndarray
    by_lens: np.ndarray
    step: np.ndarray
    step_covariance: np.ndarray
    on_plane_mm: float
    along_sight: float
    rms_px: float
    second_ratio: float | None

    @property
    def distance_std(self) -> float:
        """Mahalanobis length of the step."""
        std = np.sqrt(np.diag(self.step_covariance))
        scaled = self.step / std
        return float(np.sqrt(scaled @ np.linalg.solve(self.step_covariance / np.outer(std, std), scaled)))

    def to_dict(self) -> dict[str, Any]:
        """For check.json."""
        std = np.sqrt(np.diag(self.step_covariance))
        return {
            "turn_mrad": (1e3 * self.step[:3]).tolist(),
            "turn_std_mrad": (1e3 * std[:3]).tolist(),
            "shift_mm": (1e3 * self.step[3:]).tolist(),
            "shift_std_mm": (1e3 * std[3:]).tolist(),
            "on_plane_mm": self.on_plane_mm,
            "rms_px": self.rms_px,
            "second_ratio": self.second_ratio,
            "T_antenna_camera": self.T_antenna_camera.to_dict(),
        }


def check_pose(
    rig: Rig, views: Sequence[BoardView], spec: BoardSpec, T_antenna_board: Pose, bent: Bend | None
) -> PoseEvidence:
    """The camera's pose from the board in the jig against the rig's.

    Raises InputError for pictures of another size or without a usable board, SolveError where no pose explains it.
    """
    board = solve_board_pose(views, spec, rig.camera, bent)
    now = jig_estimate(board, T_antenna_board)
    pose, by_lens = now.T_antenna_camera, now.lens_sensitivity
    joint, pick, lens = joint_covariance(rig), slice(0, len(POSE_PARAMETERS)), slice(len(RIG_PARAMETERS), None)
    carried = by_lens @ joint[lens, pick]
    of_jig = now.covariance + by_lens @ joint[lens, lens] @ by_lens.T
    sight = pose.rotation @ (board.T_camera_board @ corner_points(spec).mean(axis=0))
    step = pose.tangent_from(rig.T_antenna_camera)
    shift = float(np.linalg.norm(step[3:]))
    return PoseEvidence(
        pose,
        of_jig,
        by_lens,
        step,
        of_jig + joint[pick, pick] - carried - carried.T,
        1e3 * _on_plane_m(rig, pose),
        abs(float(step[3:] @ sight)) / max(shift * float(np.linalg.norm(sight)), 1e-15),
        board.rms_px,
        board.second_ratio,
    )


def pose_finding(found: PoseEvidence, lens_holds: bool) -> Finding:
    """The answer, with what the motion looks like."""
    std = 1e3 * np.sqrt(np.diag(found.step_covariance))
    turn, shift = 1e3 * np.linalg.norm(found.step[:3]), 1e3 * np.linalg.norm(found.step[3:])
    words = (
        f"the jig's board puts the camera {shift:.2f} mm (± {np.linalg.norm(std[3:]):.2f}) and {turn:.2f} mrad "
        f"(± {np.linalg.norm(std[:3]):.2f}) from where the rig has it; {found.on_plane_mm:.2f} mm on plane C"
    )
    remedy = "tighten the camera's mount, check that the board sits in its jig, then calibrate again: `vbaa calibrate`"
    if found.along_sight > _ALONG_SIGHT:
        remedy = "it moved along its line of sight, which a refocus looks like, too: check the focus, then " + remedy
    if not lens_holds:
        remedy = "mend the lens first: the rest may come from it. Then " + remedy
    evidence = Evidence(found.distance_std, len(POSE_PARAMETERS), found.on_plane_mm, POSE_FLOOR_MM, "mm on plane C")
    finding = judged("camera_pose", "Is the camera where it was?", words, remedy, evidence)
    if finding.level == HOLDS and found.second_ratio is not None and found.second_ratio < AMBIGUOUS:
        why = "the board in the jig has a second pose that fits nearly as well: take it from a steeper angle"
        return replace(finding, level=LOOK, remedy=why)
    return finding


def rig_now(rig: Rig, found: PoseEvidence | None, finding: Finding) -> Rig:
    """The rig to hold the antenna against: with the jig's pose where the rig's own is no longer right."""
    if found is None or finding.level not in (LOOK, FAILS):
        return rig
    pick, lens = slice(0, len(POSE_PARAMETERS)), slice(len(RIG_PARAMETERS), None)
    joint = joint_covariance(rig).copy()
    joint[pick] = 0.0
    joint[:, pick] = 0.0
    joint[pick, pick] = found.covariance
    joint[pick, lens] = found.by_lens @ joint[lens, lens]
    joint[lens, pick] = joint[pick, lens].T
    return replace(rig, T_antenna_camera=found.T_antenna_camera, covariance=joint)


def _on_plane_m(rig: Rig, T_antenna_camera: Pose) -> float:
    """How far the antenna's axis, seen by a camera at this pose, is off on plane C by the rig's; the largest."""
    axis = rig.antenna.length_m * np.linspace(0.0, 1.0, 9)[:, None] * np.array([1.0, 0.0, 0.0])
    pixels, seen = rig.camera.project(T_antenna_camera.inverse() @ axis)
    points, crossed = rig.camera_on_plane().project(pixels)
    off = np.linalg.norm(points - axis[:, :2], axis=1)[seen & crossed]
    # an axis that the moved camera does not see at all has moved by more than its length
    return float(off.max()) if len(off) else rig.antenna.length_m
