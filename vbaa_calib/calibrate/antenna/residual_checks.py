"""Score tests of the model's assumptions on the residuals, to first order: equal compliance in y and z, weight, the
sensor's noise and drift."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.core.robust import chi_limit, finite_or_none, mad_std

from .bundle_adjustment import BundleAdjustment

_MASS = 6 + PARAMETERS.index("log_mass_per_length_kg_m")  # place among `RIG_PARAMETERS`


def check(joint: BundleAdjustment) -> dict[str, Any]:
    """All checks of a bundle adjustment: the entry `checks` of rig.json, estimates as value and standard deviation;
    None where the data do not determine one.

    anisotropy : log of the stiffness against bending to y over that to z; assumption 4 says 0.
    mass_per_length_kg_m : from the sag alone, without prior knowledge.
    drift_Nm_per_s : of the moment sensor; drift_Nm_per_row where the frames have no times.
    noise_Nm : of the moment sensor as the frames show it, and its 95 % interval.
    """
    times = [observation.still.time_s for observation in joint.problem.observations]
    timed = all(time is not None for time in times)
    when = np.array(times, float) if timed else np.arange(len(times), dtype=float)
    drift, (noise_Nm, interval_Nm) = _drift(joint, when), moment_noise(joint)
    found = {
        "anisotropy": _anisotropy(joint),
        "mass_per_length_kg_m": _mass(joint),
        "drift_Nm_per_s": drift if timed else None,
        "drift_Nm_per_row": None if timed else drift,
    }
    estimates = {name: one and {"value": one[0], "std": one[1]} for name, one in found.items()}
    interval = [finite_or_none(end) for end in interval_Nm]
    return {**estimates, "noise_Nm": finite_or_none(noise_Nm), "noise_interval_95_Nm": interval}


def _one_more(joint: BundleAdjustment, points: np.ndarray, moments: np.ndarray) -> tuple[float, float] | None:
    """Score-test estimate and standard deviation of one further parameter; None where the data do not determine it.

    points, moments : derivatives by it of the points' residuals, and of those of the moments (F,).
    """
    own = np.concatenate([points, moments[joint.kept]])
    column = np.append(own, np.zeros(len(joint.solution.residuals) - len(own)))
    # nothing is known of it beforehand
    found = joint.solution.score_test(column[:, None], 1e6)
    return None if found is None else (float(found.values[0]), float(found.std[0]))


def _point_rows(joint: BundleAdjustment) -> int:
    read = 1 + (0 if joint.sensor is None else len(joint.sensor.components))
    return len(joint.solution.residuals) - read * int(joint.kept.sum()) - joint.problem.certain


def _anisotropy(joint: BundleAdjustment) -> tuple[float, float] | None:
    problem, at, step = joint.problem, joint.solution.parameters, 1e-2
    if not any(observation.loaded for observation in problem.observations):
        return None
    moved = replace(problem, uneven=np.array([step, 0.0, 0.0]))
    slopes = (moved.misfits(at) - problem.misfits(at)) / step
    return _one_more(joint, slopes[: _point_rows(joint)], np.zeros(len(problem.observations)))


def _mass(joint: BundleAdjustment) -> tuple[float, float] | None:
    prior = joint.problem.prior
    mean, variance = float(prior.mean[_MASS - 6]), float(prior.std[_MASS - 6]) ** 2
    value, posterior = float(joint.parameters[_MASS]), float(joint.covariance[_MASS, _MASS])
    information = 1.0 / posterior - 1.0 / variance
    # the weight counts as determined where the pictures narrow its variance by a thousandth
    if information * variance < 1e-3:
        return None
    alone = (value / posterior - mean / variance) / information
    return (float(np.exp(alone)), float(np.exp(alone) * information**-0.5))


def _drift(joint: BundleAdjustment, when: np.ndarray) -> tuple[float, float] | None:
    if np.ptp(when) == 0.0 or np.isinf(joint.problem.moment_std_Nm):
        return None
    centred = (when - when[joint.kept].mean()) / joint.problem.moment_std_Nm
    return _one_more(joint, np.zeros(_point_rows(joint)), centred)


def moment_noise(joint: BundleAdjustment) -> tuple[float, tuple[float, float]]:
    """Standard deviation of one moment reading and its 95 % interval, corrected for the degrees of freedom that the
    fit used; NaN without a sensor."""
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
    low, high = (math.sqrt(squares) / chi_limit(chance, freedom) for chance in (0.025, 0.975))
    return float(np.sqrt(squares / freedom)), (low, high)
