"""One frame held against the model: whitened misfits of points and moment, and how they move with contact and rig."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.geometry.independent_axes import independent_axes
from vbaa_calib.reprojection import (
    SeenPoints,
    image_curves,
    whitened_residuals,
    whitened_with_lens,
    with_slopes_on_curve,
)
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, RIG_STEPS, Rig

POSES = len(POSE_PARAMETERS)
STEPS = np.array([1e-4, 1e-4, 1e-4])
"""Finite-difference steps of a contact's unknowns."""
TIP = 1.0
"""The tip's distance in antenna lengths."""


@dataclass(frozen=True, eq=False)
class Scene:
    """One frame's data and the model they are held against.

    A contact's unknowns (3,) are its distance in antenna lengths and the lateral force (y, z of the clamp's frame) in
    `force_unit_N`.

    Attributes
    ----------
    gravity_m_s2 : (3,) antenna frame.
    sweeps : the model's rung, see `antenna.shape.bend`.
    scatter : factor on the points' deviations: 1, or what they scatter about the best shape where that is more.
    rig_table : (N + 1, R) as `by_rig` gives it, if the rig's R parameters take part; None where it counts as exact.
    """

    rig: Rig
    seen: SeenPoints
    moment_reading_Nm: float
    gravity_m_s2: np.ndarray
    sweeps: int
    scatter: float = 1.0
    rig_table: np.ndarray | None = None

    @property
    def force_unit_N(self) -> float:
        """A force that bends the tip by about a hundredth of the length."""
        antenna = self.rig.antenna
        return 0.03 * antenna.stiffness_Nm2 / antenna.length_m**2

    def thinned(self, count: int) -> Scene:
        """The same with at most so many points, spread over all of them by lot, and an exact rig."""
        chosen = np.random.default_rng(0).permutation(len(self.seen))[:count]
        return replace(self, seen=self.seen.picked(chosen), rig_table=None)

    def curves(self, unknowns: np.ndarray, parameters: np.ndarray | None = None) -> Curves:
        """Antenna shapes for contacts (B, 3), with the rig's antenna or others (B, 9)."""
        antenna = self.rig.antenna
        if parameters is None:
            parameters = np.repeat(antenna.parameters[None], len(unknowns), axis=0)
        gravity = np.repeat(self.gravity_m_s2[None], len(unknowns), axis=0)
        contact, lateral = unknowns[:, 0] * antenna.length_m, unknowns[:, 1:] * self.force_unit_N
        return bend(parameters, antenna.length_m, gravity, contact, lateral, sweeps=self.sweeps)

    def whitened(self, curves: Curves) -> np.ndarray:
        """(N + 1, B): the points' distances from each of B nearby curves, then the moment's misfit, all in std."""
        sensor = self.rig.moment_sensor
        points = whitened_residuals(self.seen, image_curves(curves, self.rig.T_antenna_camera.inverse()))
        moment = (self.moment_reading_Nm - sensor.gain * curves.moment_Nm - sensor.offset_Nm) / sensor.std_Nm
        return np.vstack([points / self.scatter, moment[None]])

    def scaled_rig_table(self) -> np.ndarray:
        """(N + 1, R) `rig_table` at the scene's scatter; (N + 1, 0) where the rig counts as exact."""
        if self.rig_table is None:
            return np.zeros((len(self.seen) + 1, 0))
        return np.vstack([self.rig_table[:-1] / self.scatter, self.rig_table[-1:]])


def linearised(scene: Scene, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whitened residuals (N + 1,) at the unknowns, for the rig as calibrated, and their Jacobian (N + 1, 3)."""
    steps = np.where(unknowns + STEPS > TIP, [-1.0, 1.0, 1.0], 1.0) * STEPS
    whitened = scene.whitened(scene.curves(np.vstack([unknowns, unknowns + np.diag(steps)])))
    return whitened[:, 0], (whitened[:, 1:] - whitened[:, :1]) / steps


def by_rig(scene: Scene, unknowns: np.ndarray) -> np.ndarray:
    """(N + 1, R) change of the whitened residuals at a contact with the rig's R parameters along `rig_axes`.

    The points' scatter is left at 1.
    """
    rig, sensor = scene.rig, scene.rig.moment_sensor
    count = len(rig.antenna.parameters)
    antenna = np.repeat(rig.antenna.parameters[None], count + 1, axis=0)
    antenna[1:] += np.diag(RIG_STEPS[POSES:])
    curves = scene.curves(np.tile(unknowns, (count + 1, 1)), antenna)
    views = [rig.T_antenna_camera] + [rig.T_antenna_camera.retract(step) for step in np.diag(RIG_STEPS[:POSES])]
    views = [pose.inverse() for pose in [*views, *[views[0]] * count]]
    order = np.array([0] * (POSES + 1) + list(range(1, count + 1)))
    images = image_curves(curves.picked(order), views)
    seen = with_slopes_on_curve(scene.seen, rig.camera, images) if rig.with_lens else scene.seen
    points, by_lens = whitened_with_lens(seen, images)
    moment = curves.moment_Nm
    table = np.zeros((len(points) + 1, len(rig.covariance)))
    table[:-1, : len(RIG_STEPS)] = (points[:, 1:] - points[:, :1]) / RIG_STEPS
    table[-1, POSES : len(RIG_STEPS)] = -sensor.gain * (moment[1:] - moment[0]) / RIG_STEPS[POSES:] / sensor.std_Nm
    table[-1, len(RIG_STEPS) : len(RIG_PARAMETERS)] = -moment[0] / sensor.std_Nm, -1.0 / sensor.std_Nm
    if rig.with_lens:
        table[:-1, len(RIG_PARAMETERS) :] = by_lens
    return table @ rig_axes(rig)


def rig_axes(rig: Rig) -> np.ndarray:
    """(R, R): along its columns the rig varies independently, by unit deviations."""
    return independent_axes(rig.covariance)
