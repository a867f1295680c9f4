"""A session to a rig: lens, plane C, then antenna and moment sensor together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..camera import Camera
from ..console import say
from ..errors import InputError
from ..geometry import Pose
from ..rig import Antenna, AntennaImage, MomentSensor, Rig
from ..session import Load, NominalAntenna, Session, Still, read_loads, read_noload
from .intrinsics import LensSolution
from .joint import JointSolution, Observation, Prior, solve_joint
from .plane import BoardPose
from .stills import observe

CLAMP_OFFSET_STD_M = 1.5e-3
CLAMP_ANGLE_STD_RAD = 0.035
BOW_STD_PER_M = 0.3
LOG_STIFFNESS_STD = 0.5
LOG_MASS_STD = 0.03
GAIN_STD = 0.5
OFFSET_STD_NM = 0.02
"""Priors of the joint solve: what a careful builder can be trusted with. Stiffness and sensor are left all but free;
the mass is not, for sag is what weight over stiffness gives, and a kitchen scale knows the mass to a few per cent."""

STIFFNESS_DOUBT = 0.15
"""Relative difference of EI from E·πd⁴/64 that is worth a warning: 4 % of the diameter."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """A rig and what a person should know about how it was found."""

    rig: Rig
    lens: LensSolution
    board_pose: BoardPose
    joint: JointSolution
    warnings: Sequence[str] = field(default_factory=tuple)


def pose_from_jig(board_pose: BoardPose, camera: Camera, T_antenna_board: Pose) -> tuple[Pose, np.ndarray]:
    """Pose of the camera in the antenna frame and its (6, 6) covariance, tangent of `Pose.retract` in that frame.

    The lens' covariance is carried through to the pose.
    """
    T_camera_board = board_pose.T_camera_board
    T_antenna_camera = T_antenna_board @ T_camera_board.inverse()
    rotation = T_antenna_camera.rotation
    lever = rotation @ T_camera_board.translation_m
    cross = np.array([[0, -lever[2], lever[1]], [lever[2], 0, -lever[0]], [-lever[1], lever[0], 0]])
    # Turning the board by w turns the camera by −R·w about the board, which also moves it.
    jacobian = np.block([[-rotation, np.zeros((3, 3))], [-cross @ rotation, -rotation]])
    covariance = board_pose.covariance
    if camera.covariance is not None:
        covariance = covariance + board_pose.lens_sensitivity @ camera.covariance @ board_pose.lens_sensitivity.T
    return T_antenna_camera, jacobian @ covariance @ jacobian.T


def nominal_parameters(antenna: NominalAntenna) -> np.ndarray:
    """(8,) antenna parameters before anything was seen: straight, clamped true, nominal stiffness and mass."""
    return np.array([0.0] * 6 + [np.log(antenna.stiffness_Nm2), np.log(antenna.mass_per_length_kg_m)])


def solve_antenna(
    session: Session, camera: Camera, T_antenna_camera: Pose, pose_covariance: np.ndarray
) -> tuple[JointSolution, list[Observation]]:
    """Camera pose, antenna and moment sensor from the no-load frames and the known loads of a session."""
    noload, loads = read_noload(session), read_loads(session)
    nominal = nominal_parameters(session.antenna)
    free = observe(session, noload, camera, T_antenna_camera, nominal, "free antenna")
    loaded = observe(session, loads, camera, T_antenna_camera, nominal, "known loads", free[0].bright)
    std = [CLAMP_OFFSET_STD_M] * 2 + [CLAMP_ANGLE_STD_RAD] * 2 + [BOW_STD_PER_M] * 2
    prior = Prior(
        T_antenna_camera,
        pose_covariance,
        mean=np.concatenate([nominal, [1.0, 0.0]]),
        std=np.array([*std, LOG_STIFFNESS_STD, LOG_MASS_STD, GAIN_STD, OFFSET_STD_NM]),
    )
    sensor = MomentSensor(1.0, 0.0, session.moment_std_Nm)
    observations = [*free, *loaded]
    return solve_joint(observations, camera, prior, session.antenna.length_m, sensor), observations


def make_rig(session: Session, camera: Camera, joint: JointSolution, observations: Sequence[Observation]) -> Rig:
    """The rig out of a joint solution."""
    gain, offset = joint.sensor_gain_offset
    sigma_px = np.median(
        np.concatenate([np.sqrt(np.abs(np.linalg.det(obs.seen.covariance))) ** 0.5 for obs in observations])
    ) * float(np.sqrt(abs(np.linalg.det(camera.matrix[:2, :2]))))
    return Rig(
        camera=camera,
        T_antenna_camera=joint.T_antenna_camera,
        antenna=Antenna(session.antenna.length_m, session.antenna.diameter_m, joint.parameters[6:14]),
        moment_sensor=MomentSensor(gain, offset, session.moment_std_Nm),
        kinematics=session.kinematics,
        gravity_world_m_s2=session.gravity_world_m_s2,
        image=AntennaImage(float(sigma_px * joint.noise_scale), joint.noise_scale, observations[0].bright),
        covariance=joint.covariance,
    )


def doubts(
    session: Session, rig: Rig, board_pose: BoardPose, joint: JointSolution, stills: Sequence[Still]
) -> list[str]:
    """What a person should look at, in words."""
    found = []
    if board_pose.is_ambiguous:
        found.append("the board in the jig has a second pose that fits nearly as well: take it from a steeper angle")
    for index, still in enumerate(stills):
        rms, moment = joint.point_rms[index], joint.moment_residuals_Nm[index]
        name = still.image.name if still.image else "?"
        kind = "load" if isinstance(still, Load) else "no-load frame"
        if not joint.kept[index]:
            found.append(f"{kind} {name}: left out, its shape lies {rms:.1f} std off the model; is its row right?")
        elif abs(moment) > 5 * session.moment_std_Nm:
            off = moment / session.moment_std_Nm
            found.append(f"{kind} {name}: the moment reading is {off:+.1f} std off; is its row right?")
    nominal = session.antenna.stiffness_Nm2
    difference = rig.antenna.stiffness_Nm2 / nominal - 1
    if abs(difference) > max(STIFFNESS_DOUBT, 3 * rig.std("log_stiffness_Nm2")):
        found.append(
            f"EI is {100 * difference:+.0f} % off E·πd⁴/64 = {nominal:.4g} N·m²: check diameter, loads and their unit"
        )
    if rig.moment_sensor.gain <= 0:
        found.append("the moment sensor's gain is negative: its sign is turned round")
    return found


def require_jig(session: Session) -> Pose:
    """The board's place in the jig. Raises InputError without one."""
    if session.T_antenna_board is None:
        raise InputError(
            "jig is missing",
            where=session.root / "session.yaml",
            remedy="give jig.T_antenna_board, the pose of the board in the jig on the antenna's base",
        )
    return session.T_antenna_board


