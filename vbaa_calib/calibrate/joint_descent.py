"""Down to the least robust cost of a joint problem, by Levenberg and Marquardt's steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.independent_axes import inverse_information
from ..reprojection import robust_cost, robust_weights
from .joint_problem import Problem

ITERATIONS = 40
ROUGHLY, STANDSTILL = 0.1, 1e-11
"""A step that promises less than this much of the cost is the last: on the way half a standard deviation, at the
end a few millionths."""

UNSURE = 1e-3
"""A rise of the cost by less is none: the slopes, by differences, are zero a little beside where it is least."""
ENOUGH = 1e-5
"""A step that promises no more than this after all iterations has converged, too."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """Where a solve is.

    Attributes
    ----------
    parameters : (17 + P,). residuals : (R,). jacobian : (R, 17 + P) of them.
    certain : how many of the residuals, the last ones, are priors'.
    converged : whether the solver came to a standstill.
    """

    parameters: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    certain: int
    converged: bool = False

    @staticmethod
    def of(problem: Problem, parameters: np.ndarray) -> Linearised:
        """A problem at its parameters."""
        return Linearised(parameters, *problem.residuals(parameters), problem.certain)

    def exact_loads(self, readings: int) -> Linearised:
        """The same with the loads' readings, the last so many parameters, held where they are."""
        if not readings:
            return self
        rows = slice(0, len(self.residuals) - readings)
        kept = slice(0, len(self.parameters) - readings)
        certain = self.certain - readings
        return Linearised(
            self.parameters[kept], self.residuals[rows], self.jacobian[rows, kept], certain, self.converged
        )

    @property
    def weights(self) -> np.ndarray:
        """(R,) factors on residuals and Jacobian that make least squares of the robust cost."""
        return np.concatenate([robust_weights(self.residuals[: -self.certain]), np.ones(self.certain)])

    @property
    def cost(self) -> float:
        """What is minimised: robust in what was measured, plain squares in what was known before."""
        prior = self.residuals[-self.certain :]
        return robust_cost(self.residuals[: -self.certain]) + 0.5 * float(prior @ prior)

    def normal_equations(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Reweighted information and slope, and the scale that was taken out of both: units differ greatly."""
        weights = self.weights
        weighted = self.jacobian * weights[:, None]
        scale = np.linalg.norm(weighted, axis=0)
        weighted /= scale
        return weighted.T @ weighted, weighted.T @ (self.residuals * weights), scale

    def covariance(self) -> np.ndarray:
        """(17 + P, 17 + P) inverse of the information."""
        return inverse_information(self.jacobian * self.weights[:, None])


def _tried(problem: Problem, parameters: np.ndarray) -> Linearised | None:
    """Where a step leads; None where it winds the antenna up until it has no shape."""
    try:
        trial = Linearised.of(problem, parameters)
    except ValueError:
        return None
    return trial if np.isfinite(trial.residuals).all() and np.isfinite(trial.jacobian).all() else None


def _step(information: np.ndarray, slope: np.ndarray, damping: float, at_end: np.ndarray) -> np.ndarray:
    """(N,) Levenberg and Marquardt's, without what is at its upper end and would go further."""
    whole = information + damping * np.eye(len(slope))
    step = -np.linalg.solve(whole, slope)
    free = ~(at_end & (step > 0.0))
    if free.all():
        return step
    held = np.zeros(len(slope))
    held[free] = -np.linalg.solve(whole[np.ix_(free, free)], slope[free])
    return held


def descend(
    problem: Problem,
    start: np.ndarray,
    evaluated: tuple[list[np.ndarray], np.ndarray],
    standstill: float = STANDSTILL,
) -> Linearised:
    """Parameters of least robust cost, by Levenberg and Marquardt's steps.

    evaluated : what `Problem.evaluate` gives at the start.
    """
    upper = problem.upper
    if (start <= upper).all():
        now = Linearised(start, *problem.residuals(start, evaluated), problem.certain)
    else:
        now = Linearised.of(problem, np.minimum(start, upper))
    damping = 0.0
    for _ in range(ITERATIONS):
        information, slope, scale = now.normal_equations()
        at_end = now.parameters >= upper
        step = _step(information, slope, damping, at_end)
        # of the whole step: a damped one is short wherever it is taken
        whole = _step(information, slope, 0.0, at_end) if damping else step
        promise = -float(slope @ whole + 0.5 * whole @ information @ whole)
        moved = np.minimum(now.parameters + step / scale, upper)
        trial = _tried(problem, moved)
        better = trial is not None and trial.cost <= now.cost + UNSURE
        now = trial if trial is not None and better else now
        if promise < standstill:
            return replace(now, converged=True)
        damping = 0.1 * damping if better else max(10.0 * damping, 1e-3)
    return replace(now, converged=promise < ENOUGH)
