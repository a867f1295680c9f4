"""Covariance, contact evidence and model bias of converged fits."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import Array, arange_like, namespace, true_indices
from vbaa_calib.core.robust import huber_weights

from .convergence import EXCESS_SCATTER, moved_unknowns
from .initialization import FreeAntenna
from .normal_equations import Problem, cost, least_cost, solve_normal_equations
from .prediction import FRICTION_RUNGS, Prediction, difference, predict
from .residuals import point_residuals
from .rig_arrays import UNKNOWNS
from .rows import select
from .state import Fits, linearise

REFERENCE = RUNGS[-1]
"""The rung that the others are compared with."""
_ROUNDS, _CLOSE_ROUNDS = 4, 2
"""IRLS rounds of a linear problem: far from the solution, and beside it."""
_LEAST_REDUNDANCY = 0.03
"""Least deviation of a moment's residual in its own deviations: with less the moment was fitted, not tested."""
_PROFILE_STEPS = (3.0, 6.0, -3.0, -6.0)
"""Deviations from the minimum at which the cost is profiled."""
_SINGULAR = 1e14
"""Condition number of the scaled information beyond which the covariance is infinite."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """First-order uncertainty of B fits.

    Attributes
    ----------
    covariance : (B, 4, 4) of the unknowns, from noise and rig together; infinite where they are not observable.
    rig_response : (B, R, 4) how the rig's likeliest steps go with the unknowns.
    rig_covariance : (B, R, R) of the rig's steps for a known contact.
    condition : (B,) condition number of the contact's own information, scaled to a unit diagonal.
    reading_std : (B, 3) deviation of each reading's whitened residual, below one as far as the moment was fitted.
    """

    covariance: Array
    rig_response: Array
    rig_covariance: Array
    condition: Array
    reading_std: Array

    @property
    def std(self) -> Array:
        """(B, 4) standard deviations of the unknowns."""
        index = arange_like(self.covariance, UNKNOWNS)
        return namespace(self.covariance).sqrt(self.covariance[:, index, index])

    def correlation(self, first: int, second: int) -> Array:
        """(B,) of two unknowns; NaN where they are not observable, or fixed."""
        std = self.std
        return self.covariance[:, first, second] / (std[:, first] * std[:, second])

    def covariance_with_rig(self, by_unknowns: Array, by_rig: Array) -> Array:
        """(B, Q, R) of quantities with derivatives (B, Q, 4) and (B, Q, R) with the rig's steps."""
        total = by_unknowns + by_rig @ self.rig_response
        return total @ self.covariance @ self.rig_response.mT + by_rig @ self.rig_covariance

    def propagate(self, by_unknowns: Array, by_rig: Array) -> Array:
        """Covariance (B, Q, Q) of quantities with derivatives (B, Q, 4) and (B, Q, R)."""
        total = by_unknowns + by_rig @ self.rig_response
        return total @ self.covariance @ total.mT + by_rig @ self.rig_covariance @ by_rig.mT


def uncertainty(fits: Fits) -> Uncertainty:
    """Invert the fits' information by the Schur complement of the rig's part, whose prior keeps it regular.

    A distance fixed at the tip gets the deviation that it would have if it were free.
    """
    whole = fits.equations.information
    xp = namespace(whole)
    rig_covariance = xp.linalg.inv(whole[:, UNKNOWNS:, UNKNOWNS:])
    response = -(rig_covariance @ whole[:, UNKNOWNS:, :UNKNOWNS])
    information = whole[:, :UNKNOWNS, :UNKNOWNS] + whole[:, :UNKNOWNS, UNKNOWNS:] @ response
    index = arange_like(whole, UNKNOWNS)
    diagonal = information[:, index, index]
    regular = (diagonal > 0.0).all(-1) & xp.isfinite(information).all(-1).all(-1)
    scale = xp.sqrt(xp.where(regular[:, None], diagonal, xp.ones_like(diagonal)))
    unit = information / (scale[:, :, None] * scale[:, None])
    values, vectors = xp.linalg.eigh(xp.where(regular[:, None, None], unit, fits.frames.rig_arrays.unit_steps[1:]))
    regular = regular & (values[:, 0] > values[:, -1] / _SINGULAR)
    values = xp.clip(values, 1e-300, None)
    covariance = (vectors / values[:, None]) @ vectors.mT / (scale[:, :, None] * scale[:, None])
    weighted = fits.problem.reading_jacobian * xp.sqrt(huber_weights(fits.problem.reading_residual))[..., None]
    own = weighted[..., :UNKNOWNS] + weighted[..., UNKNOWNS:] @ response
    fitted = ((own @ covariance) * own).sum(-1)
    fitted = fitted + ((weighted[..., UNKNOWNS:] @ rig_covariance) * weighted[..., UNKNOWNS:]).sum(-1)
    covariance = covariance * _huber_variance_inflation(fits.problem)[:, None, None]
    redundant = xp.clip(1.0 - fitted, _LEAST_REDUNDANCY**2, None)
    return Uncertainty(
        xp.where(regular[:, None, None], covariance, xp.inf),
        response,
        rig_covariance,
        xp.where(regular, values[:, -1] / values[:, 0], xp.inf),
        xp.where(regular[:, None], xp.sqrt(redundant), 1.0),
    )


