"""Nonlinear least squares: Levenberg–Marquardt, robust losses, priors as rows, and Schur complements over views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from vbaa_calib.core.robust import (
    chi_square,
    chi_square_p,
    huber_losses,
    huber_weights,
    soft_l1_losses,
    soft_l1_weights,
)

CHANCE_SCATTER = 1.2  # ratio of variances that noise alone often reaches: what is beyond widens a covariance


_Point = TypeVar("_Point", bound=Any)
"""A problem linearised at some parameters; it has a `cost`."""


@dataclass(frozen=True)
class Rules:
    """Termination rules of an iterative minimisation.

    iterations : at most.
    tolerance, standstill : it ends at a step that promises to lower the cost by less than this share, or this amount.
    takes_last : whether that step is taken, too. Where the slopes are exact and a linearisation is expensive it need
        not be; where they are finite differences it brings the parameters the last millionth of a standard deviation
        closer.
    may_rise_share, may_rise : a cost that rises by no more than this, of the cost or as such, is rounding.
    damping : of the first step.
    growth, after_failure : factor on the damping after a step that failed, and the least damping then. Far
        from a minimum small increases lead to it in fewer steps; close to it a failure is rounding, and the next step
        is to be a clearly shorter one.
    relief : factor on the damping after a step that succeeded. Where steps fail for the problem's curvature, not for
        its distance, the next one needs nearly the same damping.
    """

    iterations: int
    tolerance: float = 0.0
    standstill: float = 0.0
    takes_last: bool = False
    may_rise_share: float = 0.0
    may_rise: float = 0.0
    damping: float = 0.0
    growth: float = 10.0
    after_failure: float = 1e-3
    relief: float = 0.1


def levenberg_marquardt(
    at: _Point,
    step: Callable[[_Point, float], tuple[np.ndarray, float]],
    moved: Callable[[_Point, np.ndarray], _Point | None],
    rules: Rules,
) -> tuple[_Point, float, bool]:
    """Minimises a cost by Levenberg–Marquardt; returns the point, the decrease that its next step predicts, and
    whether the iterations were exhausted.

    step : gives the step, and the decrease of the cost it predicts, at a point and with a damping in units of the
        diagonal of the normal equations.
    moved : gives the point after a step; None where it is not valid.
    """
    damping, promise = rules.damping, np.inf
    for _ in range(rules.iterations):
        try:
            move, promise = step(at, damping)
        except np.linalg.LinAlgError:
            damping = max(rules.growth * damping, rules.after_failure)
            continue
        # a damped step is short wherever it is taken
        last = promise <= rules.standstill + rules.tolerance * at.cost and damping < 1.0
        if last and not rules.takes_last:
            return at, promise, False
        trial = moved(at, move)
        rounding = rules.may_rise + rules.may_rise_share * at.cost
        if trial is not None and np.isfinite(trial.cost) and trial.cost <= at.cost + rounding:
            decrease, at = at.cost - trial.cost, trial
            damping = max(rules.relief * damping, 1e-15)
            last |= rounding < decrease <= rules.tolerance * at.cost and damping < 1.0
        else:
            damping = max(rules.growth * damping, rules.after_failure)
        if last or damping > 1e12:
            return at, promise, False
    return at, promise, True


def solve_scaled(matrix: np.ndarray, right: np.ndarray, damping: float = 0.0) -> np.ndarray:
    """Solution (P,) or (P, K) of normal equations (P, P) with unknowns of very different magnitude."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    rows = scale.reshape(-1, *[1] * (right.ndim - 1))
    scaled = matrix * np.outer(scale, scale) + damping * np.eye(len(matrix))
    return rows * np.linalg.lstsq(scaled, rows * right, rcond=1e-15)[0]


