"""The results of many frames: only the numbers that the data support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import overload

import numpy as np

from estimator.table.contacts import Contact, ContactEstimate
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.rig import POSE_PARAMETERS, Rig

from .quantities import FitNumbers
from .status import NO_ANTENNA, NO_CONTACT, OK, TIP, reason, statuses


@dataclass(frozen=True, eq=False, kw_only=True)
class Contacts(ContactEstimate[np.ndarray, np.ndarray, np.ndarray], Sequence[Contact]):
    """The results of B frames: a sequence of `Contact`, and its numbers as arrays with a leading axis B.

    Numbers that the data do not support are NaN. `numbers` are the fits themselves; `requested` is the model that was
    asked for.
    """

    rig: Rig
    numbers: FitNumbers
    requested: str

    def __len__(self) -> int:
        return len(self.status)

    @overload
    def __getitem__(self, index: int) -> Contact: ...
    @overload
    def __getitem__(self, index: slice) -> list[Contact]: ...
    def __getitem__(self, index: int | slice) -> Contact | list[Contact]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        values = {f.name: getattr(self, f.name)[index] for f in fields(ContactEstimate)}
        numbers = self.numbers.row(index)
        bias = zip(RUNGS, numbers.bias[0].tolist(), strict=True)
        return Contact(
            reason=reason(numbers, str(self.status[index]), self.rig.antenna.length_m, self.requested),
            bias={rung: value for rung, value in bias if np.isfinite(value)},
            **{name: value if np.ndim(value) else value.item() for name, value in values.items()},
        )


def contacts_of(
    numbers: FitNumbers, rig: Rig, friction_rad: float, pan_rad: np.ndarray, tilt_rad: np.ndarray, model: str
) -> Contacts:
    """The frames' results: their statuses decide which numbers are given. `model` is what was asked for."""
    status = statuses(numbers)
    located = (status == OK) | (status == TIP)
    rotation, translation = rig.kinematics.world_antenna(pan_rad, tilt_rad)
    length, sensor = rig.antenna.length_m, rig.moment_sensor

    def given(values: np.ndarray, where: np.ndarray = located) -> np.ndarray:
        return np.where(where.reshape((-1,) + (1,) * (values.ndim - 1)), values, np.nan)

    with np.errstate(invalid="ignore", over="ignore"):
        deviations = _deviations(numbers.covariance)
        covariance = rotation @ numbers.covariance[:, :3, :3] @ np.swapaxes(rotation, 1, 2)
        if not rig.kinematics.axes_known:
            covariance = covariance + _by_axes(rig, numbers, rotation, rig.kinematics.by_axes(pan_rad, tilt_rad))
        turned = np.einsum(
            "bij,bnj->bni", rotation, np.stack([numbers.point_m, numbers.force_N, numbers.tangent], axis=1)
        )
        moment = numbers.residual[:, 0] * sensor.std_Nm / sensor.gain
        return Contacts(
            rig=rig,
            numbers=numbers,
            requested=model,
            status=status,
            in_contact=numbers.finite & ~np.isin(status, (NO_ANTENNA, NO_CONTACT)),
            model=np.array(RUNGS)[numbers.rung],
            distance_m=given(numbers.unknowns[:, 0] * length),
            distance_std_m=given(numbers.std[:, 0] * length),
            distance_shared_std_m=given(numbers.shared_std * length),
            point_shared_std_m=given(_deviations(rotation @ numbers.shared[:, :3, :3] @ np.swapaxes(rotation, 1, 2))),
            force_covariance_yz_N2=given(numbers.covariance[:, 4, 5]),
            force_shared_std_N=given(_deviations(numbers.shared[:, 3:, 3:])),
            force_N=given(numbers.force_N),
            force_std_N=given(deviations[:, 3:]),
            deflection_m=given(numbers.deflection_m),
            point_antenna_m=given(numbers.point_m),
            point_world_m=given(turned[:, 0] + translation),
            covariance_world_m2=given(covariance),
            force_world_N=given(turned[:, 1]),
            tangent_world=given(turned[:, 2]),
            moment_residual_Nm=given(moment, numbers.sensor_available[:, 0]),
            friction_angle_rad=given(numbers.unknowns[:, 3] * friction_rad),
            friction_angle_std_rad=given(numbers.std[:, 3] * friction_rad),
            friction_prior_rad=np.full(len(status), friction_rad),
            evidence=given(numbers.evidence, numbers.finite),
            condition=numbers.condition,
        )


def _deviations(covariance: np.ndarray) -> np.ndarray:
    """(B, K) roots of the diagonals of covariances (B, K, K)."""
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))


def _by_axes(rig: Rig, numbers: FitNumbers, rotation: np.ndarray, by_axes: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(B, 3, 3) added to the covariance of world points by errors of the joint axes, their own and the pose's."""
    kinematics, pose = rig.kinematics, slice(0, len(POSE_PARAMETERS))
    turned, shifted = by_axes
    moved = np.einsum("kbij,bj->bik", turned, numbers.point_m) + np.moveaxis(shifted, 0, -1)
    by_pose = moved @ kinematics.axes_by_pose
    shared = rotation @ numbers.with_pose[:, :3] @ np.swapaxes(by_pose, 1, 2)
    own = (moved * kinematics.axes_std**2) @ np.swapaxes(moved, 1, 2)
    return own + by_pose @ rig.covariance[pose, pose] @ np.swapaxes(by_pose, 1, 2) + shared + np.swapaxes(shared, 1, 2)
