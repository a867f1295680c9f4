"""What is known of one frame, and of many by columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from vbaa_calib.session import Frame


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


STATUSES = (
    "ok",
    "no_contact",
    "tip_contact",
    "unobservable",
    "low_signal",
    "not_quasistatic",
    "no_antenna",
    "failed",
)
LOCATED = ("ok", "tip_contact")
"""The statuses whose contact point may be used."""


def _unknown(*shape: int) -> np.ndarray:
    return np.full(shape, np.nan)


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactRow:
    """What is known of one frame. A number that does not exist is NaN here and an empty cell in the file.

    Attributes
    ----------
    status : one of `STATUSES`; `reason` says in words why it is not "ok".
    in_contact : False also where it is not known.
    model : name of the mechanical model that was fitted.
    distance_m, distance_std_m : arc length from the clamp to the contact.
    force_y_N, force_z_N : the object's force on the antenna, antenna frame, each with its standard deviation.
    deflection_y_m, deflection_z_m : contact point less the same point of the free antenna, antenna frame.
    point_antenna_m, point_world_m : (3,) the contact on the antenna's centreline.
    covariance_world_m2 : (3, 3) of the world point.
    force_world_N : (3,) the object's force on the antenna, world frame.
    tangent_world : (3,) unit tangent of the antenna at the contact, towards the tip.
    pan_rad, tilt_rad : joint angles.
    moment_residual_Nm : reading less what the fitted contact predicts.
    friction_angle_rad, friction_angle_std_rad : of the force from the antenna's normal at the contact, positive towards
        the clamp.
    bias_std : the model's predicted bias in standard deviations of what it moves most.
    friction_prior_rad : deviation of the friction angle that was thought possible beforehand.
    evidence : of a contact against the free antenna, see `Contact`; given for every frame that could be fitted.
    condition : condition number of what the data say of distance, force and friction.
    """

    frame: int
    time_s: float
    status: str
    in_contact: bool = False
    model: str = ""
    distance_m: float = np.nan
    distance_std_m: float = np.nan
    force_y_N: float = np.nan
    force_y_std_N: float = np.nan
    force_z_N: float = np.nan
    force_z_std_N: float = np.nan
    deflection_y_m: float = np.nan
    deflection_z_m: float = np.nan
    point_antenna_m: np.ndarray = field(default_factory=lambda: _unknown(3))
    point_world_m: np.ndarray = field(default_factory=lambda: _unknown(3))
    covariance_world_m2: np.ndarray = field(default_factory=lambda: _unknown(3, 3))
    force_world_N: np.ndarray = field(default_factory=lambda: _unknown(3))
    tangent_world: np.ndarray = field(default_factory=lambda: _unknown(3))
    pan_rad: float = np.nan
    tilt_rad: float = np.nan
    moment_residual_Nm: float = np.nan
    friction_angle_rad: float = np.nan
    friction_angle_std_rad: float = np.nan
    bias_std: float = np.nan
    condition: float = np.nan
    friction_prior_rad: float = np.nan
    evidence: float = np.nan
    reason: str = ""

    @staticmethod
    def of(frame: Frame, contact: Contact) -> ContactRow:
        """The row of one estimated frame."""
        return ContactRow(
            frame=frame.frame,
            time_s=frame.time_s,
            status=contact.status,
            in_contact=contact.in_contact,
            model=contact.model,
            distance_m=contact.distance_m,
            distance_std_m=contact.distance_std_m,
            force_y_N=contact.force_N[1],
            force_y_std_N=contact.force_std_N[1],
            force_z_N=contact.force_N[2],
            force_z_std_N=contact.force_std_N[2],
            deflection_y_m=contact.deflection_m[1],
            deflection_z_m=contact.deflection_m[2],
            point_antenna_m=contact.point_antenna_m,
            point_world_m=contact.point_world_m,
            covariance_world_m2=contact.covariance_world_m2,
            force_world_N=contact.force_world_N,
            tangent_world=contact.tangent_world,
            pan_rad=frame.pan_rad,
            tilt_rad=frame.tilt_rad,
            moment_residual_Nm=contact.moment_residual_Nm,
            friction_angle_rad=contact.friction_angle_rad,
            friction_angle_std_rad=contact.friction_angle_std_rad,
            bias_std=contact.predicted_bias_std,
            condition=contact.condition,
            friction_prior_rad=contact.friction_prior_rad,
            evidence=contact.evidence,
            reason=contact.reason,
        )


@dataclass(frozen=True, eq=False)
class ContactTable:
    """`ContactRow` by columns for B frames: (B,), (B, 3) or (B, 3, 3); NaN where a number does not exist."""

    frame: np.ndarray
    time_s: np.ndarray
    status: np.ndarray
    in_contact: np.ndarray
    model: np.ndarray
    distance_m: np.ndarray
    distance_std_m: np.ndarray
    force_y_N: np.ndarray
    force_y_std_N: np.ndarray
    force_z_N: np.ndarray
    force_z_std_N: np.ndarray
    deflection_y_m: np.ndarray
    deflection_z_m: np.ndarray
    point_antenna_m: np.ndarray
    point_world_m: np.ndarray
    covariance_world_m2: np.ndarray
    force_world_N: np.ndarray
    tangent_world: np.ndarray
    pan_rad: np.ndarray
    tilt_rad: np.ndarray
    moment_residual_Nm: np.ndarray
    friction_angle_rad: np.ndarray
    friction_angle_std_rad: np.ndarray
    bias_std: np.ndarray
    condition: np.ndarray
    friction_prior_rad: np.ndarray
    evidence: np.ndarray
    reason: np.ndarray

    @staticmethod
    def from_rows(rows: Sequence[ContactRow]) -> ContactTable:
        """The same rows, at least one, as columns."""
        return ContactTable(**{f.name: np.array([getattr(row, f.name) for row in rows]) for f in fields(ContactTable)})

    @staticmethod
    def joined(parts: Sequence[ContactTable]) -> ContactTable:
        """The rows of several tables, at least one, one after the other."""
        names = [f.name for f in fields(ContactTable)]
        return ContactTable(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def assumed_friction_rad(self) -> float:
        """The friction that the contacts were estimated with; what is usual where the table does not say."""
        told = self.friction_prior_rad[np.isfinite(self.friction_prior_rad)]
        return float(np.median(told)) if len(told) else FRICTION_RAD

    @property
    def located(self) -> np.ndarray:
        """(B,) bool: the contact point of this frame may be used."""
        return np.isin(self.status, LOCATED)
