"""A calibrated rig as plain arrays, and in the core's form."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS as ANTENNA_PARAMETERS
from vbaa_calib.camera import Camera
from vbaa_calib.camera.lens import lens_of
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, RIG_STEPS, MomentSensor, Rig, WrenchSensor
from vbaa_calib.session import READINGS

POSES, ANTENNA = len(POSE_PARAMETERS), len(ANTENNA_PARAMETERS)
UNKNOWNS = 4
"""Distance in antenna lengths, lateral force (y, z of the clamp's frame) in `RigArrays.force_unit_N`, friction angle in
standard deviations of its prior."""
LINE_ERRORS = 3


@dataclass(frozen=True, eq=False)
class RigArrays:
    """Prior knowledge of a rig, before any frame.

    Attributes
    ----------
    friction_rad : standard deviation of the contact force's angle from the antenna's normal; 0: no friction.
    axes : (17 + P, R) independent steps of the rig's parameters and the lens, each of unit standard deviation:
        axes @ axes.T is their covariance. R is 0 for a rig without uncertainty. (18 + P, R) with the tip's offset. Of
        several cameras some columns are zero.
    std : (K,) of the readings, as `sensors` and the antenna's end; 1 for a missing one.
    by_wrench : (7, 7) the readings, in their deviations, by force and moment at the clamp, and 1; 0 for a missing one.
    by_sensor : (2 + W, 7, 7) the same by a unit of the sensors' parameters: the moment's gain and offset, and the W of
        a wrench sensor.
    line : (V, L) deviations of the found line's errors that neighbours share, in each camera's ideal picture: its
        offset, slope and curvature, or none. They are the last of the R + V L steps of each frame, which has its own.
    most_information : sum of one over the variances of a frame's ideal points up to which the axes are enough.
    """

    rig: Rig
    friction_rad: float
    axes: np.ndarray
    std: np.ndarray
    by_wrench: np.ndarray
    by_sensor: np.ndarray
    line: np.ndarray
    most_information: float = field(default=np.inf, kw_only=True)

    @staticmethod
    def from_rig(rig: Rig, friction_rad: float, drift: bool = True) -> RigArrays:
        """The arrays of a rig. drift : whether the rig may have changed since its calibration, lines have errors of
        their own, and the antenna's end counts."""
        rig = rig.drifted() if drift else replace(rig, tip=None)
        axes = rig.axes
        size = np.abs(axes).max(axis=0)
        axes = axes[:, size > 1e-9 * max(float(size.max()), 1e-300)]  # smaller ones are rounding
        axes = _by_vectors(axes, rig) if rig.others else axes
        line_px = np.hypot(rig.drift.line_px, rig.drift.light_px) if drift else 0.0
        focal = [_focal_px(one.camera) for one in rig.cameras.values()]
        own = np.array([np.full(LINE_ERRORS if line_px > 0.0 else 0, line_px / each) for each in focal])
        return RigArrays(rig, friction_rad, *map(np.ascontiguousarray, (axes, *_reading(rig), own)))

    @cached_property
    def core(self) -> Any:
        """The rig in the core's form; `structs.hpp` explains its fields."""
        rig = self.rig
        fields = SimpleNamespace(
            **{
                name: getattr(self, name)
                for name in ("friction_rad", "axes", "by_wrench", "by_sensor", "most_information")
            },
            length_m=self.length_m,
            radius_m=0.5 * rig.antenna.diameter_m,
            force_unit_N=self.force_unit_N,
            unit_load=self.unit_load,
            tip_offset_m=0.0 if rig.tip is None else rig.tip.offset_m,
            stiffness_Nm2=rig.antenna.stiffness_Nm2,
            taper=rig.antenna.taper.pieces,
            with_tip=rig.tip is not None,
            with_wrench=rig.wrench_sensor is not None,
            readings=len(self.std),
            std=np.append(self.std, np.ones(core.solver.END + 5 - len(self.std))),
            with_lens=bool(rig.with_lens),
            antenna_parameters=np.array(rig.antenna.parameters, float),
            antenna_steps=np.array(RIG_STEPS[POSES : POSES + ANTENNA], float),
            by_pose_step=np.append(1.0 / np.array(RIG_STEPS[:POSES]), [0.0, 0.0]),
        )
        y_m, z_m, about_y, about_z = rig.antenna.parameters[:4]
        T_antenna_clamp = Pose.from_rotvec(np.array([0.0, about_y, about_z]), np.array([0.0, y_m, z_m]))
        cameras = zip(rig.cameras.values(), self.line, strict=True)
        return core.solver.Rig(fields, tuple(_camera(one, T_antenna_clamp, line) for one, line in cameras))

    @cached_property
    def exact(self) -> RigArrays:
        """The rig without uncertainty."""
        return replace(self, axes=self.axes[:, :0], line=self.line[:, :0])

    @cached_property
    def sensors(self) -> np.ndarray:
        """(S,) indices among the core's readings of those of `session.READINGS` for which the rig has space."""
        return np.delete(np.arange(len(self.std)), core.solver.END)

    @cached_property
    def exists(self) -> np.ndarray:
        """(S,) mask of `sensors` that the rig has."""
        return np.asarray(self.by_wrench[self.sensors].any(axis=1))

    @cached_property
    def independent(self) -> int:
        """Number of error steps without the columns of zeros."""
        return int(self.axes.any(axis=0).sum()) + self.line.size

    @property
    def steps(self) -> int:
        """Number R + V L of error steps."""
        return self.axes.shape[1] + self.line.size

    @property
    def length_m(self) -> float:
        """Length of the antenna."""
        return self.rig.antenna.length_m

    @property
    def force_unit_N(self) -> float:
        """A force that bends the tip by about a hundredth of the length."""
        antenna = self.rig.antenna
        return 0.03 * antenna.stiffness_Nm2 / (float(antenna.taper.yielding(np.ones(1))[0]) * antenna.length_m**2)

    @property
    def unit_load(self) -> float:
        """F·l²/EI of a unit force at the tip."""
        return self.force_unit_N * self.length_m**2 / self.rig.antenna.stiffness_Nm2


def _by_vectors(axes: np.ndarray, rig: Rig) -> np.ndarray:
    """Axes (Q, R) of several cameras, padded with columns of zeros so that all columns in one of the core's vectors of
    eight concern the same cameras: a picture skips the vectors of the others."""
    lenses = [len(one.camera.parameter_names) * rig.with_lens for one in rig.cameras.values()]
    at = len(axes) - sum(POSES + count for count in lenses[1:])
    own = [np.r_[:POSES, len(RIG_PARAMETERS) : len(RIG_PARAMETERS) + lenses[0]]]
    own += [np.arange(at, at := at + POSES + count) for count in lenses[1:]]
    moved = np.array([axes[rows].any(axis=0) for rows in own])
    wide = np.zeros((len(axes), 0))
    for part in np.split(axes, np.flatnonzero((moved[:, 1:] != moved[:, :-1]).any(axis=0)) + 1, axis=1):
        gap = -(UNKNOWNS + wide.shape[1]) % 8 if wide.size else 0
        wide = np.hstack([np.pad(wide, ((0, 0), (0, gap))), part])
    return wide


def _focal_px(camera: Camera) -> Any:
    """Mean focal length."""
    return np.sqrt(np.prod(np.diag(camera.matrix)[:2]))


def _camera(one: Rig, T_antenna_clamp: Pose, line: np.ndarray) -> SimpleNamespace:
    """The core's `Camera`."""
    # the pose moved along each axis of its tangent; lanes are eight
    steps = np.diag(np.append(RIG_STEPS[:POSES], [0.0, 0.0]))[:, :POSES]
    moved = [one.T_antenna_camera.retract(step).inverse() for step in steps]
    lanes = [np.column_stack([pose.rotation, pose.translation_m]) for pose in moved]
    side = one.T_antenna_camera.translation_m[1:]
    return SimpleNamespace(
        lens=lens_of(one.camera.intrinsics),
        pose_lanes=np.ascontiguousarray(np.stack(lanes, axis=-1)),
        rotation=np.ascontiguousarray(lanes[-1][:, :3]),
        translation_m=np.ascontiguousarray(lanes[-1][:, 3]),
        to_camera=side / max(float(np.hypot(*side)), 1e-12),
        eye_m=np.ascontiguousarray(T_antenna_clamp.inverse() @ one.T_antenna_camera.translation_m),
        focal=_focal_px(one.camera),
        line=line,
    )


def _reading(rig: Rig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`RigArrays.std`, `by_wrench` and `by_sensor` of a rig. For the moment about y alone there is space for one
    more moment and the antenna's end; a wrench sensor has space for all."""
    noise, sensor, more = np.array(rig.reading_noise), rig.moment_sensor, rig.wrench_sensor
    gain, slots = sensor.gain if sensor.exists else 0.0, np.delete(np.arange(len(noise) + 1), core.solver.END)
    std = np.where(noise > 0.0, noise, 1.0)
    axes = np.zeros((len(noise), 7))
    axes[:, :6] = (WrenchSensor.about_z(MomentSensor(1.0, 0.0, 1.0)) if more is None else more).axes
    own = np.zeros((2, *axes.shape))
    # the moment about y is x·f_z − z·f_x
    own[0, 0], own[1, 0, 6] = -axes[0] * (gain != 0.0), 1.0
    by_wrench = np.zeros_like(axes)
    by_wrench[0] = -gain * axes[0]
    by_wrench[0, 6] = sensor.offset_Nm if gain else 0.0
    if more is not None:
        which = [list(READINGS).index(name) for name in more.components]
        by_wrench[which] = more.gain[:, None] * axes[which]
        by_wrench[which, 6] = more.offset
        own = np.concatenate([own, more.slopes(gain)])
    whole = np.zeros((len(own) + 1, len(noise) + 1, 7))
    whole[:, slots] = np.concatenate([by_wrench[None], own]) / std[:, None]
    used = slots[: 2 if more is None else None]
    return np.insert(std[: len(used)], core.solver.END, 1.0), whole[0], whole[1:]
