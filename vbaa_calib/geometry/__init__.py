"""Rigid geometry: poses, planes and the two actuators. Nothing here knows about cameras or antennas."""

from .kinematics import Kinematics, rotation_world_antenna
from .plane import PLANE_C, Plane, hinge_plane
from .pose import Pose

__all__ = ["PLANE_C", "Kinematics", "Plane", "Pose", "hinge_plane", "rotation_world_antenna"]
