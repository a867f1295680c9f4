"""The moment sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from vbaa_calib.core.arrays import Within


def _not_zero(gain: float) -> float:
    if abs(gain) < 1e-9:
        raise ValueError(f"{gain:g} is not between -1e+09 and 1e+09 and at least 1e-09 from 0")
    return gain


@dataclass(frozen=True)
class MomentSensor:
    """reading = gain · moment + offset + noise of standard deviation std, infinite where there is no sensor."""

    gain: Annotated[
        float,
        Within(
            _not_zero,
            ge=-1e9,
            le=1e9,
            json_schema_extra={"not": {"exclusiveMinimum": -1e-9, "exclusiveMaximum": 1e-9}},
        ),
    ]
    offset_Nm: Annotated[float, Within(ge=-1e9, le=1e9)]
    std_Nm: Annotated[float, Within(ge=1e-12, le=1e6)]

    @staticmethod
    def none() -> MomentSensor:
        """Of a rig without: no reading tells anything."""
        return MomentSensor(1.0, 0.0, math.inf)

    @property
    def exists(self) -> bool:
        """Whether there is a sensor."""
        return math.isfinite(self.std_Nm)
