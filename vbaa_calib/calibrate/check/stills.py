"""Pictures of the free and the loaded antenna held against what a rig predicts for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.calibrate.antenna.inputs import DISTANCE_STEP_M, EXACT, LOG_FORCE_STEP, Observation, reading_keys
from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN, OFFSET, POSE, still_curves
from vbaa_calib.calibrate.antenna.problem import RIG as LENS
from vbaa_calib.core.robust import mad_std
from vbaa_calib.geometry import Pose
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

from .finding import Information

_WINDOW, _FAR = 25, 5.0
"""Points further than this many deviations from the median of their neighbours show something beside the antenna."""


@dataclass(frozen=True, eq=False)
class HeldStill:
    """One picture of the antenna against its prediction.

    Attributes
    ----------
    arclength_m : (N,) where each seen point lies along the predicted antenna.
    residual_std : (N,) its distance along the normal, in deviations of a point of this rig. residual_mm : the same on
        the antenna.
    jacobian : (N, 17 + P) of the whitened residual (negative: of the prediction) by the rig's parameters.
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
    def is_read(self) -> bool:
        """Whether the moment sensor's reading was noted with it."""
        return bool(np.isfinite(self.still.moment_Nm))

    @property
    def points(self) -> Information:
        """What its points say of the rig's parameters."""
        return Information.of(self.jacobian, self.residual_std, self.by_readings)

    def moment_residual_Nm(self, rig: Rig) -> float:
        """The sensor's reading less what the rig predicts for it."""
        sensor = rig.moment_sensor
        return self.still.moment_Nm - sensor.gain * self.moment_Nm - sensor.offset_Nm

    def moment_std_Nm(self, rig: Rig) -> float:
        """Of that residual: the sensor's noise, and what the load's readings leave open."""
        sensor = rig.moment_sensor
        return float(np.linalg.norm([sensor.std_Nm, *(sensor.gain * self.moment_by_readings)]))

    def reading(self, rig: Rig) -> Information:
        """What the sensor's reading says of the rig's parameters."""
        row, residual, unknown = self.reading_rows(rig)
        return Information.of(row, np.array([residual]), unknown)

    def reading_rows(self, rig: Rig) -> tuple[np.ndarray, float, np.ndarray]:
        """The sensor's reading, whitened: row (1, 17 + P), residual, and row (1, 2) by the load's readings."""
        sensor = rig.moment_sensor
        row = np.zeros((1, self.jacobian.shape[1]))
        row[0, ANTENNA] = sensor.gain * self.moment_by_antenna
        row[0, GAIN], row[0, OFFSET] = self.moment_Nm, 1.0
        unknown = sensor.gain * self.moment_by_readings[None] / sensor.std_Nm
        return row / sensor.std_Nm, self.moment_residual_Nm(rig) / sensor.std_Nm, unknown


def loads_information(rig: Rig, loaded: Sequence[HeldStill], moments: bool) -> Information:
    """What loads say of the rig's parameters together, by their points and, if asked for, by the sensor's readings.

    A place or weight that several loads share is off by the same in all of them.
    """
    keys = [key for held in loaded for key in _keys(held.still)]
    names = list(dict.fromkeys(keys))
    jacobians, residuals, unknowns = [], [], []
    for index, held in enumerate(loaded):
        columns = [names.index(key) for key in keys[2 * index : 2 * index + 2]]
        row, residual, by_readings = held.reading_rows(rig)
        rows = np.vstack([held.jacobian, row]) if moments else held.jacobian
        own = np.vstack([held.by_readings, by_readings]) if moments else held.by_readings
        unknown = np.zeros((len(rows), len(names)))
        unknown[:, columns] = own
        jacobians.append(rows)
        residuals.append(np.append(held.residual_std, residual) if moments else held.residual_std)
        unknowns.append(unknown)
    return Information.of(np.vstack(jacobians), np.concatenate(residuals), np.vstack(unknowns))


def _keys(still: Still) -> tuple[tuple[str, str], tuple[str, str]]:
    assert isinstance(still, Load)
    return reading_keys(still)


@dataclass(frozen=True, eq=False)
class _Predicted:
    """What a rig predicts for one still.

    Attributes
    ----------
    curves : (16,) its antenna seven times, for the camera's pose and a step along each of that, then with a step along
        each of its own parameters. views : (16,) the cameras that see them, antenna → camera.
    altered : (2,) with the load's place, then its weight, a step off.
    free_m : (3,) where the load hangs, were it not there.
    """

    curves: Curves
    views: Sequence[Pose]
    altered: Curves
    free_m: np.ndarray


