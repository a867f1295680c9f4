"""Everything that is known about one rig, and how well: rig.json."""

from vbaa_calib.session import MomentSensor

from .parameters import POSE_PARAMETERS, RIG_PARAMETERS, RIG_STEPS, SENSOR_PARAMETERS
from .parts import Antenna, AntennaImage
from .rig import SCHEMA, Rig

__all__ = [
    "POSE_PARAMETERS",
    "RIG_PARAMETERS",
    "RIG_STEPS",
    "SCHEMA",
    "SENSOR_PARAMETERS",
    "Antenna",
    "AntennaImage",
    "MomentSensor",
    "Rig",
]
