"""Score tests of the model's assumptions on the residuals, to first order: equal compliance in y and z, weight, the
sensor's noise and drift."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.special import chdtri

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.core.robust import finite_or_none, mad_std

from .bundle_adjustment import BundleAdjustment

_MASS = 6 + PARAMETERS.index("log_mass_per_length_kg_m")  # place among `RIG_PARAMETERS`


@dataclass(frozen=True)
class _Estimate:
    """A number and its standard deviation; None where the data do not determine it."""

    value: float
    std: float


@dataclass(frozen=True, eq=False)
class Checks:
    """Results of the score tests, one field an assumption.

    Attributes
    ----------
    anisotropy : log of the stiffness against bending to y over that to z; assumption 4 says 0. None without loads.
    mass_per_length_kg_m : from the sag alone, without prior knowledge; None if the sag does not determine it.
    drift_Nm : of the moment sensor, per s, or per row where the frames have no times: drift_per.
    noise_Nm : of the moment sensor as the frames show it, and its 95 % interval; NaN without a sensor.
    """

    anisotropy: _Estimate | None
    mass_per_length_kg_m: _Estimate | None
    drift_Nm: _Estimate | None
    drift_per: Literal["s", "row"]
    noise_Nm: float
    noise_interval_95_Nm: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        """The entry of rig.json."""
        drift = {f"drift_Nm_per_{per}": self.drift_Nm if per == self.drift_per else None for per in ("s", "row")}
        estimates = {"anisotropy": self.anisotropy, "mass_per_length_kg_m": self.mass_per_length_kg_m, **drift}
        numbers = {name: one and vars(one) for name, one in estimates.items()}
        interval = [finite_or_none(end) for end in self.noise_interval_95_Nm]
        return numbers | {"noise_Nm": finite_or_none(self.noise_Nm), "noise_interval_95_Nm": interval}


def check(joint: BundleAdjustment) -> Checks:
    """All checks of a bundle adjustment."""
    times = [observation.still.time_s for observation in joint.problem.observations]
    timed = all(time is not None for time in times)
    when = np.array(times, float) if timed else np.arange(len(times), dtype=float)
    return Checks(_anisotropy(joint), _mass(joint), _drift(joint, when), "s" if timed else "row", *_moment_noise(joint))


def _one_more(joint: BundleAdjustment, points: np.ndarray, moments: np.ndarray) -> _Estimate | None:
    """Score-test estimate of one further parameter, of Jacobian by the points' rows and the moments (F,) is
    `points`, `moments`."""
    own = np.concatenate([points, moments[joint.kept]])
    column = np.append(own, np.zeros(len(joint.solution.residuals) - len(own)))
    # nothing is known of it beforehand
    found = joint.solution.score_test(column[:, None], 1e6)
    return None if found is None else _Estimate(float(found.values[0]), float(found.std[0]))


def _point_rows(joint: BundleAdjustment) -> int:
    read = 1 + (0 if joint.sensor is None else len(joint.sensor.components))
    return len(joint.solution.residuals) - read * int(joint.kept.sum()) - joint.problem.certain


def _anisotropy(joint: BundleAdjustment) -> _Estimate | None:
    problem, at, step = joint.problem, joint.solution.parameters, 1e-2
    if not any(observation.loaded for observation in problem.observations):
        return None
    moved = replace(problem, uneven=np.array([step, 0.0, 0.0]))
    slopes = (moved.misfits(at) - problem.misfits(at)) / step
    return _one_more(joint, slopes[: _point_rows(joint)], np.zeros(len(problem.observations)))


def _mass(joint: BundleAdjustment) -> _Estimate | None:
    prior = joint.problem.prior
    mean, variance = float(prior.mean[_MASS - 6]), float(prior.std[_MASS - 6]) ** 2
    value, posterior = float(joint.parameters[_MASS]), float(joint.covariance[_MASS, _MASS])
    information = 1.0 / posterior - 1.0 / variance
    # the weight counts as determined where the pictures narrow its variance by a thousandth
    if information * variance < 1e-3:
        return None
    alone = (value / posterior - mean / variance) / information
    return _Estimate(float(np.exp(alone)), float(np.exp(alone) * information**-0.5))


def _drift(joint: BundleAdjustment, when: np.ndarray) -> _Estimate | None:
    if np.ptp(when) == 0.0 or np.isinf(joint.problem.moment_std_Nm):
        return None
    centred = (when - when[joint.kept].mean()) / joint.problem.moment_std_Nm
    return _one_more(joint, np.zeros(_point_rows(joint)), centred)


def _moment_noise(joint: BundleAdjustment) -> tuple[float, tuple[float, float]]:
    """Standard deviation of one moment reading and its 95 % interval, corrected for the degrees of freedom that the
    fit used."""
    problem, solution = joint.problem, joint.solution
    if np.isinf(problem.moment_std_Nm):
        return np.nan, (np.nan, np.nan)
    residuals = joint.moment_residuals_Nm[joint.kept]
    # a reading that is wrong is not noise: it is named instead
    usual = max(mad_std(residuals), problem.moment_std_Nm)
    good = np.abs(residuals) <= 5.0 * usual
    first = _point_rows(joint)
    rows = (solution.jacobian * solution.weights[:, None])[first : first + len(residuals)][good]
    information, _, scale = solution.normal_equations()
    taken = float(np.trace((rows / scale) @ np.linalg.solve(information, (rows / scale).T)))
    freedom = max(float(good.sum()) - taken, 1.0)
    squares = float((residuals[good] ** 2).sum())
    low, high = (float(np.sqrt(squares / chdtri(freedom, chance))) for chance in (0.025, 0.975))
    return float(np.sqrt(squares / freedom)), (low, high)
