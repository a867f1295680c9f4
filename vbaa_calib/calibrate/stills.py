"""From the pictures of the free and the loaded antenna to observations for the joint solve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..camera import Camera
from ..console import progress
from ..detect.antenna import corridor, finder, free_curve
from ..detect.paint import Paint, learn
from ..errors import InputError
from ..geometry import Kinematics, Pose
from ..images import read_picture
from ..session import Load, NominalAntenna, Session, Still, gravity_antenna
from .joint_given import Observation

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
