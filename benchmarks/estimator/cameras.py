"""Rigs with two cameras, and what both see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vbaa_calib.geometry import Pose
from vbaa_calib.rig import RIG_PARAMETERS, Rig

from .scenes import Scenes, seen


def with_second(rig: Rig, angle_rad: float = np.pi / 2) -> Rig:
    """The rig with a second camera like the first, `right`, turned by an angle about the antenna's x axis; the first is
    `left`."""
    count = len(RIG_PARAMETERS) + len(rig.camera.parameter_names)
    covariance = np.zeros((count, count))
    covariance[: len(rig.covariance), : len(rig.covariance)] = rig.covariance
    first, turn = (
        replace(rig, covariance=covariance, camera_name="left"),
        Pose.from_rotvec(np.array([angle_rad, 0.0, 0.0]), np.zeros(3)),
    )
    second = replace(first, T_antenna_camera=turn @ rig.T_antenna_camera, camera_name="right")
    return replace(first, others={"right": second})


def centrelines(rig: Rig, frames: Scenes, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Pixels (B, N, 2) of each of a rig's cameras, with the frames' noise."""
    pictures = (seen(one.camera, one.T_antenna_camera, frames.shapes.points_m) for one in rig.cameras.values())
    noisy = [points + rng.normal(0.0, frames.sigma_px, points.shape) for points in pictures]
    return dict(zip(rig.cameras, noisy, strict=True))


def drawn(rig: Rig, rng: np.random.Generator) -> Rig:
    """A true rig, all of its cameras, that the given one may be the calibration of."""
    step = rig.axes @ rng.normal(size=rig.axes.shape[1])
    step[RIG_PARAMETERS.index("clamp_give_m")] = 0.0
    return rig.moved(step)
