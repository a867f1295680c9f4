"""Residuals of pictures of the free and the loaded antenna against a rig's prediction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.ndimage import median_filter

from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.shape import bend
from vbaa_calib.calibrate.antenna.inputs import DISTANCE_STEP_M, EXACT, LOG_FORCE_STEP, Observation, reading_keys
from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN, OFFSET, POSE, still_curves
from vbaa_calib.calibrate.antenna.problem import RIG as LENS
from vbaa_calib.core.robust import mad_std
from vbaa_calib.rig import RIG_STEPS, Rig
from vbaa_calib.rig.reprojection import (
    feet,
    image_curves,
    see,
    whitened_residuals,
    whitened_with_lens,
    with_slopes_on_curve,
)
from vbaa_calib.session import Load, LoadReadings, Still

from .change import Information

_WINDOW, _FAR = 25, 5.0
"""Points further than this many deviations from the median of their neighbours show something beside the antenna."""


@dataclass(frozen=True, eq=False)
class CheckedStill:
    """One picture of the antenna against its prediction.

    Attributes
    ----------
    arclength_m : (N,) where each point lies along the predicted antenna.
    residual_std : (N,) its distance along the normal, in deviations of a point of this rig. residual_mm : the same on
        the antenna.
    jacobian : (N, 17 + P) of the prediction by the rig's parameters, whitened.
    moment_Nm : predicted, before gain and offset. moment_by_antenna : (9,).
    deflection_m : predicted at the load, against the free antenna; 0 where there is none.
    by_readings : (N, 2) of the whitened prediction by the errors of a load's place and weight, each in its deviations.
    moment_by_readings : (2,) of the predicted moment.
    """

    still: Still
    arclength_m: np.ndarray
    residual_std: np.ndarray
    residual_mm: np.ndarray
    jacobian: np.ndarray
    moment_Nm: float
    moment_by_antenna: np.ndarray
    deflection_m: float
    by_readings: np.ndarray
    moment_by_readings: np.ndarray

    @property
    def name(self) -> str:
        """Of the picture."""
        return self.still.image.name if self.still.image else "?"

    @property
    def rms_std(self) -> float:
        """Root mean square of the residuals, in deviations."""
        return float(np.sqrt((self.residual_std**2).mean()))

    @property
    def has_moment(self) -> bool:
        """Whether the moment sensor's reading was noted with it."""
        return bool(np.isfinite(self.still.moment_Nm))

    def moment_residual_Nm(self, rig: Rig) -> float:
        """The sensor's reading less what the rig predicts for it."""
        sensor = rig.moment_sensor
        return self.still.moment_Nm - sensor.gain * self.moment_Nm - sensor.offset_Nm

    def moment_std_Nm(self, rig: Rig) -> float:
        """Of that residual: the sensor's noise and the uncertainty of the load's place and weight."""
        sensor = rig.moment_sensor
        return float(np.linalg.norm([sensor.std_Nm, *(sensor.gain * self.moment_by_readings)]))

    def point_information(self) -> Information:
        """Of its points, about the rig's parameters."""
        return Information.of(self.jacobian, self.residual_std, self.by_readings)

    def moment_information(self, rig: Rig) -> Information:
        """Of the sensor's reading, about the rig's parameters."""
        row, residual, by_readings = self.moment_row(rig)
        return Information.of(row, np.array([residual]), by_readings)

    def moment_row(self, rig: Rig) -> tuple[np.ndarray, float, np.ndarray]:
        """The sensor's reading, whitened: row (1, 17 + P), residual, and row (1, 2) by the load's place and weight."""
        sensor = rig.moment_sensor
        row = np.zeros((1, self.jacobian.shape[1]))
        row[0, ANTENNA] = sensor.gain * self.moment_by_antenna
        row[0, GAIN], row[0, OFFSET] = self.moment_Nm, 1.0
        by_readings = sensor.gain * self.moment_by_readings[None] / sensor.std_Nm
        return row / sensor.std_Nm, self.moment_residual_Nm(rig) / sensor.std_Nm, by_readings


def loads_information(rig: Rig, loaded: Sequence[CheckedStill], moments: bool) -> Information:
    """Of all loads' points, and optionally of their moments: places and weights that loads share are off alike."""
    keys = [key for checked in loaded for key in reading_keys(cast(Load, checked.still))]
    names = list(dict.fromkeys(keys))
    jacobians, residuals, nuisances = [], [], []
    for index, checked in enumerate(loaded):
        columns = [names.index(key) for key in keys[2 * index : 2 * index + 2]]
        row, residual, by_readings = checked.moment_row(rig)
        rows = np.vstack([checked.jacobian, row]) if moments else checked.jacobian
        nuisance = np.zeros((len(rows), len(names)))
        nuisance[:, columns] = np.vstack([checked.by_readings, by_readings]) if moments else checked.by_readings
        jacobians.append(rows)
        residuals.append(np.append(checked.residual_std, residual) if moments else checked.residual_std)
        nuisances.append(nuisance)
    return Information.of(np.vstack(jacobians), np.concatenate(residuals), np.vstack(nuisances))


