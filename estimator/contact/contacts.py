"""The results of many frames: only the numbers that the data support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from estimator.table.contacts import Contact
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.rig import POSE_PARAMETERS, Rig

from .quantities import Numbers
from .verdict import NO_ANTENNA, NO_CONTACT, OK, TIP, reason, statuses


@dataclass(frozen=True, eq=False)
class Contacts(Sequence[Contact]):
    """The results of B frames by columns; as a sequence, frame by frame.

    Numbers that the data do not support are NaN.

    Attributes
    ----------
    status : (B,) of strings. distance_m, distance_std_m : (B,). force_N, force_std_N, point_antenna_m,
    point_world_m, tangent_world : (B, 3). covariance_world_m2 : (B, 3, 3). The rest is as in `Contact`.
    """

    rig: Rig
    numbers: Numbers
    status: np.ndarray
    distance_m: np.ndarray
    distance_std_m: np.ndarray
    force_N: np.ndarray
    force_std_N: np.ndarray
    deflection_m: np.ndarray
    point_antenna_m: np.ndarray
    point_world_m: np.ndarray
    covariance_world_m2: np.ndarray
    force_world_N: np.ndarray
    tangent_world: np.ndarray
    moment_residual_Nm: np.ndarray
    friction_angle_rad: np.ndarray
    friction_angle_std_rad: np.ndarray
    friction_prior_rad: float
    evidence: np.ndarray
    chosen: str

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
        numbers = self.numbers
        bias = numbers.bias[index]
        return Contact(
            status=str(self.status[index]),
            reason=reason(numbers.row(index), 0, str(self.status[index]), self.rig.antenna.length_m, self.chosen),
            model=RUNGS[numbers.rung[index]],
            in_contact=bool(numbers.finite[index]) and self.status[index] not in (NO_ANTENNA, NO_CONTACT),
            distance_m=float(self.distance_m[index]),
            distance_std_m=float(self.distance_std_m[index]),
            force_N=self.force_N[index],
            force_std_N=self.force_std_N[index],
            deflection_m=self.deflection_m[index],
            point_antenna_m=self.point_antenna_m[index],
            point_world_m=self.point_world_m[index],
            covariance_world_m2=self.covariance_world_m2[index],
            force_world_N=self.force_world_N[index],
            tangent_world=self.tangent_world[index],
            moment_residual_Nm=float(self.moment_residual_Nm[index]),
            friction_angle_rad=float(self.friction_angle_rad[index]),
            friction_angle_std_rad=float(self.friction_angle_std_rad[index]),
            friction_prior_rad=self.friction_prior_rad,
            evidence=float(self.evidence[index]),
            condition=float(numbers.condition[index]),
            bias={rung: float(value) for rung, value in zip(RUNGS, bias, strict=True) if np.isfinite(value)},
        )


def judge(
    numbers: Numbers, rig: Rig, friction_rad: float, pan_rad: np.ndarray, tilt_rad: np.ndarray, model: str
) -> Contacts:
    """The frames' results: what the fits are worth decides what is said. `model` is what was asked for."""
    status = statuses(numbers)
    located = (status == OK) | (status == TIP)
    rotation, translation = rig.kinematics.world_antenna(pan_rad, tilt_rad)
    length, sensor = rig.antenna.length_m, rig.moment_sensor

    def said(values: np.ndarray, where: np.ndarray = located) -> np.ndarray:
        return np.where(where.reshape((-1,) + (1,) * (values.ndim - 1)), values, np.nan)

    with np.errstate(invalid="ignore", over="ignore"):
        deviations = np.sqrt(np.diagonal(numbers.covariance, axis1=1, axis2=2))
        covariance = rotation @ numbers.covariance[:, :3, :3] @ np.swapaxes(rotation, 1, 2)
        if not rig.kinematics.axes_known:
            covariance = covariance + _by_axes(rig, numbers, rotation, pan_rad, tilt_rad)
        turned = np.einsum(
            "bij,bnj->bni", rotation, np.stack([numbers.point_m, numbers.force_N, numbers.tangent], axis=1)
        )
        return Contacts(
            rig=rig,
            numbers=numbers,
            status=status,
            distance_m=said(numbers.unknowns[:, 0] * length),
            distance_std_m=said(numbers.std[:, 0] * length),
            force_N=said(numbers.force_N),
            force_std_N=said(deviations[:, 3:]),
            deflection_m=said(numbers.deflection_m),
            point_antenna_m=said(numbers.point_m),
            point_world_m=said(turned[:, 0] + translation),
            covariance_world_m2=said(covariance),
            force_world_N=said(turned[:, 1]),
            tangent_world=said(turned[:, 2]),
            moment_residual_Nm=said(numbers.residual[:, 0] * sensor.std_Nm / sensor.gain, numbers.felt[:, 0]),
            friction_angle_rad=said(numbers.unknowns[:, 3] * friction_rad),
            friction_angle_std_rad=said(numbers.std[:, 3] * friction_rad),
            friction_prior_rad=friction_rad,
            evidence=said(numbers.evidence, numbers.finite),
            chosen=model,
        )


def _by_axes(rig: Rig, numbers: Numbers, rotation: np.ndarray, pan_rad: np.ndarray, tilt_rad: np.ndarray) -> np.ndarray:
    """(B, 3, 3) what the joint axes' own errors, and those they share with the camera's pose, add to world points."""
    kinematics, pose = rig.kinematics, slice(0, len(POSE_PARAMETERS))
    turned, shifted = kinematics.by_axes(pan_rad, tilt_rad)
    moved = np.einsum("kbij,bj->bik", turned, numbers.point_m) + np.moveaxis(shifted, 0, -1)
    by_pose = moved @ kinematics.axes_by_pose
    shared = rotation @ numbers.with_pose[:, :3] @ np.swapaxes(by_pose, 1, 2)
    own = (moved * kinematics.axes_std**2) @ np.swapaxes(moved, 1, 2)
    return own + by_pose @ rig.covariance[pose, pose] @ np.swapaxes(by_pose, 1, 2) + shared + np.swapaxes(shared, 1, 2)
