"""Which rows of the joint solve's Jacobian belong to which still, and what further parameters would have become.

To first order everywhere: nothing is solved again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import JointSolution, Linearised
from vbaa_calib.calibrate.antenna.inputs import DISTANCE_STEP_M, LOG_FORCE_STEP, Observation
from vbaa_calib.calibrate.antenna.problem import ANTENNA, GAIN
from vbaa_calib.core.robust import chi_square_p
from vbaa_calib.rig.reprojection import image_curves, whitened_residuals
from vbaa_calib.session import Load

DEAD_DIRECTION = 1e-9
"""Part of a further parameter's information that must be left beside the others', for it to be estimated."""


@dataclass(frozen=True, eq=False)
class StillRows:
    """A linearised joint solve with its rows by still.

    Attributes
    ----------
    joint : where it comes from. solution : linearised at its end, with the stills that took part.
    points : per observation the slice of its points' rows; empty for one that was left out.
    moments : (F,) its moment's row; −1 for one that was left out.
    factor : (R,) on residuals and columns, that makes least squares of them.
    readings : (R, K) columns of the loads' own readings, each times its standard deviation: what is not known of
        places and weights is not to be taken for something else. K is 0 where they count as exact.
    """

    joint: JointSolution
    solution: Linearised
    points: Sequence[slice]
    moments: np.ndarray
    factor: np.ndarray
    readings: np.ndarray

    @staticmethod
    def of(joint: JointSolution) -> StillRows:
        """The rows of a joint solution."""
        problem, kept = joint.problem, joint.kept
        sizes = [len(seen) if inside else 0 for seen, inside in zip(problem.seen_at_lens, kept, strict=True)]
        ends = np.cumsum([0, *sizes])
        solution, readings = joint.solution, problem.groups.count
        if len(solution.residuals) != ends[-1] + int(kept.sum()) + problem.certain:
            # the last pass may have ended on other stills than it began with
            solution = Linearised.of(problem, solution.parameters)
        # with the loads held where the solve had them; `with_readings` lets go of them again
        solution = solution.exact_loads(readings)
        moments = np.where(kept, ends[-1] + np.cumsum(kept) - 1, -1)
        points = [slice(a, b) for a, b in pairwise(ends)]
        return StillRows(joint, solution, points, moments, solution.weights, np.zeros((len(solution.residuals), 0)))

    def with_readings(self, distance_std_m: float, force_std: float, noise_scale: float) -> StillRows:
        """The same with the loads' places and forces known only so well, and the points' scatter as it is without them.

        force_std : relative. noise_scale : factor on the points' deviations, of the free antenna, say.
        """
        observations = self.joint.problem.observations
        columns = []
        for column, std in zip(self.by_load(), (distance_std_m, force_std), strict=True):
            for index, one in enumerate(observations):
                if isinstance(one.still, Load) and self.moments[index] >= 0:
                    columns.append(std * np.where(self.of_stills([index]), column, 0.0))
        factor = self.factor.copy()
        factor[: self.points[-1].stop] *= self.joint.noise_scale / noise_scale
        return replace(self, factor=factor, readings=np.array(columns).reshape(-1, len(factor)).T)

    def without_sensor(self) -> StillRows:
        """The same with the moment readings left out: what is wrong with them is not to be taken for something else."""
        factor = self.factor.copy()
        factor[self.moments[self.moments >= 0]] = 0.0
        return replace(self, factor=factor)

    def resolved(self) -> tuple[np.ndarray, np.ndarray]:
        """(17 + P,) parameters and their covariance, to first order, with the loads' readings as they are known."""
        jacobian, residuals, known = _weighted(self)
        scale = np.linalg.norm(jacobian, axis=0)
        scaled = jacobian / scale
        inverse = np.linalg.inv(scaled.T @ scaled + np.diag(known / scale**2))
        step = -(inverse @ (scaled.T @ residuals)) / scale
        count = self.solution.jacobian.shape[1]
        covariance = (inverse / np.outer(scale, scale))[:count, :count]
        return self.solution.parameters + step[:count], covariance

    def of_stills(self, which: Sequence[int] | np.ndarray, moments: bool = True) -> np.ndarray:
        """(R,) whether a row belongs to one of these stills."""
        mask = np.zeros(len(self.solution.residuals), bool)
        for index in which:
            mask[self.points[index]] = True
            if moments and self.moments[index] >= 0:
                mask[self.moments[index]] = True
        return mask

    def own(self, parameter: int, which: Sequence[int] | np.ndarray) -> np.ndarray:
        """(R,) column of a parameter that these stills have to themselves, beside the common one."""
        return np.where(self.of_stills(which), self.solution.jacobian[:, parameter], 0.0)

    def by_load(self) -> tuple[np.ndarray, np.ndarray]:
        """(R,) changes of the residuals per m of each load towards the clamp, and per unit of its force's logarithm."""
        altered = [one.with_readings_altered() for one in self.joint.problem.observations]
        nearer, heavier = [one for one, _ in altered], [one for _, one in altered]
        return self.altered(nearer, DISTANCE_STEP_M), self.altered(heavier, LOG_FORCE_STEP)

    def altered(self, changed: Sequence[Observation], step: float) -> np.ndarray:
        """(R,) change of the residuals per unit, where every observation is altered (its load, its gravity) by step.

        The points are compared, not seen anew.
        """
        problem, parameters = self.joint.problem, self.solution.parameters
        pairs = [one for pair in zip(problem.observations, changed, strict=True) for one in pair]
        curves = replace(problem, observations=pairs).curves(parameters[None, ANTENNA])
        view = [problem.pose(parameters).inverse()] * 2
        column = np.zeros(len(self.solution.residuals))
        seen = problem.seen(parameters)
        for index, rows in enumerate(self.points):
            if self.moments[index] < 0 or pairs[2 * index] is pairs[2 * index + 1]:
                continue
            both = np.array([2 * index, 2 * index + 1])
            distances = whitened_residuals(seen[index], image_curves(curves.picked(both), view))
            column[rows] = (distances[:, 1] - distances[:, 0]) / step / problem.noise_scale
            moment = float(np.diff(curves.moment_Nm[both])[0]) / step
            column[self.moments[index]] = parameters[GAIN] * moment / problem.moment_std_Nm
        return column


