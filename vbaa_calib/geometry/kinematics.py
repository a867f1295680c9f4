"""The two actuators: joint angles to the pose of the antenna in the world."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .pose import Pose


def rotation_world_antenna(pan_rad: float, tilt_rad: float) -> np.ndarray:
    """R_world_antenna = Rz(pan)·Ry(−tilt), (3, 3). Eq. (22) with its third column mended.

    As printed that column is (−sinθ, 0, cosθ), which is a rotation only for pan = 0.
    """
    sin_p, cos_p, sin_t, cos_t = np.sin(pan_rad), np.cos(pan_rad), np.sin(tilt_rad), np.cos(tilt_rad)
    return np.array(
        [
            [cos_t * cos_p, -sin_p, -sin_t * cos_p],
            [cos_t * sin_p, cos_p, -sin_t * sin_p],
            [sin_t, 0.0, cos_t],
        ]
    )


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Where the joints carry the antenna frame. Eqs. (19) and (21).

    Attributes
    ----------
    T_actuator_antenna : pose of the antenna frame on the moving attachment.
    position_world_m : (3,) crossing point of the two joint axes in the world, Eq. (21).
    """

    T_actuator_antenna: Pose = field(default_factory=Pose.identity)
    position_world_m: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def T_world_antenna(self, pan_rad: float, tilt_rad: float) -> Pose:
        """Pose of the antenna frame in the world; `T_world_antenna @ p_antenna` is Eq. (19)."""
        return Pose(rotation_world_antenna(pan_rad, tilt_rad), self.position_world_m) @ self.T_actuator_antenna
