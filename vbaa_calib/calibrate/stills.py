"""From the pictures of the free and the loaded antenna to observations for the joint solve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..camera import Camera
from ..console import progress
from ..detect.antenna import corridor, find, free_curve
from ..errors import InputError
from ..geometry import Kinematics, Pose
from ..images import read_gray
from ..session import Load, Session, Still, gravity_antenna
from .joint_problem import Observation

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
    bright: bool | None = None,
) -> list[Observation]:
    """The antenna's seen points in every still, brighter or darker than its background; None: as the first one shows.

    Raises InputError naming the picture that has another size than the lens was calibrated for, or shows no antenna.
    """
    gravity = gravity_antenna(kinematics, session.gravity_world_m_s2, stills)
    T_camera_antenna = T_antenna_camera.inverse()
    observations: list[Observation] = []
    for still, pull in zip(progress(stills, what), gravity, strict=True):
        assert still.image is not None
        image = read_gray(still.image)
        check_size(image, camera, still.image)
        free = free_curve(parameters, session.antenna.length_m, pull)
        where = corridor(camera, T_camera_antenna, free, session.antenna.diameter_m)
        if bright is None:
            bright = find(image, where, bright=True).seen >= find(image, where, bright=False).seen
        line = find(image, where, bright)
        if not line.found or (not isinstance(still, Load) and line.seen < LEAST_SEEN_FREE):
            raise InputError(
                f"no antenna found in it ({100 * line.seen:.0f} % of its length seen)",
                where=still.image,
                remedy="shoot it again with the antenna lit, or take its row out of the CSV",
            )
        observations.append(Observation(still, line.points_px, line.sigma_px, pull, bright))
    return observations


def check_size(image: np.ndarray, camera: Camera, where: object) -> None:
    """Raises InputError when a picture has not the size that the lens was calibrated for."""
    height, width = image.shape[:2]
    if (width, height) != tuple(camera.image_size):
        raise InputError(
            f"is {width}x{height}, the lens was calibrated at {camera.image_size[0]}x{camera.image_size[1]}",
            where=where,
            remedy="use one resolution throughout",
        )
