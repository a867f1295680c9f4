"""What the causes of the error budget are called, and what helps against them."""

from __future__ import annotations

from .budget_parts import FORCE_PRIOR, FRICTION, MOMENT_NOISE, PIXELS
from .budget_space import JOINT_AXES, LENS

NAMES = {
    PIXELS: "pixel noise",
    MOMENT_NOISE: "moment noise",
    FRICTION: "friction angle",
    LENS: "lens",
    "camera_rotation": "camera rotation",
    "camera_position": "camera position",
    "clamp_angle": "clamp angle",
    "clamp_offset": "clamp offset",
    "clamp_give": "clamp give",
    "bow": "bow",
    "stiffness": "stiffness EI",
    "mass": "mass",
    "moment_gain": "moment gain",
    "moment_offset": "moment offset",
    JOINT_AXES: "joint axes",
    FORCE_PRIOR: "likely force",
}
"""Every cause, in the order in which figures stack them."""
_JIG = "take more pictures of the board in the jig, with a better jig, or a sweep of the joints"
_NO_LOAD = "take more pictures of the free antenna, at several tilts, and calibrate again"
_LOADS = "hang more loads, heavier and at several distances, weighed and measured with a caliper"
REMEDIES = {
    PIXELS: "bring the camera nearer, take one with more pixels or a longer lens, or light the antenna better",
    MOMENT_NOISE: "take a quieter moment sensor, or average more readings per picture",
    FRICTION: "polish or grease the antenna, and say with --friction how slippery it is",
    LENS: "take more pictures of the board for the lens, up to the borders of the picture",
    "camera_rotation": _JIG,
    "camera_position": _JIG,
    "clamp_angle": _NO_LOAD,
    "clamp_offset": _NO_LOAD,
    "clamp_give": _LOADS + "; or stiffen the clamp",
    "bow": _NO_LOAD,
    "stiffness": _LOADS,
    "mass": "weigh the antenna, or take more pictures of it free at several tilts",
    "moment_gain": _LOADS,
    "moment_offset": "take more readings without a load",
    JOINT_AXES: "repeat the sweep of the joints with more poses, or measure the axes",
    FORCE_PRIOR: "give the moment reading: the picture alone hardly holds the force here",
}
RESULT_NAMES = {
    "distance_m": "distance l",
    "force_y_N": "force f_y",
    "force_z_N": "force f_z",
    "force_N": "lateral force",
    "point_m": "world point",
}
