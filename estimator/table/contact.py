"""One frame's result: a contact, or why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

FRICTION_RAD = 0.2
"""Deviation of the friction angle that is thought possible where nothing else is said: most contacts of steel have
friction coefficients below 0.4."""


def _unknown_vector() -> np.ndarray:
    return np.full(3, np.nan)


def _unknown_matrix() -> np.ndarray:
    return np.full((3, 3), np.nan)


@dataclass(frozen=True, eq=False)
class Contact:
    """One frame's result. Numbers that the data do not support are NaN; `reason` says why.

    Attributes
    ----------
    status : ok, no_contact, tip_contact, unobservable, low_signal, not_quasistatic, no_antenna or failed.
    reason : the same in words; also says why this model was taken.
    model : the rung of the ladder, `antenna.rungs.RUNGS`.
    distance_m, distance_std_m : arc length from the clamp to the contact.
    force_N, force_std_N : (3,) the object's force on the antenna, antenna frame.
    deflection_m : (3,) contact point less the same point of the free antenna, antenna frame.
    point_antenna_m, point_world_m : (3,) contact point on the centreline.
    covariance_world_m2 : (3, 3) of the world point.
    force_world_N : (3,). tangent_world : (3,) unit tangent of the antenna at the contact, towards the tip.
    moment_residual_Nm : reading less what the fitted contact predicts, in true N·m; NaN without a reading.
    friction_angle_rad, friction_angle_std_rad : the force's angle from the antenna's normal at the contact, positive
        towards the clamp. Where the data say nothing of it, what was thought possible beforehand.
    friction_prior_rad : deviation of the friction angle that was thought possible beforehand.
    evidence : how much better a contact explains the frame than the free antenna: half the difference of the squared
        misfits, the rig free within its covariance in both. Without contact it is 1.5 to 2 on average.
    condition : condition number of what the data say of distance, force and friction, each scaled to unit deviation.
    bias : predicted bias of the rungs that were weighed, in standard deviations of distance or force.
    """

    status: str
    reason: str
    model: str
    in_contact: bool
    distance_m: float = np.nan
    distance_std_m: float = np.nan
    force_N: np.ndarray = field(default_factory=_unknown_vector)
    force_std_N: np.ndarray = field(default_factory=_unknown_vector)
    deflection_m: np.ndarray = field(default_factory=_unknown_vector)
    point_antenna_m: np.ndarray = field(default_factory=_unknown_vector)
    point_world_m: np.ndarray = field(default_factory=_unknown_vector)
    covariance_world_m2: np.ndarray = field(default_factory=_unknown_matrix)
    force_world_N: np.ndarray = field(default_factory=_unknown_vector)
    tangent_world: np.ndarray = field(default_factory=_unknown_vector)
    moment_residual_Nm: float = np.nan
    friction_angle_rad: float = np.nan
    friction_angle_std_rad: float = np.nan
    friction_prior_rad: float = np.nan
    evidence: float = np.nan
    condition: float = np.nan
    bias: Mapping[str, float] = field(default_factory=dict)

    @property
    def predicted_bias_std(self) -> float:
        """Predicted bias of the model that was taken, in standard deviations; NaN where it was not weighed."""
        return float(self.bias.get(self.model, np.nan))


@dataclass(frozen=True, eq=False)
class Measured:
    """What one frame offers.

    Attributes
    ----------
    points_px, sigma_px : (N, 2) on the centreline, and their deviations (N,) across the antenna.
    moment_Nm : about y, NaN without a sensor. moment_z_Nm : about z, NaN without a second one.
    pan_rad, tilt_rad : joint angles.
    time_s : NaN where not known; a recording's frames are then taken as static.
    start : (4,) unknowns near the truth, as `ContactEstimator.rough` gives them; NaN where nobody has looked before.
    """

    points_px: np.ndarray
    sigma_px: np.ndarray
    moment_Nm: float
    pan_rad: float
    tilt_rad: float
    moment_z_Nm: float = np.nan
    time_s: float = np.nan
    start: np.ndarray = field(default_factory=lambda: np.full(4, np.nan))
