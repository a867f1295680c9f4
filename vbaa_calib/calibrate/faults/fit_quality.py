"""How well an explanation fits: the scatter that it leaves, against the scatter that the pictures have anyway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, adjust_bundle, noise_scale
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.core.errors import SolveError
from vbaa_calib.core.robust import huber_weights, mad_std
from vbaa_calib.session import Load

SENSOR_OFF = 1e6
"""Factor on the moment sensor's noise that leaves it out of a solve."""
_DEGREE = 7
"""Of the smooth curve that any bent antenna is in the picture."""
_FITS = 1.5
"""An explanation fits that leaves at most this multiple of the pictures' own scatter."""
_ROUNDS, _UNWEIGHTED_ROUNDS, _CONVERGED = 10, 4, 0.02
"""Most rounds of a solve, the first ones without robust weights; it ends when the scatter falls by less than a part."""


def solve_free(observations: Sequence[Observation], before: Prior, length_m: float, std_Nm: float) -> BundleAdjustment:
    """The solve of the no-load frames alone, without the moment sensor: it may be what is wrong.

    Raises SolveError when there are none, or it does not converge.
    """
    free = [one for one in observations if not isinstance(one.still, Load)]
    if not free:
        raise SolveError("there is no no-load frame")
    return adjust_bundle(free, before, length_m, SENSOR_OFF * std_Nm)


def picture_scatter(observations: Sequence[Observation]) -> float:
    """Scatter of the points about a smooth curve in their own picture, over their claimed deviations; no model in it.

    At least 0.2, as in the joint solve.
    """
    left = []
    for one in observations:
        if len(one.points_px) > 2 * _DEGREE:
            centred = one.points_px - one.points_px.mean(axis=0)
            along, aside = (centred @ np.linalg.svd(centred, full_matrices=False)[2].T).T
            smooth = np.polynomial.Polynomial.fit(along, aside, _DEGREE)
            freedom = np.sqrt(len(along) / (len(along) - _DEGREE - 1))
            left.append(freedom * (aside - smooth(along)) / np.hypot(1.0, smooth.deriv()(along)) / one.sigma_px)
    return max(mad_std(np.concatenate(left)), 0.2) if left else 0.2


def fits(scatter: float, own_scatter: float) -> bool:
    """Whether an explanation leaves no more than the pictures' own scatter."""
    return bool(scatter <= _FITS * own_scatter)


def worst_still(joint: BundleAdjustment) -> float:
    """Scatter of the points of the still that fits worst, over their claimed deviations."""
    return float(joint.point_rms.max() * joint.noise_scale)


def scatter_with_change(joint: BundleAdjustment, which: Sequence[int], after: Sequence[int], prior_std: float) -> float:
    """The points' scatter, over their claimed deviations, with parameters that differ from some still on.

    All parameters are solved for again, without the moment sensor: it may be what is wrong.
    which : indices of the parameters. after : indices of the stills from the change on.
    prior_std : of the changes, about 0.
    """
    problem = joint.problem
    everything = np.ones_like(problem.kept)
    problem = replace(problem, kept=everything, noise_scale=1.0, moment_std_Nm=SENSOR_OFF * problem.moment_std_Nm)
    ends = np.cumsum([0, *map(len, problem.seen_at_lens)])
    later = np.zeros(ends[-1] + len(ends) - 1 + problem.certain, bool)
    for index in after:
        later[ends[index] : ends[index + 1]] = True
        later[ends[-1] + index] = True
    spans = [slice(a, b) for a, b in pairwise(ends)]
    parameters, change = joint.solution.parameters, np.zeros(len(which))
    least, certain = np.inf, problem.certain
    for turn in range(_ROUNDS):
        moved = parameters.copy()
        moved[list(which)] += change
        (before, slopes), (beyond, other) = problem.residuals(parameters), problem.residuals(moved)
        residuals = np.where(later, beyond, before)
        jacobian = np.where(later[:, None], other, slopes)
        jacobian = np.hstack([jacobian, np.where(later[:, None], other[:, list(which)], 0.0)])
        scale = noise_scale([residuals[span] for span in spans])
        if scale > (1 - _CONVERGED) * least and turn > _UNWEIGHTED_ROUNDS:
            break
        least = min(least, scale)
        # at first none of the points counts as an outlier: whole stills are far off
        weights = np.ones(len(residuals))
        if turn >= _UNWEIGHTED_ROUNDS:
            weights[:-certain] = np.sqrt(huber_weights(residuals[:-certain] / scale))
        weights[:-certain] /= scale
        size = np.linalg.norm(jacobian, axis=0)
        scaled = jacobian / size * weights[:, None]
        information = np.repeat([0.0, prior_std**-2], [len(parameters), len(which)])
        slope = scaled.T @ (residuals * weights) + information * np.concatenate([0 * parameters, change]) / size
        step = -np.linalg.solve(scaled.T @ scaled + np.diag(information / size**2), slope) / size
        parameters, change = parameters + step[: len(parameters)], change + step[len(parameters) :]
    return min(scale, least)