def schur_complement(total: np.ndarray, cross: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The normal equations with each view's own unknowns eliminated.

    total : (m, m) of what all views share. own : (V, k, k) of the views' own. cross : (V, k, m) between them.

    Returns the reduced equations (m, m), and own⁻¹·cross (V, k, m), from which the own unknowns follow.
    """
    through = np.linalg.solve(own, cross)
    return total - np.einsum("vki,vkj->ij", cross, through), through


MIN_INFORMATION = 0.05
"""Smallest ratio of data to prior information with which a direction counts."""


def disagreement(information: np.ndarray, pull: np.ndarray, total: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """χ² and degrees of freedom, both (G,), of the disagreement of groups of residuals with all the others.

    Where a group of information S agrees with the others, its gradient r at the common solution has the covariance
    S − S·H⁻¹·S, H the information of all. Only directions in which the group has information count.

    information : (G, S, S), pull : (G, S), in units of the prior's deviations. total : (S, S).
    """
    values, vectors = np.linalg.eigh(information)
    identified = values > MIN_INFORMATION
    along = np.einsum("gsk,gs->gk", vectors, pull)
    mixed = np.swapaxes(vectors, 1, 2) @ information
    covariance = values[:, :, None] * np.eye(values.shape[1]) - mixed @ np.linalg.solve(total, np.swapaxes(mixed, 1, 2))
    both = identified[:, :, None] & identified[:, None, :]
    scale = np.where(identified, 1.0 / np.sqrt(np.where(identified, values, 1.0)), 0.0)
    unit = np.where(both, covariance * scale[:, :, None] * scale[:, None, :], np.eye(values.shape[1]))
    # a group that is nearly all there is has nothing to disagree with
    roots, turns = np.linalg.eigh(unit)
    free = roots > 1e-3
    parts = np.einsum("gkj,gk->gj", turns, along * scale)
    square = np.where(free, parts**2 / np.where(free, roots, 1.0), 0.0).sum(axis=1)
    return square, np.maximum(identified.sum(axis=1) - (~free).sum(axis=1), 0)


def disagreement_p(square: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """(G,) p-value of each χ² of `disagreement`; 1 without degrees of freedom."""
    groups = zip(square.tolist(), freedom.astype(int).tolist(), strict=True)
    return np.array([chi_square_p(*group) if group[1] > 0 else 1.0 for group in groups])


def padded(rows: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """(V, 2M, m) rows (N, 2, m) by view, padded with rows of zeros where a view has fewer than M."""
    counts = np.diff(bounds)
    whole = np.zeros((len(counts), int(counts.max(initial=0)), *rows.shape[1:]))
    whole[np.arange(whole.shape[1]) < counts[:, None]] = rows
    return whole.reshape(len(counts), -1, rows.shape[-1])


def without_own(shared: np.ndarray, own: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """(V, 2M, m) columns (N, 2, m), `padded`, projected onto the complement of each view's own columns (N, 2, k).

    By orthogonal projection: a Schur complement of normal equations loses half the digits.
    """
    basis, flat = np.linalg.qr(padded(own, bounds))[0], padded(shared, bounds)
    return np.asarray(flat - basis @ (basis.mT @ flat))


Loss = tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]
"""A robust loss: residuals (R,) to their losses, and to the weights on their squares."""
HUBER: Loss = huber_losses, huber_weights
SOFT_L1: Loss = soft_l1_losses, soft_l1_weights
SQUARES: Loss = lambda residuals: 0.5 * residuals**2, np.ones_like


class ScoreTest(NamedTuple):
    """First-order estimate of K extra parameters of a linearised problem: values (K,), covariance (K, K), and the
    logarithm of the Bayes factor for them against none."""

    values: np.ndarray
    covariance: np.ndarray
    log_evidence: float
    scale: float | np.ndarray = 1.0  # (K,) units that make the parameters comparable, for separating directions
    freedom: int = 0  # number of directions that the data determine, where it is not K

    @property
    def std(self) -> np.ndarray:
        """(K,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def chi_square(self) -> float:
        """Twice the decrease of the cost: χ² with K degrees of freedom where all parameters are 0."""
        return chi_square(self.values, self.covariance)

    @property
    def distance_std(self) -> float:
        """Mahalanobis length of the values."""
        return float(np.sqrt(self.chi_square))

    def clear(self, least_std: float) -> np.ndarray:
        """(K,) the values without the directions in which they are below `least_std` standard deviations, in units
        of scale."""
        scale = np.broadcast_to(np.asarray(self.scale, float), self.values.shape)
        variances, axes = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        along = axes.T @ (self.values / scale)
        return np.asarray(axes @ np.where(along**2 > least_std**2 * variances, along, 0.0)) * scale


def score_test(information: np.ndarray, score: np.ndarray, prior_std: float | np.ndarray) -> ScoreTest | None:
    """Score-test estimate of K extra parameters about 0 with prior N(0, prior_std²).

    information : (K, K) about them, all other parameters eliminated; score : (K,) slope of the log likelihood by them.
    None where the data say nothing about one of them.
    """
    prior = np.broadcast_to(np.asarray(prior_std, float), score.shape)
    size = np.sqrt(np.diag(information))
    if not (np.isfinite(size).all() and (size > 0.0).all()):
        return None
    # in units of the prior's standard deviations
    unit, pull = information * np.outer(prior, prior), score * prior
    covariance = np.linalg.inv(unit + np.eye(len(unit)))
    step = covariance @ pull
    gained = 0.5 * float(pull @ step) - 0.5 * float(np.linalg.slogdet(unit + np.eye(len(unit)))[1])
    return ScoreTest(step * prior, covariance * np.outer(prior, prior), gained)


def products(jacobian: np.ndarray, residuals: np.ndarray, nuisance: np.ndarray | None = None) -> np.ndarray:
    """(P + 1, P + 1) products of whitened derivatives (N, P) and residuals (N,), observed less predicted; those of
    two sets of data add up. nuisance : (N, K) derivatives by unknowns of these data alone, each with prior 0 ± 1,
    which are marginalised."""
    both = np.column_stack([jacobian, residuals])
    whole = both.T @ both
    if nuisance is None or not nuisance.any():
        return np.asarray(whole)
    mixed = nuisance.T @ both
    return np.asarray(whole - mixed.T @ np.linalg.solve(np.eye(nuisance.shape[1]) + nuisance.T @ nuisance, mixed))


def change_test(
    data: np.ndarray, covariance: np.ndarray, wanted: np.ndarray, scale: np.ndarray, free: Sequence[int] = ()
) -> ScoreTest:
    """Score test of a change of the parameters `wanted` (Q,) since they were estimated with covariance (P, P).

    data : their `products`; they are linear in e + δ, e the errors of that estimate and δ the change. With A
    their information, s their score and W = A (I + Σ A)⁻¹, which needs no inverse of either, δ has the information W
    and the score (I + A Σ)⁻¹ s. scale : (P,) noticeable changes; directions of less information than one in its units
    are left out. free : parameters without a constraint.
    """
    # in units of the scale, so that metres and radians weigh alike
    matrix, score = data[:-1, :-1] * np.outer(scale, scale), data[:-1, -1] * scale
    prior = covariance / np.outer(scale, scale)
    # standard deviation of a free parameter, in units of its scale
    prior[list(free), list(free)] += 100.0**2
    spread = np.eye(len(covariance)) + matrix @ prior
    weight, score = np.linalg.solve(spread, matrix), np.linalg.solve(spread, score)
    values, axes = np.linalg.eigh(weight[np.ix_(wanted, wanted)])
    # standard deviation of a direction without information, in units of its scale
    seen, std = values > 1.0, 1.0 / np.sqrt(np.maximum(values, 10.0**-2))
    along, units = np.where(seen, (axes.T @ score[wanted]) * std**2, 0.0), scale[wanted]
    found = (axes * std**2) @ axes.T * np.outer(units, units)
    return ScoreTest((axes @ along) * units, found, 0.5 * float(((along / std) ** 2).sum()), units, int(seen.sum()))


@dataclass(frozen=True, eq=False)
class Linearised:
    """A dense least-squares problem linearised at its parameters: residuals of the data, then of the priors.

    parameters : (P,). residuals : (R,) in units of the loss. jacobian : (R, P) of them.
    certain : number of the priors' residuals, which come last; the robust loss does not apply to them.
    converged : whether the solver converged. loss : of what was measured.
    """

    parameters: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    certain: int
    converged: bool = False
    loss: Loss = HUBER

    @property
    def measured(self) -> int:
        """How many of the residuals, the first ones, are the data's."""
        return len(self.residuals) - self.certain

    @property
    def weights(self) -> np.ndarray:
        """(R,) factors on residuals and Jacobian that turn the robust cost into least squares."""
        _, weights = self.loss
        return np.concatenate([np.sqrt(weights(self.residuals[: self.measured])), np.ones(self.certain)])

    @property
    def prior_cost(self) -> float:
        """Half the squares of the priors' residuals."""
        prior = self.residuals[self.measured :]
        return 0.5 * float(prior @ prior)

    @property
    def cost(self) -> float:
        """The cost: the robust loss of the data residuals plus half the squares of the priors'."""
        losses, _ = self.loss
        return float(losses(self.residuals[: self.measured]).sum()) + self.prior_cost

    @property
    def is_finite(self) -> bool:
        return bool(np.isfinite(self.residuals).all() and np.isfinite(self.jacobian).all())

    def normal_equations(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Reweighted information and gradient, and the scale that was divided out of both, since units differ
        greatly."""
        weights = self.weights
        weighted = self.jacobian * weights[:, None]
        scale = np.linalg.norm(weighted, axis=0)
        scale[scale == 0.0] = 1.0
        weighted /= scale
        return weighted.T @ weighted, weighted.T @ (self.residuals * weights), scale

    def covariance_root(self) -> np.ndarray:
        """Square root R (P, P) of the covariance: R·Rᵀ."""
        weighted = self.jacobian * self.weights[:, None]
        scale = np.linalg.norm(weighted, axis=0)
        _, factor = np.linalg.qr(weighted / scale)
        return np.asarray(np.linalg.inv(factor) / scale[:, None])

    def covariance(self) -> np.ndarray:
        """(P, P) inverse of the information, by QR of the rows, so that no variance is negative."""
        root = self.covariance_root()
        return root @ root.T

    def score_test(self, columns: np.ndarray, prior_std: float | np.ndarray) -> ScoreTest | None:
        """Score-test estimate of extra parameters with Jacobian `columns` (R, K) and prior N(0, prior_std²).

        The problem's own parameters adapt. None where they explain the same: where hardly any of the columns'
        information is left.
        """
        weights = self.weights[:, None]
        own, jacobian = columns * weights, self.jacobian * weights
        size, scale = np.linalg.norm(own, axis=0), np.linalg.norm(jacobian, axis=0)
        if not (np.isfinite(size).all() and (size > 0.0).all()):
            return None
        basis, _ = np.linalg.qr(jacobian / np.where(scale > 0.0, scale, 1.0))
        left = own - basis @ (basis.T @ own)
        # the rest of the residuals alone: at a minimum of a robust cost their slope is zero, before it need not be
        residuals = self.residuals * self.weights
        if np.linalg.eigvalsh(left.T @ left / np.outer(size, size)).min() <= 1e-9:
            return None
        return score_test(left.T @ left, -left.T @ residuals, prior_std)

    def without(self, rows: np.ndarray) -> Linearised:
        """The problem without the rows that are True in `rows` (R,), at its minimum to first order."""
        left = ~rows
        certain = int(left[len(rows) - self.certain :].sum())
        rest = replace(self, residuals=self.residuals[left], jacobian=self.jacobian[left], certain=certain)
        step = rest.step(0.0)[0]
        return replace(rest, parameters=rest.parameters + step, residuals=rest.residuals + rest.jacobian @ step)

    def with_rows(self, jacobian: np.ndarray) -> Linearised:
        """The problem with further, perfectly fitting observations, for the covariance that they would give. jacobian :
        (N, P + E) by the parameters and by E further errors of prior 0 ± 1, in units of the standard deviations."""
        count = len(self.parameters)
        prior = np.eye(jacobian.shape[1])[count:]
        own = np.pad(self.jacobian * self.weights[:, None], ((0, 0), (0, len(prior))))
        rows = np.vstack([jacobian, prior, own])
        residuals = np.concatenate([np.zeros(len(rows) - len(own)), self.residuals * self.weights])
        parameters = np.append(self.parameters, np.zeros(len(prior)))
        return replace(self, parameters=parameters, jacobian=rows, residuals=residuals, certain=len(rows))

    def step(self, damping: float, at_end: bool | np.ndarray = False) -> tuple[np.ndarray, float]:
        """(P,) damped step, and the decrease that an undamped step predicts.

        at_end : (P,) which parameters are at their upper end; those that would go further stay.
        """
        information, slope, scale = self.normal_equations()

        def bounded(matrix: np.ndarray) -> np.ndarray:
            step = -np.linalg.solve(matrix, slope)
            free = ~(at_end & (step > 0.0))
            if not free.all():
                step = np.zeros(len(slope))
                step[free] = -np.linalg.solve(matrix[np.ix_(free, free)], slope[free])
            return step

        damped = bounded(information + damping * np.eye(len(slope)))
        # a damped step is short wherever it is taken
        whole = bounded(information) if damping else damped
        return damped / scale, -float(slope @ whole + 0.5 * whole @ information @ whole)


def minimise(
    evaluate: Callable[[np.ndarray], Linearised | None],
    start: Linearised,
    rules: Rules,
    upper: float | np.ndarray = np.inf,
) -> tuple[Linearised, float, bool]:
    """Minimises the robust cost of a dense problem by reweighted damped steps, with the results of
    `levenberg_marquardt`.

    evaluate : the problem at parameters (P,); None where it has no residuals there.
    upper : (P,) upper ends of the parameters.
    """

    def step(now: Linearised, damping: float) -> tuple[np.ndarray, float]:
        return now.step(damping, now.parameters >= upper)

    def moved(now: Linearised, move: np.ndarray) -> Linearised | None:
        return evaluate(np.minimum(now.parameters + move, upper))

    return levenberg_marquardt(start, step, moved, rules)