def hold(rig: Rig, observations: Sequence[Observation], readings: LoadReadings = EXACT) -> list[HeldStill]:
    """Every still against the rig's prediction, and how that moves with the rig's parameters.

    readings : how well the loads are known.
    """
    count = ANTENNA.stop - ANTENNA.start
    length_m = rig.antenna.length_m
    antennas = np.repeat(rig.antenna.parameters[None], count + 1, axis=0)
    antennas[1:] += np.diag(RIG_STEPS[ANTENNA])
    curves = still_curves(observations, antennas, length_m)
    free = still_curves(observations, antennas[:1], length_m, loaded=False)
    misread = [other for one in observations for other in one.with_readings_altered()]
    altered = still_curves(misread, antennas[:1], length_m)
    poses = [rig.T_antenna_camera, *(rig.T_antenna_camera.retract(step) for step in np.diag(RIG_STEPS[POSE]))]
    inverse = [pose.inverse() for pose in poses]
    order = np.array([0] * 7 + list(range(1, count + 1)))
    views = [*inverse, *[inverse[0]] * count]
    held = []
    for index, observation in enumerate(observations):
        own = curves.picked((count + 1) * index + order)
        pair = altered.picked(np.array([2 * index, 2 * index + 1]))
        predicted = _Predicted(own, views, pair, free.points_m[index, CONTACT])
        held.append(_held(rig, observation, predicted, readings))
    return held


def _held(rig: Rig, observation: Observation, predicted: _Predicted, readings: LoadReadings) -> HeldStill:
    own, altered, view = predicted.curves, predicted.altered, predicted.views[0]
    steps = np.array([-readings.distance_std_m / DISTANCE_STEP_M, readings.force_std_relative / LOG_FORCE_STEP])
    projected = image_curves(own, predicted.views)
    points = see(rig.camera, observation.points_px, observation.sigma_px)
    points = with_slopes_on_curve(points, rig.camera, projected)
    whitened, slopes = whitened_with_lens(points, projected)
    whitened = whitened / rig.image.noise_scale
    near = _undisturbed(whitened[:, 0])
    misread = whitened_residuals(points, image_curves(altered, [view] * 2)) / rig.image.noise_scale
    seen = points.picked(near)
    by_lens = np.zeros((len(seen), len(rig.camera.parameter_names)))
    if seen.by_lens is not None:
        by_lens = slopes[near] / rig.image.noise_scale
    by_rig = np.zeros((len(seen), LENS))
    by_rig[:, : ANTENNA.stop] = (whitened[near, 1:] - whitened[near, :1]) / RIG_STEPS
    foot = feet(seen, projected)
    depth = np.interp(foot, own.arclength_m[0], (view @ own.points_m[0])[:, 2])
    # the geometric mean over directions stands for the deviation along the normal: pixels are all but square
    std = np.sqrt(np.sqrt(np.linalg.det(seen.covariance).clip(0.0))) * rig.image.noise_scale
    moment_Nm = own.moment_Nm[0]
    bent_m = float(np.linalg.norm(own.points_m[0, CONTACT] - predicted.free_m))
    return HeldStill(
        still=observation.still,
        arclength_m=foot,
        residual_std=whitened[near, 0],
        residual_mm=1e3 * whitened[near, 0] * std * depth,
        jacobian=-np.hstack([by_rig, by_lens]),
        moment_Nm=float(moment_Nm),
        moment_by_antenna=(own.moment_Nm[7:] - moment_Nm) / RIG_STEPS[ANTENNA],
        deflection_m=bent_m if isinstance(observation.still, Load) else 0.0,
        by_readings=-(misread[near] - whitened[near, :1]) * steps,
        moment_by_readings=(altered.moment_Nm - moment_Nm) * steps,
    )


def free_shape_moved_mm(rig: Rig, step: np.ndarray) -> float:
    """How far the free antenna moves, at most along its length, with a step (9,) of its parameters; weightless."""
    parameters = rig.antenna.parameters + np.stack([np.zeros_like(step), step])
    curves = bend(parameters, rig.antenna.length_m, np.zeros((2, 3)), np.full(2, 0.1), np.zeros((2, 2)))
    return 1e3 * float(np.linalg.norm(curves.points_m[1] - curves.points_m[0], axis=1).max())


def tip_std_mm(rig: Rig, covariance: np.ndarray) -> float:
    """Standard deviation of the free tip in its worst direction, by the (6, 6) covariance of clamp and bow."""
    steps = np.vstack([np.zeros(9), np.diag(RIG_STEPS[ANTENNA])[:6]])
    curves = bend(
        rig.antenna.parameters + steps, rig.antenna.length_m, np.zeros((7, 3)), np.full(7, 0.1), np.zeros((7, 2))
    )
    tips = curves.points_m[:, -1]
    slopes = ((tips[1:] - tips[0]) / RIG_STEPS[ANTENNA][:6, None]).T
    return 1e3 * float(np.sqrt(np.linalg.eigvalsh(slopes @ covariance @ slopes.T)[-1]))


def _undisturbed(residuals: np.ndarray) -> np.ndarray:
    """(N,) points that lie where their neighbours do."""
    off = residuals - median_filter(residuals, min(_WINDOW, len(residuals)), mode="nearest")
    return np.abs(off) <= _FAR * max(mad_std(off), 0.2)
