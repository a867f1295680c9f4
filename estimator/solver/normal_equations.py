"""Robust least squares over points, readings and priors, for a batch of frames on the nodes of their curves."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.core.arrays import Array, arange_like, namespace
from vbaa_calib.core.robust import huber_losses, huber_weights

from .prediction import Prediction, RigJacobian
from .residuals import NodeSums, PointResiduals, node_sums
from .rig_arrays import TIP_DEFLECTION_STD, RigArrays

_CONVERGED = 1e-4
"""Linear problems are solved once no frame's reweighted step promises to lower the cost by more than this part."""
_LEAST_DAMPING = 1e-12
"""Added to the diagonal of scaled normal equations: a direction without information stays where it is."""


@dataclass(frozen=True, eq=False)
class Problem:
    """B frames linearised about a prediction, in K = 4 + R unknowns and rig steps.

    Attributes
    ----------
    points : residuals of the points.
    jacobian : (B, M, K) of the curves' displacement along their normals.
    reading_jacobian : (B, 3, K) of the predicted readings, in deviations.
    reading_residual : (B, 3) in deviations.
    prior : (B, K) weights of the unknowns' squares.
    scatter : (B,) factor on the points' deviations.
    """

    points: PointResiduals
    jacobian: Array
    reading_jacobian: Array
    reading_residual: Array
    prior: Array
    scatter: Array

    def residuals_after(self, step: Array | None) -> tuple[Array, Array]:
        """Points' distances (B, N) and reading residuals (B, 3), after a small step (B, K) if one is given."""
        if step is None:
            return self.points.distance, self.reading_residual
        shift = self.points.interpolate((self.jacobian @ step[..., None])[..., 0])
        reading = self.reading_residual - (self.reading_jacobian @ step[..., None])[..., 0]
        return self.points.distance - shift, reading

    def with_rig_steps(self, steps: Array) -> Problem:
        """The same with the rig's steps (B, R) taken out of the residuals."""
        if steps.shape[1] == 0:
            return self
        zero = namespace(steps).zeros_like(self.prior[:, : self.prior.shape[1] - steps.shape[1]])
        distance, reading = self.residuals_after(namespace(steps).concat([zero, steps], -1))
        return replace(self, points=replace(self.points, distance=distance), reading_residual=reading)

    def weighted_sums(self, distance: Array, whitened: Array) -> NodeSums:
        """Distances (B, N) with the robust weights of `whitened` ones, summed over the nodes."""
        weights = huber_weights(whitened) * self.points.precision / self.scatter[:, None] ** 2
        return node_sums(self.points, weights, distance, self.jacobian.shape[1])

    @property
    def sums(self) -> NodeSums:
        """The points' residuals, summed over the nodes."""
        return self.weighted_sums(self.points.distance, self.whitened(self.points.distance))

    def whitened(self, distance: Array) -> Array:
        """Distances (B, N) over their deviations; 0 for a missing point."""
        return distance * namespace(distance).sqrt(self.points.precision) / self.scatter[:, None]


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Information (B, K, K), right side (B, K) = information · step, and the cost (B,)."""

    information: Array
    right_side: Array
    cost: Array


def linear_problem(
    rig_arrays: RigArrays, prediction: Prediction, by_rig: RigJacobian, points: PointResiduals, scatter: Array
) -> Problem:
    """Join the derivatives by the contact and by the rig, and the priors of both."""
    xp = namespace(scatter)
    force = (rig_arrays.tip_deflection(prediction.contact_m / prediction.length_m) / TIP_DEFLECTION_STD) ** 2
    prior = xp.zeros_like(force)[:, None] + rig_arrays.prior
    prior[:, 1:3] = force[:, None]
    jacobian = xp.concat([prediction.jacobian, by_rig.image], -1)
    reading_jacobian = xp.concat([prediction.reading_jacobian, by_rig.reading], -1)
    return Problem(points, jacobian, reading_jacobian, prediction.reading_residual, prior, scatter)


def cost(problem: Problem, at: Array, step: Array | None = None) -> Array:
    """(B,) robust cost with the priors of values `at` (B, K), after a small step (B, K) towards them."""
    distance, reading = problem.residuals_after(step)
    return _total_cost(problem, at, problem.whitened(distance), reading)


def _total_cost(problem: Problem, at: Array, whitened: Array, reading: Array) -> Array:
    points = huber_losses(whitened).sum(-1)
    return points + huber_losses(reading).sum(-1) + 0.5 * (problem.prior * at * at).sum(-1)


def normal_equations(problem: Problem, at: Array, step: Array | None = None) -> NormalEquations:
    """Reweighted at the residuals after a small step (B, K), for a further step from values `at` (B, K)."""
    distance, reading = problem.residuals_after(step)
    whitened = problem.whitened(distance)
    sums = problem.weighted_sums(distance, whitened)
    weighted = huber_weights(reading)[..., None] * problem.reading_jacobian
    information = problem.jacobian.mT @ sums.times(problem.jacobian) + problem.reading_jacobian.mT @ weighted
    right_side = (problem.jacobian.mT @ sums.load[..., None] + weighted.mT @ reading[..., None])[..., 0]
    diagonal = arange_like(at, problem.jacobian.shape[-1])
    information[:, diagonal, diagonal] += problem.prior
    total = _total_cost(problem, at, whitened, reading)
    return NormalEquations(information, right_side - problem.prior * at, total)


def solve_normal_equations(information: Array, right_side: Array, damping: Array | None = None) -> Array:
    """Steps (B, K) of normal equations, scaled to a unit diagonal, to which damping (B,) is added."""
    return solve_columns(information, right_side[..., None], damping)[..., 0]


def solve_columns(information: Array, right_sides: Array, damping: Array | None = None) -> Array:
    """`solve_normal_equations` for several right sides (B, K, C) at once."""
    xp = namespace(right_sides)
    diagonal = arange_like(right_sides, right_sides.shape[1])
    scale = xp.sqrt(information[:, diagonal, diagonal])
    scale = xp.where(scale > 0.0, scale, xp.ones_like(scale))
    unit = information / (scale[:, :, None] * scale[:, None])
    unit[:, diagonal, diagonal] += _LEAST_DAMPING if damping is None else damping[:, None] + _LEAST_DAMPING
    return xp.linalg.solve(unit, right_sides / scale[..., None]) / scale[..., None]


def least_cost(problem: Problem, at: Array, rounds: int) -> Array:
    """(B,) least cost of the linear problem by IRLS from values `at` (B, K), in so many rounds at most."""
    step = namespace(at).zeros_like(at)
    for _ in range(rounds):
        now = normal_equations(problem, at + step, step)
        change = solve_normal_equations(now.information, now.right_side)
        step = step + change
        if bool(((now.right_side * change).sum(-1) < _CONVERGED * (1.0 + now.cost)).all()):
            break
    return cost(problem, at + step, step)
