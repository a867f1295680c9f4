"""A moment sensor's calibration, as files give it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class MomentSensor:
    """reading = gain · moment + offset + noise of standard deviation std."""

    gain: float
    offset_Nm: float
    std_Nm: float

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> MomentSensor:
        """From a mapping that the schema has checked."""
        return MomentSensor(float(data["gain"]), float(data["offset_Nm"]), float(data["std_Nm"]))

    def to_dict(self) -> dict[str, float]:
        """The mapping that `from_dict` takes."""
        return {"gain": self.gain, "offset_Nm": self.offset_Nm, "std_Nm": self.std_Nm}
