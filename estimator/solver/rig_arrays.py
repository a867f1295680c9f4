"""A calibrated rig as arrays of one kind on one device, ready for many frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS as ANTENNA_PARAMETERS
from vbaa_calib.core.arrays import Array, like, namespace
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


@dataclass(frozen=True, eq=False)
class RigArrays:
    """What is known before a frame is seen.

    Attributes
    ----------
    friction_rad : standard deviation of the contact force's angle from the antenna's normal; 0: no friction.
    antenna_parameters : (9,) `antenna.shape.PARAMETERS`.
    axes : (17 + P, R) independent steps of the rig's parameters and the lens, each of unit standard deviation:
        axes @ axes.T is their covariance. R is 0 for a rig without uncertainty. (18 + P, R) with the tip's offset.
    tip_offset_m : of the antenna's visible end beyond its length; 0 where it is not used.
    rotations, translations : (7, 3, 3), (7, 3) of T_camera_antenna, and of the six finite-difference steps of it.
    gain, offset, std : (2,) of the moment sensors about y and z; a missing one has the gain 0.
    antenna_steps : (1 + 9, 9) finite-difference steps of the antenna's parameters; the first row is zero.
    unit_steps : (1 + 4, 4) unit steps of the unknowns; the first row is zero.
    prior : (4 + R + L,) prior weights of the unknowns' and rig steps' squares; distance and force have none.
    identity : (R + L, R + L).
    line : (L,) deviations of the found line's errors that neighbours share, in the ideal picture: its offset, slope and
        curvature, or none. They are the last of the R + L steps of each frame, and each frame has its own.
    """

    rig: Rig
    friction_rad: float
    tip_offset_m: float
    antenna_parameters: Array
    axes: Array
    rotations: Array
    translations: Array
    gain: Array
    offset: Array
    std: Array
    antenna_steps: Array
    unit_steps: Array
    prior: Array
    identity: Array
    line: Array
    same_for_all_rows: ClassVar[bool] = True

    @staticmethod
    def from_rig(rig: Rig, friction_rad: float, reference: Array, drift: bool = True) -> RigArrays:
        """The rig in the kind, precision and device of a reference array.

        drift : whether it may have changed since its calibration, lines have errors of their own, and the antenna's
            end counts.
        """
        rig = rig.drifted() if drift else replace(rig, tip=None)
        poses = [rig.T_antenna_camera] + [rig.T_antenna_camera.retract(step) for step in np.diag(RIG_STEPS[:POSES])]
        inverses = [pose.inverse() for pose in poses]
        axes = independent_axes(rig.covariance_with_tip)
        size = np.abs(axes).max(axis=0)
        axes = axes[:, size > _NEGLIGIBLE * max(float(size.max()), 1e-300)]
        sensors = (rig.moment_sensor, rig.second_moment_sensor)
        gain, offset, std = np.array([(s.gain, s.offset_Nm, s.std_Nm) if s else (0.0, 0.0, 1.0) for s in sensors]).T
        focal = np.sqrt(np.prod(np.diag(rig.camera.matrix)[:2]))
        line_px = np.hypot(rig.drift.line_px, rig.drift.light_px) if drift else 0.0
        own = np.full(LINE_ERRORS if line_px > 0.0 else 0, line_px / focal)
        steps = axes.shape[1] + len(own)
        arrays = (
            rig.antenna.parameters,
            axes,
            np.stack([pose.rotation for pose in inverses]),
            np.stack([pose.translation_m for pose in inverses]),
            gain,
            offset,
            std,
            np.vstack([np.zeros(ANTENNA), np.diag(RIG_STEPS[POSES:])]),
            np.vstack([np.zeros(UNKNOWNS), np.eye(UNKNOWNS)]),
            np.repeat([0.0, 1.0], [UNKNOWNS - 1, steps + 1]),
            np.eye(steps),
            own,
        )
        values = (like(reference, np.ascontiguousarray(each)) for each in arrays)
        return RigArrays(rig, friction_rad, 0.0 if rig.tip is None else rig.tip.offset_m, *values)

    def zero_rig_steps(self, count: int) -> Array:
        """(count, R + L) rig steps of a rig as calibrated, and no error of the line."""
        return namespace(self.prior).broadcast_to(0.0 * self.prior[UNKNOWNS:], (count, self.steps))

    @property
    def steps(self) -> int:
        """R + L."""
        return self.axes.shape[1] + self.line.shape[0]

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

    def tip_deflection(self, distance: Array) -> Array:
        """Small deflection of the tip by unit forces at distances, all in antenna lengths."""
        return self.unit_load / 6.0 * distance * distance * (3.0 - distance)

    def moment_response(self, moment_Nm: Array) -> Array:
        """(2, G, 2) what the sensors read, in deviations, of forces along y and z with moments (G,) at the clamp."""
        xp = namespace(moment_Nm)
        about_y, about_z = self.gain[0] / self.std[0] * moment_Nm, self.gain[1] / self.std[1] * moment_Nm
        zero = xp.zeros_like(moment_Nm)  # a force along z acts about y, one along y about z
        return xp.stack([xp.stack([zero, about_y], -1), xp.stack([about_z, zero], -1)], 0)
