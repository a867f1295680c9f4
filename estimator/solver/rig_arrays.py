"""A calibrated rig as plain arrays, ready for compiled functions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS as ANTENNA_PARAMETERS
from vbaa_calib.camera.compiled_lens import CompiledLens, compiled_lens
from vbaa_calib.core.compiled import compiled, record
from vbaa_calib.core.lanes import LANES
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.independent_axes import independent_axes
from vbaa_calib.rig import POSE_PARAMETERS, RIG_STEPS, Rig

POSES, ANTENNA = len(POSE_PARAMETERS), len(ANTENNA_PARAMETERS)
UNKNOWNS = 4
"""Distance in antenna lengths, lateral force (y, z of the clamp's frame) in `RigArrays.force_unit_N`, friction angle in
standard deviations of its prior."""
LINE_ERRORS = 3
TIP_DEFLECTION_STD = 0.3
"""Prior on the tip's deflection, in antenna lengths: it only matters where the data do not hold the force."""
_NEGLIGIBLE = 1e-9
"""Axes of the joint covariance below this fraction of the largest are dropped."""


class _RigTables(NamedTuple):
    """What compiled functions know of the rig, see `RigArrays`.

    Attributes
    ----------
    length_m, friction_rad, force_unit_N, unit_load, tip_offset_m, stiffness_Nm2 : numbers.
    with_tip, with_second_sensor, with_lens : bool, whether the rig knows the antenna's end, a sensor about z, and the
        lens' uncertainty.
    pose_lanes : (3, 4, L) rotation and translation into the camera of poses moved along each of their tangent's axes;
        by_pose_step : (L,) one over the steps, zeros after the sixth.
    wide_axes : (Q, K) the axes, with zeros to whole vectors.
    to_camera : (2,) unit direction across the antenna's x axis to the camera.
    eye_m : (3,) the camera's centre in the clamp's frame. focal : its mean focal length, px.
    """

    length_m: float
    friction_rad: float
    force_unit_N: float
    unit_load: float
    tip_offset_m: float
    stiffness_Nm2: float
    with_tip: bool
    with_second_sensor: bool
    with_lens: bool
    antenna_parameters: np.ndarray
    antenna_steps: np.ndarray
    pose_lanes: np.ndarray
    by_pose_step: np.ndarray
    rotation: np.ndarray
    translation_m: np.ndarray
    gain: np.ndarray
    offset: np.ndarray
    std: np.ndarray
    axes: np.ndarray
    wide_axes: np.ndarray
    line: np.ndarray
    to_camera: np.ndarray
    eye_m: np.ndarray
    focal: float


RigRecord = record(_RigTables)


@compiled
def tip_deflection(rig, distance):
    """Small deflection of the tip by a unit force at a distance, both in antenna lengths."""
    return rig.unit_load / 6.0 * distance * distance * (3.0 - distance)


@dataclass(frozen=True, eq=False)
class RigArrays:
    """What is known before a frame is seen.

    Attributes
    ----------
    friction_rad : standard deviation of the contact force's angle from the antenna's normal; 0: no friction.
    axes : (17 + P, R) independent steps of the rig's parameters and the lens, each of unit standard deviation:
        axes @ axes.T is their covariance. R is 0 for a rig without uncertainty. (18 + P, R) with the tip's offset.
    gain, offset, std : (2,) of the moment sensors about y and z; a missing one has the gain 0.
    line : (L,) deviations of the found line's errors that neighbours share, in the ideal picture: its offset, slope and
        curvature, or none. They are the last of the R + L steps of each frame, and each frame has its own.
    """

    rig: Rig
    friction_rad: float
    axes: np.ndarray
    gain: np.ndarray
    offset: np.ndarray
    std: np.ndarray
    line: np.ndarray

    @staticmethod
    def from_rig(rig: Rig, friction_rad: float, drift: bool = True) -> RigArrays:
        """drift : whether the rig may have changed since its calibration, lines have errors of their own, and the
        antenna's end counts."""
        rig = rig.drifted() if drift else replace(rig, tip=None)
        axes = independent_axes(rig.covariance_with_tip)
        size = np.abs(axes).max(axis=0)
        axes = axes[:, size > _NEGLIGIBLE * max(float(size.max()), 1e-300)]
        sensors = (rig.moment_sensor, rig.second_moment_sensor)
        gain, offset, std = np.array([(s.gain, s.offset_Nm, s.std_Nm) if s else (0.0, 0.0, 1.0) for s in sensors]).T
        focal = np.sqrt(np.prod(np.diag(rig.camera.matrix)[:2]))
        line_px = np.hypot(rig.drift.line_px, rig.drift.light_px) if drift else 0.0
        own = np.full(LINE_ERRORS if line_px > 0.0 else 0, line_px / focal)
        return RigArrays(rig, friction_rad, *map(np.ascontiguousarray, (axes, gain, offset, std, own)))

    @cached_property
    def tables(self) -> _RigTables:
        """For compiled functions."""
        rig = self.rig
        poses = [rig.T_antenna_camera] + [rig.T_antenna_camera.retract(step) for step in np.diag(RIG_STEPS[:POSES])]
        inverses = [pose.inverse() for pose in poses]
        moved = [np.column_stack([pose.rotation, pose.translation_m]) for pose in inverses[1:]]
        lanes = [*moved, *[moved[0]] * (LANES - POSES)]
        y_m, z_m, about_y, about_z = rig.antenna.parameters[:4]
        T_antenna_clamp = Pose.from_rotvec(np.array([0.0, about_y, about_z]), np.array([0.0, y_m, z_m]))
        side = rig.T_antenna_camera.translation_m[1:]
        return _RigTables(
            length_m=float(self.length_m),
            friction_rad=float(self.friction_rad),
            force_unit_N=float(self.force_unit_N),
            unit_load=float(self.unit_load),
            tip_offset_m=0.0 if rig.tip is None else float(rig.tip.offset_m),
            stiffness_Nm2=float(rig.antenna.stiffness_Nm2),
            with_tip=rig.tip is not None,
            with_second_sensor=rig.second_moment_sensor is not None,
            with_lens=bool(rig.with_lens),
            antenna_parameters=np.array(rig.antenna.parameters, float),
            antenna_steps=np.array(RIG_STEPS[POSES : POSES + ANTENNA], float),
            pose_lanes=np.ascontiguousarray(np.stack(lanes, axis=-1)),
            by_pose_step=np.pad(1.0 / np.array(RIG_STEPS[:POSES], float), (0, LANES - POSES)),
            rotation=np.ascontiguousarray(inverses[0].rotation),
            translation_m=np.ascontiguousarray(inverses[0].translation_m),
            gain=self.gain,
            offset=self.offset,
            std=self.std,
            axes=self.axes,
            wide_axes=np.pad(self.axes, ((0, 0), (0, -self.axes.shape[1] % LANES))),
            line=self.line,
            to_camera=np.array(side / max(float(np.hypot(*side)), 1e-12), float),
            eye_m=np.ascontiguousarray(T_antenna_clamp.inverse() @ rig.T_antenna_camera.translation_m),
            focal=float(np.sqrt(np.prod(np.diag(rig.camera.matrix)[:2]))),
        )

    @cached_property
    def lens(self) -> CompiledLens:
        """The camera's, for compiled functions."""
        return compiled_lens(self.rig.camera.intrinsics)

    @cached_property
    def exact(self) -> RigArrays:
        """The same rig as if it were known exactly."""
        return replace(self, axes=self.axes[:, :0], line=self.line[:0])

    @property
    def steps(self) -> int:
        """R + L."""
        return self.axes.shape[1] + len(self.line)

    @property
    def length_m(self) -> float:
        """The antenna's."""
        return self.rig.antenna.length_m

    @property
    def force_unit_N(self) -> float:
        """A force that bends the tip by about a hundredth of the length."""
        return 0.03 * self.rig.antenna.stiffness_Nm2 / self.rig.antenna.length_m**2

    @property
    def unit_load(self) -> float:
        """F·l²/EI of a unit force at the tip."""
        return self.force_unit_N * self.length_m**2 / self.rig.antenna.stiffness_Nm2
