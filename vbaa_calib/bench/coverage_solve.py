"""A draw to a calibrated rig, by the calls of `vbaa calibrate`: the one place that knows how they are chained."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ..calibrate.intrinsics import solve_intrinsics
from ..calibrate.jig import jig_estimate
from ..calibrate.joint import JointSolution, solve_joint
from ..calibrate.joint_given import Observation
from ..calibrate.plane import solve_board_pose
from ..calibrate.session_rig import prior
from ..camera import Camera
from ..geometry import Pose
from ..rig import RIG_PARAMETERS
from .coverage_draw import CENTRELINE_PX, MOMENT_NM, Draw
from .coverage_rigs import BOARD, NOMINAL, T_ANTENNA_JIG

STAGES = ("lens", "plane", "joint")


@dataclass(frozen=True, eq=False)
class Solved:
    """What a calibration says, in the form that the benchmark judges.

    Attributes
    ----------
    camera, T_antenna_camera : solved lens and pose.
    parameters : (10,) antenna, gain and offset: `RIG_PARAMETERS` after the pose.
    covariance : (16, 16) of `RIG_PARAMETERS`, the pose's six about the solved pose.
    plane_covariance : (P + 6, P + 6) of the lens, then of the pose: `CameraOnPlane.parameter_names`.
    noise_scale : scatter of the centreline over what it claims.
    seconds : of each of `STAGES`.
    """

    camera: Camera
    T_antenna_camera: Pose
    parameters: np.ndarray
    covariance: np.ndarray
    plane_covariance: np.ndarray
    noise_scale: float
    seconds: tuple[float, ...]


def solve(given: Draw) -> Solved:
    """Lens from the views, pose of C from the jig, then everything together from the stills.

    Raises VbaaError as these do.
    """
    clock = [time.perf_counter()]
    lens = solve_intrinsics(given.views, BOARD, model=given.rig.lens_model)
    clock.append(time.perf_counter())
    board_pose = solve_board_pose(given.jig_views, BOARD, lens.camera, lens.board_flex.bend)
    estimate = jig_estimate(board_pose, T_ANTENNA_JIG)
    clock.append(time.perf_counter())
    before = prior(NOMINAL, lens.camera, [estimate])
    joint = solve_joint(observations(given), before, NOMINAL.length_m, MOMENT_NM)
    clock.append(time.perf_counter())
    first = len(RIG_PARAMETERS)
    return Solved(
        camera=joint.camera,
        T_antenna_camera=joint.T_antenna_camera,
        parameters=joint.parameters[6:],
        covariance=joint.covariance[:first, :first],
        plane_covariance=plane_covariance(joint),
        noise_scale=joint.noise_scale,
        seconds=tuple(np.diff(clock).tolist()),
    )


def observations(given: Draw) -> list[Observation]:
    """The stills as the joint solve takes them, with the deviations that are true."""
    return [
        Observation(seen.still, seen.points_px, np.full(len(seen.points_px), CENTRELINE_PX), seen.gravity_m_s2)
        for seen in given.stills
    ]


def plane_covariance(joint: JointSolution) -> np.ndarray:
    """(P + 6, P + 6) of the lens, then of the camera's pose, out of the joint covariance."""
    order = np.r_[len(RIG_PARAMETERS) : len(joint.covariance), :6]
    return joint.covariance[np.ix_(order, order)]
