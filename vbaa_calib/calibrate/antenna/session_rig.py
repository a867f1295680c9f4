"""A session's stills to a rig: antenna, moment sensor, camera pose and lens in one solve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vbaa_calib.calibrate.pose.fusion import PoseEstimate, fused
from vbaa_calib.camera import Camera
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import read_picture
from vbaa_calib.detect.whisker.antenna import corridor, finder, free_curve
from vbaa_calib.detect.whisker.paint import Paint, learn
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import Antenna, AntennaImage, MomentSensor, Rig
from vbaa_calib.session import (
    Load,
    LoadReadings,
    NominalAntenna,
    Session,
    Still,
    gravity_antenna,
    read_loads,
    read_noload,
)

from .bundle_adjustment import JointSolution, solve_joint
from .inputs import EXACT, Observation, Prior
from .problem import ANTENNA
from .residual_checks import check

LEAST_SEEN_FREE = 0.6
"""Nothing hides the free antenna: less than this fraction seen means that something is wrong."""


def observe(
    session: Session,
    kinematics: Kinematics,
    stills: Sequence[Still],
    camera: Camera,
    T_antenna_camera: Pose,
    parameters: np.ndarray,
    what: str,
    paint: Paint | None = None,
) -> list[Observation]:
    """The antenna's seen points in every still; what tells it from its background is learnt from the first one.

    parameters : (9,) of the antenna, as far as they are known.

    Raises InputError naming the picture that has another size than the lens was calibrated for, or shows no antenna.
    """
    gravity = gravity_antenna(kinematics, session.gravity_world_m_s2, stills)
    observations: list[Observation] = []
    for still, pull in zip(progress(stills, what), gravity, strict=True):
        image = _picture(still, camera)
        seen = observe_one(session.antenna, still, image, pull, camera, T_antenna_camera, parameters, paint)
        paint = seen.paint
        observations.append(seen)
    return observations


def observe_one(
    antenna: NominalAntenna,
    still: Still,
    image: np.ndarray,
    gravity_m_s2: np.ndarray,
    camera: Camera,
    T_antenna_camera: Pose,
    parameters: np.ndarray,
    paint: Paint | None = None,
) -> Observation:
    """The antenna's seen points in one picture; without `paint`, what tells it from its background is learnt here.

    image : as `read_picture` gives it. gravity_m_s2 : (3,) antenna frame. Raises InputError as `observe` does.
    """
    free = free_curve(parameters, antenna.length_m, gravity_m_s2)
    looking = finder(corridor(camera, T_antenna_camera.inverse(), free, antenna.diameter_m), camera)
    if looking is None:
        raise InputError(
            "the camera's pose leaves the antenna out of the picture",
            where=still.image,
            remedy="check the jig (or sweep, or over) in session.yaml",
        )
    paint = learn(looking, [image]) if paint is None else paint
    line = paint.find(looking, image)
    if not line.found or (not isinstance(still, Load) and line.seen < LEAST_SEEN_FREE):
        why = f": {line.reason}" if line.reason else ""
        raise InputError(
            f"no antenna found in it ({100 * line.seen:.0f} % of its length seen{why})",
            where=still.image,
            remedy="shoot it again with the antenna lit, or take its row out of the CSV",
        )
    return Observation(still, line.points_px, line.sigma_px, gravity_m_s2, paint, line.amplitude)


def _picture(still: Still, camera: Camera) -> np.ndarray:
    assert still.image is not None
    image = read_picture(still.image)
    check_size(image, camera, still.image)
    return image


def check_size(image: np.ndarray, camera: Camera, where: object) -> None:
    """Raises InputError when a picture (H, W) or (H, W, 3) has not the size that the lens was calibrated for."""
    height, width = image.shape[:2]
    if (width, height) != tuple(camera.image_size):
        raise InputError(
            f"is {width}x{height}, the lens was calibrated at {camera.image_size[0]}x{camera.image_size[1]}",
            where=where,
            remedy="use one resolution throughout",
        )


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
