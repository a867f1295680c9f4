"""A calibrated rig and its uncertainty: rig.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vbaa_calib.session import MomentSensor

from .parts import POSE_PARAMETERS, RIG_PARAMETERS, RIG_STEPS, SCHEMA, Antenna, AntennaImage, Tip
from .rig import Rig

if TYPE_CHECKING:
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


def __getattr__(name: str) -> Any:
    """Load the sensor of several axes on first use: with the checks of its entry in files it is slow to load."""
    if name == "WrenchSensor":
        from .wrench_sensor import WrenchSensor

        return WrenchSensor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