def check_stills(rig: Rig, observations: Sequence[Observation], readings: LoadReadings = EXACT) -> list[CheckedStill]:
    """Every still against the rig's prediction, and how that moves with the rig's parameters.

    readings : how well the loads' places and weights are known.
    """
    count, length_m = ANTENNA.stop - ANTENNA.start, rig.antenna.length_m
    antennas = np.repeat(rig.antenna.parameters[None], count + 1, axis=0)
    antennas[1:] += np.diag(RIG_STEPS[ANTENNA])
    curves = still_curves(observations, antennas, length_m)
    free = still_curves(observations, antennas[:1], length_m, loaded=False)
    altered = still_curves(
        [other for one in observations for other in one.with_readings_altered()], antennas[:1], length_m
    )
    poses = [rig.T_antenna_camera, *(rig.T_antenna_camera.retract(step) for step in np.diag(RIG_STEPS[POSE]))]
    inverse = [pose.inverse() for pose in poses]
    view, views = inverse[0], [*inverse, *[inverse[0]] * count]
    # the antenna as it is under each pose of the camera, then with a step along each of its own parameters
    order = np.array([0] * 7 + list(range(1, count + 1)))
    steps = np.array([-readings.distance_std_m / DISTANCE_STEP_M, readings.force_std_relative / LOG_FORCE_STEP])
    noise = rig.image.noise_scale
    checked = []
    for index, observation in enumerate(observations):
        own = curves.picked((count + 1) * index + order)
        off = altered.picked(np.array([2 * index, 2 * index + 1]))
        image = image_curves(own, views)
        points = see(rig.camera, observation.points_px, observation.sigma_px)
        points = with_slopes_on_curve(points, rig.camera, image)
        whitened, slopes = whitened_with_lens(points, image)
        whitened = whitened / noise
        near = _undisturbed(whitened[:, 0])
        whitened_off = whitened_residuals(points, image_curves(off, [view] * 2)) / noise
        seen = points.picked(near)
        jacobian = np.zeros((len(seen), LENS + len(rig.camera.parameter_names)))
        jacobian[:, : ANTENNA.stop] = (whitened[near, 1:] - whitened[near, :1]) / RIG_STEPS
        if seen.by_lens is not None:
            jacobian[:, LENS:] = slopes[near] / noise
        foot = feet(seen, image)
        depth = np.interp(foot, own.arclength_m[0], (view @ own.points_m[0])[:, 2])
        # the geometric mean over directions stands for the deviation along the normal: pixels are all but square
        std = np.sqrt(np.sqrt(np.linalg.det(seen.covariance).clip(0.0))) * noise
        moment_Nm = own.moment_Nm[0]
        deflection_m = float(np.linalg.norm(own.points_m[0, CONTACT] - free.points_m[index, CONTACT]))
        checked.append(
            CheckedStill(
                still=observation.still,
                arclength_m=foot,
                residual_std=whitened[near, 0],
                residual_mm=1e3 * whitened[near, 0] * std * depth,
                jacobian=-jacobian,
                moment_Nm=float(moment_Nm),
                moment_by_antenna=(own.moment_Nm[7:] - moment_Nm) / RIG_STEPS[ANTENNA],
                deflection_m=deflection_m if isinstance(observation.still, Load) else 0.0,
                by_readings=-(whitened_off[near] - whitened[near, :1]) * steps,
                moment_by_readings=(off.moment_Nm - moment_Nm) * steps,
            )
        )
    return checked


def _undisturbed(residuals: np.ndarray) -> np.ndarray:
    """(N,) points that lie where their neighbours do."""
    off = residuals - median_filter(residuals, min(_WINDOW, len(residuals)), mode="nearest")
    return np.abs(off) <= _FAR * max(mad_std(off), 0.2)


def free_shape_moved_mm(rig: Rig, step: np.ndarray) -> float:
    """Largest displacement of the weightless free antenna by a step (9,) of its parameters."""
    points_m = _free_points_m(rig, np.stack([np.zeros_like(step), step]))
    return 1e3 * float(np.linalg.norm(points_m[1] - points_m[0], axis=1).max())


def tip_std_mm(rig: Rig, covariance: np.ndarray) -> float:
    """Standard deviation of the free tip in its worst direction, by the (6, 6) covariance of clamp and bow."""
    tips = _free_points_m(rig, np.vstack([np.zeros(9), np.diag(RIG_STEPS[ANTENNA])[:6]]))[:, -1]
    slopes = ((tips[1:] - tips[0]) / RIG_STEPS[ANTENNA][:6, None]).T
    return 1e3 * float(np.sqrt(np.linalg.eigvalsh(slopes @ covariance @ slopes.T)[-1]))


def _free_points_m(rig: Rig, steps: np.ndarray) -> np.ndarray:
    """(S, nodes, 3) of the weightless free antenna, its parameters off by steps (S, 9)."""
    count = len(steps)
    parameters = rig.antenna.parameters + steps
    return bend(
        parameters, rig.antenna.length_m, np.zeros((count, 3)), np.full(count, 0.1), np.zeros((count, 2))
    ).points_m
