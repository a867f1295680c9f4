"""What one row of a session's tables holds, and the checks that tables share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vbaa_calib.core.errors import InputError


@dataclass(frozen=True)
class SweepPicture:
    """One picture of a board fixed in the world, with the joints at rest at these readings."""

    image: Path
    pan_rad: float
    tilt_rad: float


@dataclass(frozen=True, slots=True)
class Still:
    """One picture of the antenna with the joints at rest. `moment_Nm` is the sensor's reading.

    `time_s` is when it was taken, from any start, for the sensor's drift; None where nobody wrote it down.
    """

    image: Path | None
    pan_rad: float
    tilt_rad: float
    moment_Nm: float
    time_s: float | None = field(default=None, kw_only=True)


@dataclass(frozen=True, slots=True)
class Load(Still):
    """A known load: force components (y, z), antenna frame, hung at an arc length from the clamp."""

    distance_m: float
    force_y_N: float
    force_z_N: float


@dataclass(frozen=True, slots=True)
class Frame(Still):
    """One frame of a recording. `moment_Nm`, and `moment_z_Nm` of a second axis, are NaN where nothing was read."""

    frame: int
    time_s: float = field(kw_only=True)
    moment_z_Nm: float = field(default=np.nan, kw_only=True)


def wrong(row: Mapping[str, str], path: Path, what: str, remedy: str) -> InputError:
    """An error that names file and line of a row."""
    return InputError(what, where=f"{path} line {row['line']}", remedy=remedy)
