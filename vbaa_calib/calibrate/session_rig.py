"""A session's stills to a rig: antenna, moment sensor, camera pose and lens in one solve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..camera import Camera
from ..geometry import Kinematics
from ..rig import Antenna, AntennaImage, MomentSensor, Rig
from ..session import Load, LoadReadings, NominalAntenna, Session, read_loads, read_noload
from .joint import JointSolution, solve_joint
from .joint_checks import check
from .joint_given import Observation, Prior
from .joint_problem import ANTENNA
from .load_readings import EXACT
from .pose_estimate import PoseEstimate
from .stills import observe
from .ways import fused

CLAMP_OFFSET_STD_M = 1.5e-3
CLAMP_ANGLE_STD_RAD = 0.035
BOW_STD_PER_M = 0.3
CLAMP_GIVE_STD_M = 5e-4
LOG_STIFFNESS_STD = 0.5
LOG_MASS_STD = 0.03
GAIN_STD = 0.5
OFFSET_STD_NM = 0.02
"""Priors of the joint solve: what a careful builder can be trusted with. Stiffness and sensor are left all but free;
the mass is not, for sag is what weight over stiffness gives, and a kitchen scale knows the mass to a few per cent."""
DEFINED = 1e-3
"""Where the antenna itself defines its frame, the clamp's place and turn in plane C are this part of the ordinary."""


def nominal_parameters(antenna: NominalAntenna) -> np.ndarray:
    """(9,) antenna parameters before anything was seen: straight, clamped hard and true, nominal stiffness and mass."""
    return np.array([0.0] * 6 + [np.log(antenna.stiffness_Nm2), np.log(antenna.mass_per_length_kg_m), 0.0])


def prior(
    antenna: NominalAntenna,
    camera: Camera,
    poses: Sequence[PoseEstimate],
    own_frame: bool = False,
    readings: LoadReadings = EXACT,
) -> Prior:
    """What is known before the stills.

    own_frame : plane C was found by the antenna alone, so that its clamp lies on the x axis of its frame, and along it,
        because that is how the frame is defined.
    """
    in_plane = DEFINED if own_frame else 1.0
    clamp = [CLAMP_OFFSET_STD_M * in_plane, CLAMP_OFFSET_STD_M, CLAMP_ANGLE_STD_RAD, CLAMP_ANGLE_STD_RAD * in_plane]
    rest = [BOW_STD_PER_M] * 2 + [LOG_STIFFNESS_STD, LOG_MASS_STD, CLAMP_GIVE_STD_M, GAIN_STD, OFFSET_STD_NM]
    return Prior(
        poses=tuple(poses),
        start=fused(poses),
        camera=camera,
        mean=np.concatenate([nominal_parameters(antenna), [1.0, 0.0]]),
        std=np.array([*clamp, *rest]),
        readings=readings,
    )


def solve_antenna(session: Session, kinematics: Kinematics, before: Prior) -> tuple[JointSolution, list[Observation]]:
    """Camera pose, antenna, moment sensor and lens from the no-load frames and the known loads of a session.

    A moment sensor that scatters clearly more than the session says is weighed by what it shows.
    """
    noload, loads = read_noload(session), read_loads(session)
    nominal = nominal_parameters(session.antenna)
    free = observe(session, kinematics, noload, before.camera, before.start, nominal, "free antenna")
    loaded = observe(session, kinematics, loads, before.camera, before.start, nominal, "known loads", free[0].paint)
    observations = [*free, *loaded]
    joint = solve_joint(observations, before, session.antenna.length_m, session.moment_std_Nm)
    sensor = check(joint)
    if sensor.noise_interval_95_Nm[0] > session.moment_std_Nm:
        joint = solve_joint(observations, before, session.antenna.length_m, sensor.noise_Nm)
    return joint, observations


def make_rig(
    session: Session, kinematics: Kinematics, joint: JointSolution, observations: Sequence[Observation]
) -> Rig:
    """The rig out of a joint solution."""
    gain, offset = joint.sensor_gain_offset
    paint = observations[0].paint
    sigma_px = float(np.median(np.concatenate([observation.sigma_px for observation in observations])))
    return Rig(
        camera=joint.camera,
        T_antenna_camera=joint.T_antenna_camera,
        antenna=Antenna(session.antenna.length_m, session.antenna.diameter_m, joint.parameters[ANTENNA]),
        moment_sensor=MomentSensor(gain, offset, joint.problem.moment_std_Nm),
        kinematics=kinematics,
        gravity_world_m_s2=session.gravity_world_m_s2,
        image=AntennaImage(
            sigma_px * joint.noise_scale, joint.noise_scale, paint.bright, paint.weights, _height(observations)
        ),
        covariance=joint.covariance,
        second_moment_sensor=session.second_moment_sensor,
    )


def _height(observations: Sequence[Observation]) -> float | None:
    heights = [one.height for one in observations if not isinstance(one.still, Load) and one.height > 0]
    return float(np.median(heights)) if heights else None
