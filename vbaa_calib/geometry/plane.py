"""Planes as n·x = d."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Plane:
    """The points x with normal·x = offset_m, in one frame; the normal (3,) is a unit vector."""

    normal: np.ndarray
    offset_m: float


PLANE_C = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
"""The calibration plane C in the antenna frame: z = 0."""


def hinge_plane(roll_rad: float) -> Plane:
    """The deformation plane 𝒟 in the antenna frame: through the x axis, turned by the roll ξ from plane C."""
    return Plane(np.array([0.0, -np.sin(roll_rad), np.cos(roll_rad)]), 0.0)