def _huber_variance_inflation(problem: Problem) -> Array:
    """(B,) Σψ²/Σw of Huber's ψ and weights, where it is more than noise gives, else 1."""
    xp = namespace(problem.scatter)
    whitened = problem.whitened(problem.points.distance)
    seen = xp.where(problem.points.precision > 0.0, xp.ones_like(whitened), xp.zeros_like(whitened))
    weights = huber_weights(whitened) * seen
    factor = (weights * whitened) ** 2
    factor = factor.sum(-1) / xp.clip(weights.sum(-1), 1e-30, None)
    return xp.where(factor > 1.0 + EXCESS_SCATTER / xp.sqrt(seen.sum(-1) + 1e-30), factor, xp.ones_like(factor))


def widened_by_profile(fits: Fits, found: Uncertainty, which: Array) -> Uncertainty:
    """The same, wider where the cost rises more slowly than its curvature says, for some of the frames (B,).

    By vision alone, the picture holds a small deflection along the line of sight by second order only: some deviations
    out along the longest axis the cost is then far from what it should have risen by.
    """
    if not bool(which.any()):
        return found
    xp = namespace(which)
    rows = true_indices(which)
    state, covariance = select(fits.state, rows), found.covariance[rows]
    sound = xp.isfinite(covariance).all(-1).all(-1)
    covariance = xp.where(sound[:, None, None], covariance, fits.frames.rig_arrays.unit_steps[1:])
    index = arange_like(covariance, UNKNOWNS)
    std = xp.sqrt(covariance[:, index, index])
    sizes, axes = xp.linalg.eigh(covariance / (std[:, :, None] * std[:, None]))
    axis = std * axes[..., -1] * xp.sqrt(sizes[:, -1:])
    out = xp.concat([far + 0.0 * std[:, :1] for far in _PROFILE_STEPS])
    several = xp.concat([arange_like(std, len(rows))] * len(_PROFILE_STEPS))
    frames, by_rig, state = (
        select(fits.frames, rows[several]),
        select(fits.by_rig, rows[several]),
        select(state, several),
    )
    unknowns = moved_unknowns(frames.rig_arrays, state.unknowns, out * axis[several])
    rig_steps = state.rig_steps + (found.rig_response[rows[several]] @ (unknowns - state.unknowns)[..., None])[..., 0]
    there = replace(state, unknowns=unknowns, rig_steps=rig_steps)
    rise = cost(linearise(frames, fits.rung, by_rig, there), there.values) - fits.equations.cost[rows[several]]
    wider = 0.5 * out[:, 0] ** 2 / xp.clip(xp.nan_to_num(rise, nan=0.0), 0.01, None)
    wider = xp.clip(xp.amax(wider.reshape(-1, len(rows)), 0), 1.0, None)
    factor = xp.ones_like(fits.state.scatter)
    factor[rows] = xp.where(sound, wider, 1.0)
    return replace(found, covariance=found.covariance * factor[:, None, None])


def _linear_shift(fits: Fits, displacement: Array, reading: Array) -> Array:
    """(B, 4) how far the unknowns would move, to first order, if the data changed.

    `displacement` (B, M) along the prediction's normals, `reading` (B, 3) in deviations.
    """
    problem = fits.problem
    right_side = (problem.jacobian.mT @ problem.sums.times(displacement[..., None]))[..., 0]
    weighted = (huber_weights(problem.reading_residual) * reading)[..., None]
    right_side = right_side + (problem.reading_jacobian.mT @ weighted)[..., 0]
    return solve_normal_equations(fits.equations.information, right_side)[:, :UNKNOWNS]


def _friction_difference(fits: Fits, truth: tuple[Array, ...]) -> list[Array]:
    """What one deviation of friction changes on the highest rung, whose `difference` without it is the truth."""
    unit = fits.frames.rig_arrays.unit_steps[UNKNOWNS]
    with_friction = predict(fits.frames, REFERENCE, fits.state.unknowns + unit, derivatives=False)
    return [a - b for a, b in zip(difference(fits.prediction, with_friction), truth, strict=True)]


