"""A calibrated rig as arrays of one kind on one device, ready for many frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS as ANTENNA_PARAMETERS
from vbaa_calib.core.arrays import Array, like, namespace
from vbaa_calib.geometry.independent_axes import independent_axes
from vbaa_calib.rig import POSE_PARAMETERS, RIG_STEPS, Rig

POSES, ANTENNA = len(POSE_PARAMETERS), len(ANTENNA_PARAMETERS)
UNKNOWNS = 4
"""Of a contact: its distance in antenna lengths, the lateral force (y, z of the clamp's frame) in `Known.force_unit_N`,
and the friction angle in deviations of what is thought possible."""
LIKELY_SWAY = 0.3
"""Deviation of the tip's deflection that is thought likely beforehand, in antenna lengths: it keeps the force at home
in directions that neither picture nor reading holds, and is nothing against what holds it in the others."""
NEGLIGIBLE = 1e-9
"""Axes of the joint covariance below this fraction of the largest, in deviations of its parameters, are left out."""


@dataclass(frozen=True, eq=False)
class Known:
    """What is known before a frame is seen.

    Attributes
    ----------
    friction_rad : standard deviation of the contact force's angle from the antenna's normal; 0: no friction.
    parameters : (9,) the antenna, `antenna.shape.PARAMETERS`.
    axes : (17 + P, R) steps of the rig's parameters and the lens that are independent, of unit deviation; R is 0 for a
        rig without any uncertainty.
    rotations, translations : (7, 3, 3), (7, 3) of T_camera_antenna, and of the six that a step of the pose leads to.
    gain, offset, std : (2,) of the moment sensors about y and z; a missing one has the gain 0.
    moves : (1 + 9, 9) steps of the antenna's parameters, none first.
    trials : (1 + 4, 4) unit steps of a contact's unknowns, none first.
    prior : (4 + R,) weights of the squares of unknowns and rig steps: nothing is known of distance and force.
    unit : (R, R) unit matrix.
    """

    rig: Rig
    friction_rad: float
    parameters: Array
    axes: Array
    rotations: Array
    translations: Array
    gain: Array
    offset: Array
    std: Array
    moves: Array
    trials: Array
    prior: Array
    unit: Array

    @staticmethod
    def of(rig: Rig, friction_rad: float, reference: Array) -> Known:
        """The rig in the kind, precision and device of a reference array."""
        views = [rig.T_antenna_camera] + [rig.T_antenna_camera.retract(step) for step in np.diag(RIG_STEPS[:POSES])]
        inverses = [pose.inverse() for pose in views]
        axes = independent_axes(rig.covariance)
        size = np.abs(axes).max(axis=0)
        axes = axes[:, size > NEGLIGIBLE * max(float(size.max()), 1e-300)]
        second = rig.second_moment_sensor
        sensors = [(s.gain, s.offset_Nm, s.std_Nm) if s else (0.0, 0.0, 1.0) for s in (rig.moment_sensor, second)]
        gain, offset, std = np.array(sensors).T

        def take(values: np.ndarray) -> Array:
            return like(reference, np.ascontiguousarray(values))

        return Known(
            rig,
            friction_rad,
            take(rig.antenna.parameters),
            take(axes),
            take(np.stack([pose.rotation for pose in inverses])),
            take(np.stack([pose.translation_m for pose in inverses])),
            take(gain),
            take(offset),
            take(std),
            take(np.vstack([np.zeros(ANTENNA), np.diag(RIG_STEPS[POSES:])])),
            take(np.vstack([np.zeros(UNKNOWNS), np.eye(UNKNOWNS)])),
            take(np.repeat([0.0, 1.0], [UNKNOWNS - 1, axes.shape[1] + 1])),
            take(np.eye(axes.shape[1])),
        )

    def still(self, count: int) -> Array:
        """(count, R) rig steps of a rig as calibrated."""
        return namespace(self.prior).broadcast_to(0.0 * self.prior[UNKNOWNS:], (count, self.axes.shape[1]))

    @property
    def length_m(self) -> float:
        """The antenna's."""
        return self.rig.antenna.length_m

    @property
    def force_unit_N(self) -> float:
        """A force that bends the tip by about a hundredth of the length."""
        return 0.03 * self.rig.antenna.stiffness_Nm2 / self.rig.antenna.length_m**2

    @property
    def load(self) -> float:
        """F·l²/EI of a unit force at the tip."""
        return self.force_unit_N * self.length_m**2 / self.rig.antenna.stiffness_Nm2

    def tip_per_force(self, distance: Array) -> Array:
        """Small deflection of the tip, in antenna lengths, per unit force at distances in antenna lengths."""
        return self.load / 6.0 * distance * distance * (3.0 - distance)

    def felt_by(self, moment_Nm: Array) -> Array:
        """(2, G, 2) what the sensors read, in deviations, of forces along y and z with moments (G,) at the clamp."""
        xp = namespace(moment_Nm)
        about_y, about_z = self.gain[0] / self.std[0] * moment_Nm, self.gain[1] / self.std[1] * moment_Nm
        # about y the force's z is felt, about z its y
        nothing = xp.zeros_like(moment_Nm)
        return xp.stack([xp.stack([nothing, about_y], -1), xp.stack([about_z, nothing], -1)], 0)
