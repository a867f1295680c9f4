"""A calibrated rig and its uncertainty: rig.json."""

from vbaa_calib.session import MomentSensor

from .parts import POSE_PARAMETERS, RIG_PARAMETERS, RIG_STEPS, SCHEMA, Antenna, AntennaImage, Tip
from .rig import Rig
from .wrench_sensor import WrenchSensor

__all__ = [
    "POSE_PARAMETERS",
    "RIG_PARAMETERS",
    "RIG_STEPS",
    "SCHEMA",
    "Antenna",
    "AntennaImage",
    "MomentSensor",
    "Rig",
    "Tip",
    "WrenchSensor",
]
