"""The rig as it stood while it touched: shapes, camera and plane C, carried into the world."""

from __future__ import annotations

import numpy as np

from estimator.table import ContactTable
from vbaa_calib.antenna.shape import bend
from vbaa_calib.camera import Camera
from vbaa_calib.errors import InputError
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import Rig

from .scene import RigItems

GHOSTS = 6
FOREIGN_M = 1e-3
"""World and antenna points that disagree by more than this come from another rig."""


def joint_angles(kinematics: Kinematics, point_antenna_m: np.ndarray, point_world_m: np.ndarray) -> tuple[float, float]:
    """Pan and tilt that carry a point of the antenna frame to its place in the world; |tilt| below 90°.

    contacts.csv gives each contact in both frames but not the joints.

    Raises
    ------
    InputError : no angles do: the contacts are not of this rig.
    """
    p = kinematics.T_actuator_antenna @ point_antenna_m
    q = point_world_m - kinematics.position_world_m
    sin, cos = np.sin(kinematics.axis_skew_rad), np.cos(kinematics.axis_skew_rad)
    # sin(tilt)·p_x + cos(tilt)·p_z is what the tilt makes of p_z, before the axis' lean mixes it with p_y
    up = (q[2] - sin * p[1]) / cos
    tilt = np.arcsin(np.clip(up / np.hypot(p[0], p[2]), -1.0, 1.0)) - np.arctan2(p[2], p[0])
    forward = kinematics.axis_offset_m + np.cos(tilt) * p[0] - np.sin(tilt) * p[2]
    aside = cos * p[1] - sin * up
    if abs(np.hypot(forward, aside) - np.hypot(q[0], q[1])) > FOREIGN_M:
        raise InputError("the contacts do not fit the rig's kinematics", remedy="give the rig.json they were made with")
    pan = float(np.arctan2(q[1], q[0]) - np.arctan2(aside, forward))
    return pan, float(tilt) - kinematics.tilt_zero_rad


def rig_items(rig: Rig, table: ContactTable) -> RigItems:
    """The rig in the frame of the greatest force, with ghosts of the antenna in frames spread over the recording.

    Raises
    ------
    InputError : no frame has a located contact, or the contacts are not of this rig.
    """
    located = np.flatnonzero(table.located)
    if not len(located):
        raise InputError("no frame has a located contact", remedy="see the reason column of contacts.csv")
    force = np.hypot(table.force_y_N[located], table.force_z_N[located])
    main = located[np.argmax(force)]
    spread = np.unique(located[np.linspace(0, len(located) - 1, GHOSTS).round().astype(int)])
    pose = _pose(rig, table, main)
    length = rig.antenna.length_m
    return RigItems(
        bent_m=pose @ _shape(rig, table, main, pose),
        free_m=pose @ _shape(rig, table, main, pose, share=0.0),
        ghosts_m=tuple(
            there @ _shape(rig, table, index, there)
            for index, there in ((index, _pose(rig, table, index)) for index in spread if index != main)
        ),
        antenna_radius_m=rig.antenna.diameter_m / 2,
        plane_m=pose @ (length * np.array([[0, -0.3, 0], [1.05, -0.3, 0], [1.05, 0.3, 0], [0, 0.3, 0]])),
        frustum_m=pose @ rig.T_antenna_camera @ frustum(rig.camera, 0.3 * length),
    )


def _pose(rig: Rig, table: ContactTable, index: int) -> Pose:
    angles = joint_angles(rig.kinematics, table.point_antenna_m[index], table.point_world_m[index])
    return rig.kinematics.T_world_antenna(*angles)


def _shape(rig: Rig, table: ContactTable, index: int, T_world_antenna: Pose, share: float = 1.0) -> np.ndarray:
    """(N, 3) antenna frame: the antenna under `share` of the force that was estimated in this frame."""
    curves = bend(
        rig.antenna.parameters[None],
        rig.antenna.length_m,
        (T_world_antenna.rotation.T @ rig.gravity_world_m_s2)[None],
        np.clip(table.distance_m[[index]], 0.01 * rig.antenna.length_m, rig.antenna.length_m),
        share * np.array([[table.force_y_N[index], table.force_z_N[index]]]),
    )
    return curves.points_m[0]


def frustum(camera: Camera, depth_m: float) -> np.ndarray:
    """(5, 3) camera frame: its centre and the corners of its picture at a depth, as the lens sees them.

    Where the lens has no ray in a corner, that of a lens without distortion is drawn.
    """
    right, bottom = np.array(camera.image_size) - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    rays, valid = camera.unproject(corners)
    straight = np.column_stack([corners, np.ones(4)]) @ np.linalg.inv(camera.matrix).T
    rays = np.where((valid & (rays[:, 2] > 0.1))[:, None], rays, straight)
    return np.vstack([np.zeros(3), depth_m * rays / rays[:, 2:]])
