"""Checks of the assumptions by the residuals: equal compliance, weight, the sensor's noise and drift.

Each check estimates one more parameter, to first order: nothing is solved again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.special import chdtri

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.core.robust import chi_square_p, mad_std
from vbaa_calib.rig.reprojection import image_curves, whitened_residuals

from .bundle_adjustment import BundleAdjustment
from .problem import ANTENNA

_ANISOTROPY_STEP = 1e-2
MASS = 6 + PARAMETERS.index("log_mass_per_length_kg_m")
FALSE_READING = 5.0  # standard deviations beyond which a moment reading is taken for a wrong one
_LEAST_GAIN = 1e-3  # the weight counts as determined when the pictures narrow its variance by more than this part


@dataclass(frozen=True)
class Estimate:
    """A number and its standard deviation; None where the data do not hold it."""

    value: float
    std: float

    @property
    def in_std(self) -> float:
        """The number in standard deviations."""
        return self.value / self.std


@dataclass(frozen=True, eq=False)
class Checks:
    """Assumption by assumption.

    Attributes
    ----------
    anisotropy : log of the stiffness against bending to y over that to z; assumption 4 says 0. None without loads.
    mass_per_length_kg_m : from the sag alone, without prior knowledge; None if the sag does not determine it.
    drift_Nm : of the moment sensor, per s, or per row where the stills have no times: drift_per.
    noise_Nm : of the moment sensor as the stills show it, by so many degrees of freedom, and its 95 % interval.
    """

    anisotropy: Estimate | None
    mass_per_length_kg_m: Estimate | None
    drift_Nm: Estimate | None
    drift_per: Literal["s", "row"]
    noise_Nm: float
    noise_interval_95_Nm: tuple[float, float]
    noise_freedom: float

    def noise_chance(self, std_Nm: float) -> float:
        """That a sensor of this noise scatters so much."""
        return chi_square_p((self.noise_Nm / std_Nm) ** 2 * self.noise_freedom, self.noise_freedom)

    def to_dict(self) -> dict[str, Any]:
        """For rig.json."""
        drift = {f"drift_Nm_per_{per}": self.drift_Nm if per == self.drift_per else None for per in ("s", "row")}
        estimates = {"anisotropy": self.anisotropy, "mass_per_length_kg_m": self.mass_per_length_kg_m, **drift}
        numbers = {name: one and vars(one) for name, one in estimates.items()}
        return numbers | {"noise_Nm": self.noise_Nm, "noise_interval_95_Nm": list(self.noise_interval_95_Nm)}


def check(joint: BundleAdjustment) -> Checks:
    """All checks of a bundle adjustment."""
    times = [observation.still.time_s for observation in joint.problem.observations]
    timed = all(time is not None for time in times)
    drift = _drift(joint, np.array(times, float) if timed else np.arange(len(times), dtype=float))
    return Checks(_anisotropy(joint), _mass(joint), drift, "s" if timed else "row", *_moment_noise(joint))


def _one_more(joint: BundleAdjustment, column: np.ndarray) -> Estimate | None:
    """What a further parameter would be whose change moves the residuals along column (R,)."""
    solution = joint.solution
    weights = solution.weights
    own = column * weights
    information, _, scale = solution.normal_equations()
    others = (solution.jacobian * weights[:, None]).T @ own / scale
    left = float(own @ own - others @ np.linalg.solve(information, others))
    if left <= 1e-9 * float(own @ own):
        return None
    return Estimate(float(-(own @ (solution.residuals * weights)) / left), left**-0.5)


def _column(joint: BundleAdjustment, points: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """(R,) from the points' part, kept ones only, and the moments' (F,)."""
    kept_moments = moments[joint.kept]
    rest = len(joint.solution.residuals) - len(points) - len(kept_moments)
    return np.concatenate([points, kept_moments, np.zeros(rest)])


def _anisotropy(joint: BundleAdjustment) -> Estimate | None:
    problem = joint.problem
    if not any(observation.loaded for observation in problem.observations):
        return None
    factors = np.array([[1.0, 1.0], np.exp([-0.5 * _ANISOTROPY_STEP, 0.5 * _ANISOTROPY_STEP])])
    antenna = joint.solution.parameters[ANTENNA]
    curves = problem.curves(np.stack([antenna, antenna]), factors)
    view = [joint.T_antenna_camera.inverse()] * 2
    slopes = []
    for index, points in enumerate(problem.seen(joint.solution.parameters)):
        if joint.kept[index]:
            pair = image_curves(curves.picked(np.array([2 * index, 2 * index + 1])), view)
            distances = whitened_residuals(points, pair)
            slope = (distances[:, 1] - distances[:, 0]) / _ANISOTROPY_STEP / problem.noise_scale
            slopes.append(problem.without_line(index, slope))
    return _one_more(joint, _column(joint, np.concatenate(slopes), np.zeros(len(problem.observations))))


def _mass(joint: BundleAdjustment) -> Estimate | None:
    prior = joint.problem.prior
    mean, variance = float(prior.mean[MASS - 6]), float(prior.std[MASS - 6]) ** 2
    value, posterior = float(joint.parameters[MASS]), float(joint.covariance[MASS, MASS])
    information = 1.0 / posterior - 1.0 / variance
    if information * variance < _LEAST_GAIN:
        return None
    alone = (value / posterior - mean / variance) / information
    return Estimate(float(np.exp(alone)), float(np.exp(alone) * information**-0.5))


def _drift(joint: BundleAdjustment, when: np.ndarray) -> Estimate | None:
    if np.ptp(when) == 0.0:
        return None
    points = np.zeros(len(joint.solution.residuals) - joint.kept.sum() - joint.problem.certain)
    return _one_more(joint, _column(joint, points, (when - when[joint.kept].mean()) / joint.problem.moment_std_Nm))


def _moment_noise(joint: BundleAdjustment) -> tuple[float, tuple[float, float], float]:
    """Noise of one reading, its interval, and its degrees of freedom, those that the fit took left out."""
    problem, solution = joint.problem, joint.solution
    residuals = joint.moment_residuals_Nm[joint.kept]
    # a reading that is wrong is not noise: it is named instead
    usual = max(mad_std(residuals), problem.moment_std_Nm)
    good = np.abs(residuals) <= FALSE_READING * usual
    first = len(solution.residuals) - len(residuals) - problem.certain
    rows = (solution.jacobian * solution.weights[:, None])[first : first + len(residuals)][good]
    information, _, scale = solution.normal_equations()
    taken = float(np.trace((rows / scale) @ np.linalg.solve(information, (rows / scale).T)))
    freedom = max(float(good.sum()) - taken, 1.0)
    squares = float((residuals[good] ** 2).sum())
    low, high = (float(np.sqrt(squares / chdtri(freedom, chance))) for chance in (0.025, 0.975))
    return float(np.sqrt(squares / freedom)), (low, high), freedom
