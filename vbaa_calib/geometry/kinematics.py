"""The two actuators: joint angles to the pose of the antenna in the world."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .pose import Pose


def rotation_world_antenna(pan_rad: float, tilt_rad: float, axis_skew_rad: float = 0.0) -> np.ndarray:
    """R_world_antenna = Rz(pan)·Rx(skew)·Ry(−tilt), (3, 3). Without skew Eq. (22) with its third column mended.

    As printed that column is (−sinθ, 0, cosθ), which is a rotation only for pan = 0.
    """
    sin_p, cos_p, sin_t, cos_t = np.sin(pan_rad), np.cos(pan_rad), np.sin(tilt_rad), np.cos(tilt_rad)
    turn = np.array(
        [
            [cos_t * cos_p, -sin_p, -sin_t * cos_p],
            [cos_t * sin_p, cos_p, -sin_t * sin_p],
            [sin_t, 0.0, cos_t],
        ]
    )
    if axis_skew_rad == 0.0:
        return turn
    # Rz·Rx·Rz⁻¹ turns about the panned x axis, then comes what two perpendicular axes do
    panned_x = np.array([cos_p, sin_p, 0.0])
    return Pose.from_rotvec(axis_skew_rad * panned_x, np.zeros(3)).rotation @ turn


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Where the joints carry the antenna frame. Eqs. (19) and (21), and what a real pair of axes adds to them.

    T_world_actuator = Trans(position)·Rz(pan)·Trans(offset along x)·Rx(skew)·Ry(−(tilt + tilt zero)). The pan axis is
    the world's z through `position_world_m`. The panned x axis is the common perpendicular of the two axes; its
    foot on the tilt axis is the actuator frame's origin, whose y runs along that axis. The paper's axes cross at right
    angles.

    Attributes
    ----------
    T_actuator_antenna : pose of the antenna frame on the moving attachment.
    position_world_m : (3,) crossing point of the two joint axes in the world, Eq. (21). Where they pass each other, the
        foot of their common perpendicular on the pan axis.
    axis_skew_rad : lean of the tilt axis from the right angle with the pan axis; positive where its y leans to +z.
    axis_offset_m : from the pan axis to the tilt axis along the panned x.
    tilt_zero_rad : true tilt where the encoder reads zero; true tilt = reading + tilt_zero_rad.
    """

    T_actuator_antenna: Pose = field(default_factory=Pose.identity)
    position_world_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axis_skew_rad: float = 0.0
    axis_offset_m: float = 0.0
    tilt_zero_rad: float = 0.0

    def T_world_actuator(self, pan_rad: float, tilt_rad: float) -> Pose:
        """Pose of the moving attachment in the world at the encoders' readings."""
        turn = rotation_world_antenna(pan_rad, tilt_rad + self.tilt_zero_rad, self.axis_skew_rad)
        panned_x = np.array([np.cos(pan_rad), np.sin(pan_rad), 0.0])
        return Pose(turn, self.position_world_m + self.axis_offset_m * panned_x)

    def T_world_antenna(self, pan_rad: float, tilt_rad: float) -> Pose:
        """Pose of the antenna frame in the world; `T_world_antenna @ p_antenna` is Eq. (19)."""
        return self.T_world_actuator(pan_rad, tilt_rad) @ self.T_actuator_antenna
