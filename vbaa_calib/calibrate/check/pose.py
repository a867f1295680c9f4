"""The camera's pose against the antenna, from the board in the jig, compared with the rig's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.board_flex import Bend
from vbaa_calib.calibrate.pose.board_pose import AMBIGUOUS, jig_estimate, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.core.robust import chi_square
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, Rig

from .change import joint_covariance
from .finding import HOLDS, LOOK, Evidence, Finding, judged

_FLOOR_MM = 0.1
"""A board taken out of its jig and put back lies within this, and a point on plane C moves with it."""
_ALONG_SIGHT = 0.97
_POSE, _LENS = slice(0, len(POSE_PARAMETERS)), slice(len(RIG_PARAMETERS), None)


@dataclass(frozen=True, eq=False)
class PoseCheck:
    """The camera's present pose against the rig's.

    jig : T_antenna_camera from the board in the jig, with its covariance, the lens apart.
    step : (6,) from the rig's pose, `Pose.retract`'s tangent. covariance : (6, 6) of the predicted difference.
    on_plane_mm : largest apparent displacement of the antenna's axis on plane C. rms_px : reprojection error.
    along_sight : cosine between the camera's motion and its line of sight to the board.
    second_ratio : the error of the second pose that a plane allows, over that of this one; None without.
    """

    jig: PoseEstimate
    step: np.ndarray
    covariance: np.ndarray
    on_plane_mm: float
    along_sight: float
    rms_px: float
    second_ratio: float | None

    def to_dict(self) -> dict[str, Any]:
        """For check.json."""
        std = np.sqrt(np.diag(self.covariance))
        return {
            "turn_mrad": (1e3 * self.step[:3]).tolist(),
            "turn_std_mrad": (1e3 * std[:3]).tolist(),
            "shift_mm": (1e3 * self.step[3:]).tolist(),
            "shift_std_mm": (1e3 * std[3:]).tolist(),
            "on_plane_mm": self.on_plane_mm,
            "rms_px": self.rms_px,
            "second_ratio": self.second_ratio,
            "T_antenna_camera": self.jig.T_antenna_camera.to_dict(),
        }


def check_pose(
    rig: Rig, views: Sequence[BoardView], spec: BoardSpec, T_antenna_board: Pose, bent: Bend | None
) -> PoseCheck:
    """The camera's pose from the board in the jig against the rig's.

    Raises InputError for pictures of another size or without a usable board, SolveError where no pose explains it.
    """
    board = solve_board_pose(views, spec, rig.camera, bent)
    jig = jig_estimate(board, T_antenna_board)
    joint, by_lens = joint_covariance(rig), jig.lens_sensitivity
    shared = by_lens @ joint[_LENS, _POSE]
    covariance = jig.covariance + by_lens @ joint[_LENS, _LENS] @ by_lens.T
    sight = jig.T_antenna_camera.rotation @ (board.T_camera_board @ corner_points(spec).mean(axis=0))
    step = jig.T_antenna_camera.tangent_from(rig.T_antenna_camera)
    shift = float(np.linalg.norm(step[3:]))
    return PoseCheck(
        jig,
        step,
        covariance + joint[_POSE, _POSE] - shared - shared.T,
        1e3 * _on_plane_m(rig, jig.T_antenna_camera),
        abs(float(step[3:] @ sight)) / max(shift * float(np.linalg.norm(sight)), 1e-15),
        board.rms_px,
        board.second_ratio,
    )


def pose_finding(check: PoseCheck, lens_holds: bool) -> Finding:
    """Whether the camera has moved, and along which direction."""
    std = 1e3 * np.sqrt(np.diag(check.covariance))
    turn, shift = 1e3 * np.linalg.norm(check.step[:3]), 1e3 * np.linalg.norm(check.step[3:])
    words = (
        f"the board in the jig puts the camera {shift:.2f} mm (± {np.linalg.norm(std[3:]):.2f}) and {turn:.2f} mrad "
        f"(± {np.linalg.norm(std[:3]):.2f}) from the rig's pose; {check.on_plane_mm:.2f} mm on plane C"
    )
    remedy = "tighten the camera's mount, check that the board sits in its jig, then calibrate again: `vbaa calibrate`"
    if check.along_sight > _ALONG_SIGHT:
        remedy = "it moved along its line of sight, which a refocus looks like, too: check the focus, then " + remedy
    if not lens_holds:
        remedy = "mend the lens first: the rest may come from it. Then " + remedy
    distance_std = float(np.sqrt(chi_square(check.step, check.covariance)))
    evidence = Evidence(distance_std, len(POSE_PARAMETERS), check.on_plane_mm, _FLOOR_MM, "mm on plane C")
    finding = judged("camera_pose", words, remedy, evidence)
    if finding.level == HOLDS and check.second_ratio is not None and check.second_ratio < AMBIGUOUS:
        why = "the board in the jig has a second pose that fits nearly as well: take it from a steeper angle"
        return replace(finding, level=LOOK, remedy=why)
    return finding


def with_jig_pose(rig: Rig, jig: PoseEstimate) -> Rig:
    """The rig with the camera where the board in the jig puts it."""
    joint = joint_covariance(rig).copy()
    shared = jig.lens_sensitivity @ joint[_LENS, _LENS]
    joint[_POSE], joint[:, _POSE] = 0.0, 0.0
    joint[_POSE, _POSE] = jig.covariance + shared @ jig.lens_sensitivity.T
    joint[_POSE, _LENS], joint[_LENS, _POSE] = shared, shared.T
    return replace(rig, T_antenna_camera=jig.T_antenna_camera, covariance=joint)


def _on_plane_m(rig: Rig, T_antenna_camera: Pose) -> float:
    """Largest distance of the antenna's axis from itself on plane C, seen from this pose and read with the rig's."""
    axis = rig.antenna.length_m * np.linspace(0.0, 1.0, 9)[:, None] * np.array([1.0, 0.0, 0.0])
    pixels, seen = rig.camera.project(T_antenna_camera.inverse() @ axis)
    points, crossed = rig.camera_on_plane().project(pixels)
    off = np.linalg.norm(points - axis[:, :2], axis=1)[seen & crossed]
    # an axis that the moved camera does not see at all has moved by more than its length
    return float(off.max()) if len(off) else rig.antenna.length_m
