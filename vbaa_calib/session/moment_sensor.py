"""The moment sensor, and the columns of a sensor of more axes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

from vbaa_calib.core.arrays import Within, as_float
from vbaa_calib.core.errors import InputError

READINGS = {
    "my": "moment_Nm",
    "mz": "moment_z_Nm",
    "mx": "moment_x_Nm",
    "fx": "sensor_force_x_N",
    "fy": "sensor_force_y_N",
    "fz": "sensor_force_z_N",
}
"""Components of the wrench at the clamp, in the order of all readings, and the columns of our tables with what a sensor
reads of each."""

SILENT: dict[str, Any] = dict.fromkeys(READINGS.values(), math.nan)
"""Nothing was read."""
CHANNELS = (*SILENT, "pan_rad", "tilt_rad")
"""What is read along with the pictures, named as the columns of recording.csv are."""


def _not_zero(gain: float) -> float:
    if abs(gain) < 1e-9:
        raise ValueError(f"{gain:g} is not between -1e+09 and 1e+09 and at least 1e-09 from 0")
    return gain


@dataclass(frozen=True)
class MomentSensor:
    """reading = gain · moment + offset + noise of standard deviation std, which is infinite without a sensor."""

    gain: Annotated[
        float,
        Within(
            _not_zero, ge=-1e9, le=1e9, json_schema_extra={"not": {"exclusiveMinimum": -1e-9, "exclusiveMaximum": 1e-9}}
        ),
    ]
    offset_Nm: Annotated[float, Within(ge=-1e9, le=1e9)]
    std_Nm: Annotated[float, Within(ge=1e-12, le=1e6)]

    def __post_init__(self) -> None:
        """Raises InputError for a gain of zero, and for what is not a number."""
        in_units = "give a gain other than 0, and offset and standard deviation in N·m"
        for name in ("gain", "offset_Nm", "std_Nm"):
            value = as_float(getattr(self, name), f"{name} of the moment sensor", in_units)
            zero = (name == "gain" and abs(value) < 1e-9) or (name == "std_Nm" and value <= 0.0)
            if zero or math.isnan(value) or (math.isinf(value) and name != "std_Nm"):
                raise InputError(f"{name} of the moment sensor is {value:g}", remedy=in_units)

    @staticmethod
    def none() -> MomentSensor:
        """The sensor of a rig without one: its readings have infinite noise."""
        return MomentSensor(1.0, 0.0, math.inf)

    @property
    def exists(self) -> bool:
        """Whether there is a sensor."""
        return math.isfinite(self.std_Nm)
