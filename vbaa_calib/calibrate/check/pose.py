"""The camera's pose against the antenna, from the board in the jig, compared with the rig's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from targets.board import corner_points
from vbaa_calib.calibrate.lens.board_flex import Bend
from vbaa_calib.calibrate.pose.board_pose import jig_estimate, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.core.robust import chi_square
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, Rig

from .change import joint_covariance
from .finding import HOLDS, LOOK, Checked, Evidence, judged, not_given
from .inputs import CheckInputs

_FLOOR_MM = 0.1
"""A board taken out of its jig and put back lies within this, and a point on plane C moves with it."""
_ALONG_SIGHT = 0.97
_POSE, _LENS = slice(0, len(POSE_PARAMETERS)), slice(len(RIG_PARAMETERS), None)


def check_pose(
    rig: Rig, views: Sequence[BoardView], inputs: CheckInputs, bent: Bend | None, lens_holds: bool
) -> tuple[Checked, Rig]:
    """Whether the camera has moved, by the board in the jig; and the rig, with the camera where it is now.

    Raises InputError for pictures of another size or without a usable board, SolveError where no pose explains it.
    """
    spec, T_antenna_board = inputs.session.board, inputs.session.T_antenna_board
    if not views or T_antenna_board is None:
        why = inputs.no_jig if views else "no picture of the board in the jig (plane/)"
        return Checked((not_given("camera_pose", why),), {"camera_pose": None}), rig
    board = solve_board_pose(views, spec, rig.camera, bent)
    jig = jig_estimate(board, T_antenna_board)
    joint, by_lens = joint_covariance(rig), jig.lens_sensitivity
    shared = by_lens @ joint[_LENS, _POSE]
    covariance = jig.covariance + by_lens @ joint[_LENS, _LENS] @ by_lens.T
    covariance = covariance + joint[_POSE, _POSE] - shared - shared.T
    step, std = jig.T_antenna_camera.tangent_from(rig.T_antenna_camera), np.sqrt(np.diag(covariance))
    on_plane_mm = 1e3 * _on_plane_m(rig, jig.T_antenna_camera)
    words = (
        f"the board in the jig puts the camera {1e3 * np.linalg.norm(step[3:]):.2f} mm "
        f"(± {1e3 * np.linalg.norm(std[3:]):.2f}) and {1e3 * np.linalg.norm(step[:3]):.2f} mrad "
        f"(± {1e3 * np.linalg.norm(std[:3]):.2f}) from the rig's pose; {on_plane_mm:.2f} mm on plane C"
    )
    remedy = "tighten the camera's mount, check that the board sits in its jig, then calibrate again: `vbaa calibrate`"
    sight = jig.T_antenna_camera.rotation @ (board.T_camera_board @ corner_points(spec).mean(axis=0))
    lengths = float(np.linalg.norm(step[3:]) * np.linalg.norm(sight))
    if abs(float(step[3:] @ sight)) > _ALONG_SIGHT * max(lengths, 1e-15):
        remedy = "it moved along its line of sight, which a refocus looks like, too: check the focus, then " + remedy
    if not lens_holds:
        remedy = "mend the lens first: the rest may come from it. Then " + remedy
    distance_std = float(np.sqrt(chi_square(step, covariance)))
    evidence = Evidence(distance_std, len(POSE_PARAMETERS), on_plane_mm, _FLOOR_MM, "mm on plane C")
    finding = judged("camera_pose", words, remedy, evidence)
    if finding.level == HOLDS and board.is_ambiguous:
        why = "the board in the jig has a second pose that fits nearly as well: take it from a steeper angle"
        finding = replace(finding, level=LOOK, remedy=why)
    document = {
        "turn_mrad": (1e3 * step[:3]).tolist(),
        "turn_std_mrad": (1e3 * std[:3]).tolist(),
        "shift_mm": (1e3 * step[3:]).tolist(),
        "shift_std_mm": (1e3 * std[3:]).tolist(),
        "on_plane_mm": on_plane_mm,
        "rms_px": board.rms_px,
        "second_ratio": board.second_ratio,
        "T_antenna_camera": jig.T_antenna_camera.to_dict(),
    }
    return Checked((finding,), {"camera_pose": document}), _with_jig_pose(rig, jig) if finding.is_bad else rig


def _with_jig_pose(rig: Rig, jig: PoseEstimate) -> Rig:
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
