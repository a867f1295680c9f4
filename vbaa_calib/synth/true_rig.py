"""How the simulated antenna and its moment sensor really are: what a calibration has to find out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class TrueAntenna:
    """How the simulated antenna differs from what session.yaml says of it.

    Attributes
    ----------
    stiffness_factor : true EI over nominal EI.
    clamp_angle_rad : (2,) turn of the clamped tangent about the antenna frame's y and z axes.
    clamp_offset_m : (3,) the clamp in the antenna frame.
    natural_curvature_per_m : (2,) bow of the unloaded, weightless wire about its own y and z axes.
    holder_m : (2,) radius and length of the dark collet that holds the antenna; zeros for none.
    """

    stiffness_factor: float
    clamp_angle_rad: np.ndarray
    clamp_offset_m: np.ndarray
    natural_curvature_per_m: np.ndarray
    holder_m: np.ndarray


@dataclass(frozen=True)
class MomentSensor:
    """The sensor reads gain · moment + offset + noise."""

    std_Nm: float
    gain: float
    offset_Nm: float
