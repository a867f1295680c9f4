"""Rigid geometry: poses, planes and the two actuators. Nothing here knows about cameras or antennas."""

from .kinematics import Kinematics, rotation_world_antenna
from .pose import PLANE_C, Plane, Pose, hinge_plane

__all__ = ["PLANE_C", "Kinematics", "Plane", "Pose", "hinge_plane", "rotation_world_antenna"]
