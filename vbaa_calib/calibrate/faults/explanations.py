"""Tests of an explanation: the scatter that it leaves, and further parameters estimated to first order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import (
    BundleAdjustment,
    adjust_bundle,
    exact_loads,
    noise_scale,
)
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.core.errors import SolveError
from vbaa_calib.core.least_squares import Linearised
from vbaa_calib.core.robust import chi_square, huber_weights, mad_std
from vbaa_calib.session import Load, LoadReadings

SENSOR_OFF = 1e6  # factor on the moment sensor's noise that leaves it out of a solve
_DEGREE = 7  # of the smooth curve that any bent antenna is in the picture
_READING_STD = (7e-4, 7e-3)
_FITS = 1.5  # an explanation fits that leaves at most this multiple of the pictures' own scatter
_ROUNDS, _UNWEIGHTED_ROUNDS, _CONVERGED = 10, 4, 0.02
"""Most rounds of a solve, the first ones without robust weights; it ends when the scatter falls by less than a part."""
_UNOBSERVABLE = 1e-9  # least share of a further parameter's information that the others leave


def solve_free(observations: Sequence[Observation], before: Prior, length_m: float, std_Nm: float) -> BundleAdjustment:
    """The no-load frames alone, without the moment sensor, which may be what is wrong. Raises SolveError."""
    free = [one for one in observations if not isinstance(one.still, Load)]
    if not free:
        raise SolveError("there is no no-load frame")
    return adjust_bundle(free, before, length_m, SENSOR_OFF * std_Nm)


def picture_scatter(observations: Sequence[Observation]) -> float:
    """Scatter of the points about a smooth curve in their own picture, over their deviations; at least 0.2."""
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
    """The points' scatter, over their stated deviations, with parameters `which` that change, by `prior_std` about 0,
    from the stills `after` on. All is solved for again, without the moment sensor: it may be what is wrong."""
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


@dataclass(frozen=True, eq=False)
class StillRows:
    """A linearised bundle adjustment with its R rows by still."""

    joint: BundleAdjustment  # where it comes from
    solution: Linearised  # linearised at its end, with the stills that took part
    points: Sequence[slice]  # per observation the slice of its points' rows; empty for one left out
    moments: np.ndarray  # (F,) its moment's row; −1 for one that was left out
    factor: np.ndarray  # (R,) on residuals and columns, that makes least squares of them
    readings: np.ndarray  # (R, K) by the errors of uncertain places and forces of the loads, in deviations

    @staticmethod
    def of(joint: BundleAdjustment) -> StillRows:
        """The rows of a joint solution."""
        problem, kept = joint.problem, joint.kept
        sizes = [len(seen) if inside else 0 for seen, inside in zip(problem.seen_at_lens, kept, strict=True)]
        ends = np.cumsum([0, *sizes])
        solution, readings = joint.solution, problem.groups.count
        if len(solution.residuals) != ends[-1] + int(kept.sum()) + problem.certain:
            # the last pass may have ended on other stills than it began with
            solution = problem.linearised(solution.parameters)
        # with the loads fixed where the solve had them; `with_readings` frees them again
        solution = exact_loads(solution, readings)
        moments = np.where(kept, ends[-1] + np.cumsum(kept) - 1, -1)
        points = [slice(a, b) for a, b in pairwise(ends)]
        return StillRows(joint, solution, points, moments, solution.weights, np.zeros((len(solution.residuals), 0)))

    def with_readings(self, noise_scale: float) -> StillRows:
        """The same with uncertain places and (relative) forces; noise_scale : of the points' deviations."""
        factor = self.factor.copy()
        factor[: self.points[-1].stop] *= self.joint.noise_scale / noise_scale
        loads, std = self.by_load(), reading_std(self.joint.problem.prior.readings)
        readings = np.zeros((len(factor), 2 * len(loads)))
        for column, (index, slopes) in enumerate(loads.items()):
            readings[self.of_stills([index]), 2 * column : 2 * column + 2] = slopes * std
        return replace(self, factor=factor, readings=readings)

    def without_sensor(self) -> StillRows:
        """The same without the moment readings, whose faults must not be attributed to something else."""
        factor = self.factor.copy()
        factor[self.moments[self.moments >= 0]] = 0.0
        return replace(self, factor=factor)

    def estimate(self) -> tuple[np.ndarray, np.ndarray]:
        """(17 + P,) parameters and their covariance, with the uncertainty of the loads' places and forces."""
        jacobian, residuals, matrix, scale = self._equations
        inverse = np.linalg.inv(matrix)
        step = -(inverse @ (jacobian.T @ residuals)) / scale
        count = self.solution.jacobian.shape[1]
        covariance = (inverse / np.outer(scale, scale))[:count, :count]
        return self.solution.parameters + step[:count], covariance

    def further(self, columns: np.ndarray, prior_std: float) -> Further | None:
        """What parameters would become whose changes, about 0 by `prior_std`, move the residuals along the columns (R,
        K); None where the others explain the same. The solve's own parameters, priors and uncertain readings take part.
        """
        own = columns * self.factor[:, None]
        size = np.linalg.norm(own, axis=0)
        if not (size > 0).all():
            return None
        own = own / size
        jacobian, residuals, matrix, _ = self._equations
        mixed = jacobian.T @ own
        solved = np.linalg.solve(matrix, np.column_stack([mixed, jacobian.T @ residuals]))
        left = own.T @ own - mixed.T @ solved[:, :-1]
        score = own.T @ residuals - mixed.T @ solved[:, -1]
        if np.linalg.eigvalsh(left).min() <= _UNOBSERVABLE:
            return None
        covariance = np.linalg.inv(left + np.diag((size * prior_std) ** -2.0))
        return Further(-(covariance @ score) / size, covariance / np.outer(size, size))

    @cached_property
    def _equations(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Jacobian, the readings' columns last, residuals and information of least squares; the Jacobian's scale."""
        jacobian = np.hstack([self.solution.jacobian, self.readings]) * self.factor[:, None]
        scale = np.linalg.norm(jacobian, axis=0)
        jacobian = jacobian / scale
        # the solve's own priors are among its rows
        prior = np.repeat([0.0, 1.0], [self.solution.jacobian.shape[1], self.readings.shape[1]])
        return jacobian, self.solution.residuals * self.factor, jacobian.T @ jacobian + np.diag(prior / scale**2), scale

    def of_stills(self, which: Sequence[int] | np.ndarray) -> np.ndarray:
        """(R,) whether a row belongs to one of these stills."""
        mask = np.zeros(len(self.solution.residuals), bool)
        for index in which:
            if self.moments[index] >= 0:
                mask[self.points[index]], mask[self.moments[index]] = True, True
        return mask

    def by_load(self) -> dict[int, np.ndarray]:
        """Of each load that took part, (N + 1, 2): slopes of its rows by its distance, per m, and by its log force."""
        slopes = self.joint.problem.whitened_by_load(self.solution.parameters)
        observations = enumerate(self.joint.noted)
        some = [i for i, one in observations if isinstance(one.still, Load) and self.moments[i] >= 0]
        problem = self.joint.problem
        return {i: np.vstack([problem.without_line(i, slopes[i][:-1]), slopes[i][-1:]]) for i in some}


def reading_std(readings: LoadReadings) -> tuple[float, float]:
    """Deviations of places (m) and weights (relative) of loads: as stated, at least a little more than usual."""
    distance_std_m, force_std = _READING_STD
    return max(distance_std_m, readings.distance_std_m), max(force_std, readings.force_std_relative)


class Further(NamedTuple):
    """Further parameters of a linearised solve: values (K,) and covariance (K, K)."""

    values: np.ndarray
    covariance: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """(K,)."""
        return np.sqrt(np.diag(self.covariance))

    def clear(self, least_std: float) -> np.ndarray:
        """(K,) the values along the directions in which they exceed so many deviations; all of one unit."""
        variances, axes = np.linalg.eigh(self.covariance)
        along = axes.T @ self.values
        return axes @ np.where(along**2 > least_std**2 * variances, along, 0.0)

    @property
    def chi_square(self) -> float:
        """With K degrees of freedom where all are 0: twice the decrease of the cost."""
        return chi_square(self.values, self.covariance)