@dataclass(frozen=True, eq=False)
class Further:
    """Further parameters of a linearised solve.

    Attributes
    ----------
    values : (K,) what they would have become. covariance : (K, K).
    """

    values: np.ndarray
    covariance: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """(K,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def statistic(self) -> float:
        """χ² with K degrees of freedom where they are all 0: what the cost would fall by, twice over."""
        unit = self.std
        scaled = self.values / unit
        return float(scaled @ np.linalg.solve(self.covariance / np.outer(unit, unit), scaled))

    @property
    def p_value(self) -> float:
        """How often chance does as much."""
        return chi_square_p(self.statistic, len(self.values))

    @property
    def in_std(self) -> float:
        """As rare as so many standard deviations of one number, roughly: the root of χ² over its freedom's mean."""
        return float(np.sqrt(self.statistic / len(self.values)))


def further(rows: StillRows, columns: np.ndarray, prior_std: float = np.inf) -> Further | None:
    """What parameters would be whose changes move the residuals along the columns (R, K); None if others do the same.

    The solve's own parameters and priors take part, and so do the loads' readings where they count as uncertain.

    prior_std : of the further parameters, about 0: keeps what is hardly seen from becoming absurd.
    """
    own = columns * rows.factor[:, None]
    size = np.linalg.norm(own, axis=0)
    if not (size > 0).all():
        return None
    own = own / size
    jacobian, residuals, known = _weighted(rows)
    scale = np.linalg.norm(jacobian, axis=0)
    jacobian = jacobian / scale
    mixed = jacobian.T @ own
    both = np.column_stack([mixed, jacobian.T @ residuals])
    solved = np.linalg.solve(jacobian.T @ jacobian + np.diag(known / scale**2), both)
    left = own.T @ own - mixed.T @ solved[:, :-1]
    score = own.T @ residuals - mixed.T @ solved[:, -1]
    if np.linalg.eigvalsh(left).min() <= DEAD_DIRECTION:
        return None
    left = left + np.diag((size * prior_std) ** -2.0)
    covariance = np.linalg.inv(left)
    return Further(-(covariance @ score) / size, covariance / np.outer(size, size))


def _weighted(rows: StillRows) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least squares' Jacobian and residuals, the readings' columns last, and what is known of each column before."""
    jacobian = np.hstack([rows.solution.jacobian, rows.readings]) * rows.factor[:, None]
    # the solve's own priors are among its rows
    known = np.repeat([0.0, 1.0], [rows.solution.jacobian.shape[1], rows.readings.shape[1]])
    return jacobian, rows.solution.residuals * rows.factor, known
