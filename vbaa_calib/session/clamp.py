"""A clamp that moves and turns between frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from vbaa_calib.core.arrays import Within


@dataclass(frozen=True)
class MovingClamp:
    """A clamp that moves and turns between frames: a follicle, or a probe on a hand. The picture shows its place and
    its turn about the line of sight; of the rest there are priors, as standard deviations.

    depth_std_m : of its place along the antenna frame's z.
    elevation_std_rad : of its turn out of plane C.
    roll_std_rad : of its turn about the antenna's own axis, by which the bow leaves the picture's plane.
    """

    depth_std_m: Annotated[float, Within(ge=0, le=0.1, description="of its place along the antenna frame's z")] = 1e-3
    elevation_std_rad: Annotated[float, Within(ge=0, le=0.5, description="of its turn out of plane C")] = 0.03
    roll_std_rad: Annotated[float, Within(ge=0, le=1, description="of its turn about the antenna's own axis")] = 0.1
