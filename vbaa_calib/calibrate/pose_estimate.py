"""What one way of finding plane C answers: the camera's pose in the antenna frame, and what it is worth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import Pose


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The camera's pose by one way.

    Attributes
    ----------
    way : its name, as reports print it.
    T_antenna_camera : pose of the camera in the antenna frame.
    covariance : (6, 6) of `Pose.retract`'s tangent (rotation vector rad, translation m) in the antenna frame, the lens
        held fixed.
    lens_sensitivity : (6, 4 + k) derivative of that tangent by the camera's (fx, fy, cx, cy, distortion). With the
        lens' covariance C the whole covariance is `covariance + S C Sᵀ`.
    """

    way: str
    T_antenna_camera: Pose
    covariance: np.ndarray
    lens_sensitivity: np.ndarray