def predicted_bias(
    fits: Fits, found: Uncertainty, reference: Prediction, rungs: tuple[str, ...] = RUNGS
) -> dict[str, Array]:
    """Each rung's bias (B,) at the fitted contacts: the largest of distance, f_y and f_z, in standard deviations.

    How far a fit on it would move if the antenna were the highest rung's, whose prediction is the `reference`; on rungs
    without friction, also by one deviation of friction. Infinite where the deviations are not known.
    """
    xp = namespace(found.covariance)
    frames, unknowns, prediction = fits.frames, fits.state.unknowns, fits.prediction
    force = slice(4, 6)
    by_force = prediction.point_force_jacobian[:, force]
    covariance = found.propagate(by_force, fits.by_rig.point_force[:, force])
    std = xp.sqrt(xp.concat([found.covariance[:, :1, 0], covariance[:, :1, 0], covariance[:, 1:, 1]], -1))
    sound = xp.isfinite(std).all(-1)

    def in_std(displacement: Array, reading: Array, point_force: Array) -> Array:
        moved = _linear_shift(fits, displacement, reading)[..., None]
        off = xp.concat([moved[:, 0], (by_force @ moved)[..., 0] - point_force[:, force]], -1)
        return xp.where(sound[:, None], xp.abs(off) / xp.where(sound[:, None], std, 1.0), xp.inf)

    truth = difference(prediction, reference)
    friction = 0.0
    if frames.rig_arrays.friction_rad > 0.0 and not set(rungs) <= set(FRICTION_RUNGS):
        friction = in_std(*_friction_difference(fits, truth))
    bias = {}
    for rung in rungs:
        if rung == REFERENCE:
            bias[rung] = xp.where(sound, xp.zeros_like(std[:, 0]), xp.full_like(std[:, 0], xp.inf))
            continue
        own = (0.0, 0.0, 0.0)
        if rung != fits.rung:
            own = difference(prediction, predict(frames, rung, unknowns, derivatives=False))
        shape = in_std(*(a - b for a, b in zip(truth, own, strict=True)))
        both = shape if rung in FRICTION_RUNGS else xp.sqrt(shape**2 + friction**2)
        bias[rung] = xp.amax(both, -1)
    return bias


def model_errors(fits: Fits, reference: Prediction) -> Array:
    """(B, 2, 10) signed first-order errors of unknowns (4), contact point and force (6) on the fits' rung.

    By what the rung leaves out of the highest one, and by one deviation of the friction that it does not model.
    """
    xp, prediction = namespace(fits.state.scatter), fits.prediction

    def errors(displacement: Array, reading: Array, point_force: Array) -> Array:
        moved = _linear_shift(fits, displacement, reading)
        return xp.concat([moved, (prediction.point_force_jacobian @ moved[..., None])[..., 0] - point_force], -1)

    truth = difference(prediction, reference)
    shape = errors(*truth)
    if fits.rung in FRICTION_RUNGS or fits.frames.rig_arrays.friction_rad == 0.0:
        return xp.stack([shape, xp.zeros_like(shape)], 1)
    friction = errors(*_friction_difference(fits, truth))
    # that friction turns the force along the antenna is in the point and force's own covariance already
    return xp.stack([shape, xp.concat([friction[:, :7], 0.0 * friction[:, :1], friction[:, 8:]], -1)], 1)


def problem_on(fits: Fits, prediction: Prediction) -> Problem:
    """The fits' problem with the residuals that another rung's prediction at the same unknowns leaves."""
    points = point_residuals(fits.frames, prediction, fits.state.foot_m)
    problem = replace(fits.problem, points=points, reading_residual=prediction.reading_residual)
    return problem.with_rig_steps(fits.state.rig_steps)


def contact_evidence(fits: Fits, problem: Problem, free: FreeAntenna) -> Array:
    """(B,) how much better a contact explains the frames than the free antenna: half the difference of squares.

    Both may move the rig within its joint covariance first, so that a clamp angle that is known badly is not taken for
    a contact. Without contact it is 1.5 to 2 (three unknowns fitted to noise). Both are compared on the highest rung,
    `problem` with its residuals: what a lower one leaves out of the weight must not pass for a force.
    """
    alone = Problem(
        free.points,
        free.by_rig.image,
        free.by_rig.reading,
        free.prediction.reading_residual,
        problem.prior[:, UNKNOWNS:],
        problem.scatter,
    )
    without = least_cost(alone, 0.0 * fits.state.rig_steps, _ROUNDS if alone.jacobian.shape[-1] else 0)
    return without - least_cost(problem, fits.state.values, _CLOSE_ROUNDS)