def report(calibration: Calibration) -> None:
    """The result in a few lines of prose."""
    rig, antenna = calibration.rig, calibration.rig.antenna
    position = 1e3 * rig.T_antenna_camera.translation_m
    std = [rig.std(name) for name in ("log_stiffness_Nm2", "moment_gain", "moment_offset_Nm")]
    say(f"lens       {calibration.lens.model}: rms {calibration.lens.rms_px:.3f} px")
    say(f"plane C    camera at ({position[0]:.1f}, {position[1]:.1f}, {position[2]:.1f}) mm in the antenna frame")
    say(f"antenna    EI = {antenna.stiffness_Nm2:.5g} ± {antenna.stiffness_Nm2 * std[0]:.2g} N·m²")
    sensor = rig.moment_sensor
    say(f"sensor     gain {sensor.gain:.4f} ± {std[1]:.4f}, offset {1e3 * sensor.offset_Nm:.3f} mN·m")
    for line in calibration.warnings:
        say(f"look at    {line}")


def summary(calibration: Calibration) -> dict[str, Any]:
    """The numbers of the result, for rig.json's quality section and `--json`."""
    joint, board_pose = calibration.joint, calibration.board_pose
    return {
        "lens_rms_px": float(calibration.lens.rms_px),
        "plane_rms_px": float(board_pose.rms_px),
        "plane_second_solution_ratio": board_pose.second_ratio,
        "noise_scale": joint.noise_scale,
        "worst_still_rms": float(joint.point_rms.max()),
        "moment_residual_rms_Nm": float(np.sqrt((joint.moment_residuals_Nm**2).mean())),
        "warnings": list(calibration.warnings),
    }
