"""Residuals of pictures of the free and the loaded antenna against a rig's prediction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.shape import bend
from vbaa_calib.calibrate.antenna.inputs import EXACT, Observation, Prior, reading_keys
from vbaa_calib.calibrate.antenna.problem import ANTENNA, Problem, still_curves
from vbaa_calib.core.robust import mad_std
from vbaa_calib.rig import RIG_STEPS, Rig
from vbaa_calib.rig.reprojection import feet, image_curves
from vbaa_calib.session import Load, LoadReadings, Still

from .change import Information

POINTS, MOMENT, BOTH = slice(-1), slice(-1, None), slice(None)
"""Rows of a `CheckedStill`."""
_WINDOW, _FAR = 25, 5.0
"""Points further than this many deviations from the median of their neighbours show something beside the antenna."""


@dataclass(frozen=True, eq=False)
class CheckedStill:
    """One picture of the antenna, N points, against its prediction.

    arclength_m : (N,) where each point lies along the predicted antenna. residual_mm : (N,) its distance from it there.
    residuals : (N + 1,) of points and moment, observed less predicted, in deviations. The moment's is NaN where it was
        not read.
    jacobian : (N + 1, 17 + P) of the predictions by the rig's parameters, in the same units.
    by_readings : (N + 1, 2) of them by the errors of a load's place and weight, each in its deviations.
    moment_residual_Nm : the sensor's reading less the prediction. moment_std_Nm : of that, by the sensor's noise and
        the uncertainty of the load's place and weight.
    deflection_m : predicted at the load, against the free antenna; 0 where there is none.
    """

    still: Still
    arclength_m: np.ndarray
    residual_mm: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    by_readings: np.ndarray
    moment_residual_Nm: float
    moment_std_Nm: float
    deflection_m: float

    @property
    def name(self) -> str:
        """Of the picture."""
        return self.still.image.name if self.still.image else "?"

    @property
    def rms_std(self) -> float:
        """Root mean square of the points' residuals, in deviations."""
        return float(np.sqrt((self.residuals[POINTS] ** 2).mean()))

    @property
    def has_moment(self) -> bool:
        """Whether the moment sensor's reading was noted with it."""
        return bool(np.isfinite(self.still.moment_Nm))


def information(stills: Sequence[CheckedStill], rows: slice, count: int) -> Information:
    """Of some rows of stills about the rig's `count` parameters: places and weights that loads share are off alike."""
    keys = [reading_keys(one.still) if isinstance(one.still, Load) else () for one in stills]
    names = list(dict.fromkeys(key for own in keys for key in own))
    jacobian, residuals, nuisance = [np.zeros((0, count))], [np.zeros(0)], [np.zeros((0, len(names)))]
    for one, own in zip(stills, keys, strict=True):
        by_names = np.zeros((len(one.residuals), len(names)))
        by_names[:, [names.index(key) for key in own]] = one.by_readings[:, : len(own)]
        jacobian.append(one.jacobian[rows])
        residuals.append(one.residuals[rows])
        nuisance.append(by_names[rows])
    return Information.of(np.vstack(jacobian), np.concatenate(residuals), np.vstack(nuisance))


def check_stills(rig: Rig, observations: Sequence[Observation], readings: LoadReadings = EXACT) -> list[CheckedStill]:
    """Every still against the rig's prediction, and how that moves with the rig's parameters.

    readings : how well the loads' places and weights are known.
    """
    sensor, noise, view = rig.moment_sensor, rig.image.noise_scale, rig.T_antenna_camera.inverse()
    # of unit covariance: steps along its axes are steps of its parameters
    lens = replace(rig.camera, covariance=np.eye(len(rig.camera.parameter_names)))
    mean = np.concatenate([rig.antenna.parameters, [sensor.gain, sensor.offset_Nm]])
    prior = Prior((), rig.T_antenna_camera, lens, mean, np.ones(len(mean)))
    problem = Problem.of(observations, prior, rig.antenna.length_m, sensor.std_Nm)
    problem, at = replace(problem, noise_scale=noise), problem.begin
    curves = problem.curves(at[None, ANTENNA])
    free = still_curves(observations, at[None, ANTENNA], rig.antenna.length_m, loaded=False)
    deflections_m = np.linalg.norm(curves.points_m[:, CONTACT] - free.points_m[:, CONTACT], axis=1)
    std, checked = np.array([readings.distance_std_m, readings.force_std_relative]), []
    rows = zip(observations, problem.by_still(at), problem.whitened_by_load(at), strict=True)
    for index, (observation, (misfits, slopes), by_load) in enumerate(rows):
        own, points = curves.picked(np.array([index])), problem.seen_at_lens[index]
        near = np.append(_undisturbed(misfits[POINTS]), True)
        # points: distances from the prediction, which moves the other way; moment: the prediction less the reading
        sign = np.append(-np.ones(near.sum() - 1), 1.0)[:, None]
        residuals = -sign[:, 0] * misfits[near]
        points = points.picked(near[POINTS])
        foot = feet(points, image_curves(own, view))
        depth = np.interp(foot, own.arclength_m[0], (view @ own.points_m[0])[:, 2])
        # the geometric mean over directions stands for the deviation along the normal: pixels are all but square
        across = np.sqrt(np.sqrt(np.linalg.det(points.covariance).clip(0.0))) * noise
        by_readings = sign * by_load[near] * std
        checked.append(
            CheckedStill(
                still=observation.still,
                arclength_m=foot,
                residual_mm=1e3 * residuals[POINTS] * across * depth,
                residuals=residuals,
                jacobian=sign * slopes[near],
                by_readings=by_readings,
                moment_residual_Nm=float(residuals[-1]) * sensor.std_Nm,
                moment_std_Nm=sensor.std_Nm * float(np.linalg.norm([1.0, *by_readings[-1]])),
                deflection_m=float(deflections_m[index]) if isinstance(observation.still, Load) else 0.0,
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
    zero, parameters = np.zeros((len(steps), 3)), rig.antenna.parameters + steps
    return bend(parameters, rig.antenna.length_m, zero, np.full(len(steps), 0.1), zero[:, 1:]).points_m
