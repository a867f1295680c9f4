"""Where the joints stood in each frame of a table of contacts."""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics

from .contacts import ContactTable

FOREIGN_M = 1e-3
"""World and antenna points that disagree by more than this come from another rig."""


def joint_angles(kinematics: Kinematics, table: ContactTable) -> tuple[np.ndarray, np.ndarray]:
    """Pan and tilt (B,) in rad; NaN where the table has neither them nor a contact in both frames.

    Raises
    ------
    InputError : the contacts are not of this rig.
    """
    recorded = np.isfinite(table.pan_rad) & np.isfinite(table.tilt_rad)
    pan, tilt = from_points(kinematics, table.point_antenna_m, table.point_world_m)
    pan, tilt = np.where(recorded, table.pan_rad, pan), np.where(recorded, table.tilt_rad, tilt)
    rotation, translation = kinematics.world_antenna(pan, tilt)
    off = np.einsum("bij,bj->bi", rotation, table.point_antenna_m) + translation - table.point_world_m
    if (np.linalg.norm(off, axis=1) > FOREIGN_M).any():
        raise InputError(
            "the contacts do not fit the rig's kinematics",
            where="rig.json",
            remedy="give the rig.json they were made with",
        )
    return pan, tilt


def from_points(
    kinematics: Kinematics, point_antenna_m: np.ndarray, point_world_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The angles (B,) that carry points (B, 3) of the antenna frame to their places in the world; |tilt| below 90°."""
    p = kinematics.T_actuator_antenna @ point_antenna_m
    q = point_world_m - kinematics.position_world_m
    sin, cos = np.sin(kinematics.axis_skew_rad), np.cos(kinematics.axis_skew_rad)
    with np.errstate(invalid="ignore", divide="ignore"):
        # sin(tilt)·p_x + cos(tilt)·p_z is what the tilt makes of p_z, before the axis' lean mixes it with p_y
        up = (q[:, 2] - sin * p[:, 1]) / cos
        reach = np.clip(up / np.hypot(p[:, 0], p[:, 2]), -1.0, 1.0)
        tilt = np.arcsin(reach) - np.arctan2(p[:, 2], p[:, 0])
        forward = kinematics.axis_offset_m + np.cos(tilt) * p[:, 0] - np.sin(tilt) * p[:, 2]
        aside = cos * p[:, 1] - sin * up
        pan = np.arctan2(q[:, 1], q[:, 0]) - np.arctan2(aside, forward)
    return pan, tilt - kinematics.tilt_zero_rad
