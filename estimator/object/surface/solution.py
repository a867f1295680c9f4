"""Gaussian process regression of an object's patches: a linear trend and a Matérn 5/2 process (Rasmussen and
Williams, Eqs. 4.17 and 9.1) in one or two coordinates, observed by values and slopes; all patches in one linear
Gaussian solve with shared errors and one compliance (universal kriging).

y = K-shapes + modes · s + noise + compliance · force, s ~ N(0, 1), the compliance without a prior
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.linalg import LinAlgError

from estimator.object.surface.settings import SurfaceSettings
from vbaa_calib.core.arrays import Rows
from vbaa_calib.native import core

# before the data: logarithms of length and amplitude over the patch's extent, and of the tangents' slack in rad; the
# standard deviations of these logarithms; and their bounds
_BEST, _WIDTH = np.log([0.7, 0.2, 0.01]), np.array([1.2, 1.5, 1.5])
_LOWEST, _HIGHEST = np.log([0.03, 1e-4, 1e-4]), np.log([30.0, 100.0, 3.0])
_Improbability = Callable[[np.ndarray], tuple[float, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Functionals(Rows):
    """N linear functionals Σ value_c · h_c(x) + slope_c · ∇h_c(x) of C functions."""

    x: np.ndarray  # (N, D) m
    value: np.ndarray  # (N, C)
    slope: np.ndarray  # (N, C, D)

    @property
    def of_lines(self) -> np.ndarray:
        """(N, C·D) values of the functionals for lines through the origin."""
        return (self.value[:, :, None] * self.x[:, None, :] + self.slope).reshape(len(self), -1)


@dataclass(frozen=True)
class SmoothnessPrior:
    """Prior of a patch's shape, a Matérn process and a linear trend, and of its tangents' errors."""

    length_m: float  # of the process
    amplitude_m: float  # of the process
    offset_m: float  # standard deviation of the trend
    incline: float  # of its slope
    slack_rad: float = 0.0  # standard deviation of the observed tangents beyond what is known

    @property
    def steepness(self) -> float:
        """Prior variance of a slope, without the trend."""
        return 5.0 * self.amplitude_m**2 / (3.0 * self.length_m**2)


def values_at(x: np.ndarray, value: np.ndarray) -> Functionals:
    """Functionals of values only, with weights (N, C) at places (N, D); value : (C,) for all places."""
    value = np.ascontiguousarray(np.broadcast_to(value, (len(x), np.shape(value)[-1])))
    return Functionals(np.ascontiguousarray(x), value, np.zeros((*value.shape, x.shape[1])))


def covariance(a: Functionals, b: Functionals, prior: SmoothnessPrior) -> np.ndarray:
    """(N, M) prior covariance of functionals."""
    return np.asarray(core.surface.covariance(a, b, prior, False)[0])


def variance(rows: Functionals, prior: SmoothnessPrior, others: Functionals | None = None) -> np.ndarray:
    """(N,) prior variance of each functional, or its covariance with another one at the same place: a diagonal of
    `covariance(rows, others, prior)`."""
    others = rows if others is None else others
    result = (rows.value * others.value).sum(axis=1) * (prior.amplitude_m**2 + prior.offset_m**2)
    result = result + prior.steepness * (rows.slope * others.slope).sum(axis=(1, 2))
    return np.asarray(result + prior.incline**2 * (rows.of_lines * others.of_lines).sum(axis=1))


@dataclass(frozen=True, eq=False)
class ShapeEquations(Rows):
    """M linear equations: the first N, or twice N for a curve, are those of points, the others of tangents."""

    rows: Functionals  # what they see of the shape
    y: np.ndarray  # (M,) measured
    noise: np.ndarray  # (M, M) covariance of the touches' own errors
    modes: np.ndarray  # (M, S) effect of the common ones
    force_N: np.ndarray  # (M,) of the compliance
    slack: np.ndarray  # (M,) of 1 rad of the tangent

    def own(self, prior: SmoothnessPrior) -> np.ndarray:
        """(M, M) covariance of the equations without the shared errors."""
        own = covariance(self.rows, self.rows, prior)
        own += self.noise
        np.einsum("mm->m", own)[:] += (prior.slack_rad * self.slack) ** 2
        return own


@dataclass(frozen=True, eq=False)
class ShapeSolution:
    """Joint posterior of all patches."""

    equations: tuple[ShapeEquations, ...]  # of each patch
    priors: tuple[SmoothnessPrior, ...]  # of each patch
    start: np.ndarray  # (patches,) where their equations begin
    root: np.ndarray  # (M, M) inverse of the Cholesky factor of the covariance of y, which it whitens
    weights: np.ndarray  # (M,) covariance⁻¹ (y − compliance · force)
    lift: np.ndarray  # (M,) covariance⁻¹ force
    compliance_m_N: float  # beyond what was taken into the points; zero for a rigid object
    variance: float  # of the compliance

    def seen_by(self, patch: int, rows: Functionals) -> np.ndarray:
        """(Q, M) prior covariance of a patch's functionals with all equations."""
        result = np.zeros((len(rows), len(self.weights)))
        result[:, self._of(patch)] = self._own_seen_by(patch, rows)
        return result

    def _own_seen_by(self, patch: int, rows: Functionals) -> np.ndarray:
        return covariance(rows, self.equations[patch].rows, self.priors[patch])

    def whitened(self, patch: int, rows: Functionals) -> tuple[np.ndarray, np.ndarray]:
        """(Q, P) prior covariance of a patch's functionals with its own P equations, and (M, Q) with all equations as
        `root` whitens them."""
        seen, own = self._own_seen_by(patch, rows), self._of(patch)
        whitened = np.empty((len(self.root), len(rows)))
        # by quarters, which leave out most of the triangle's zeros
        for begin, end in pairwise(np.linspace(0, len(self.root), 5).astype(int).tolist()):
            last = max(min(end, own.stop), own.start)
            whitened[begin:end] = self.root[begin:end, own.start : last] @ seen[:, : last - own.start].T
        return seen, whitened

    def _of(self, patch: int) -> slice:
        return slice(self.start[patch], self.start[patch] + len(self.equations[patch]))

    def mean(self, patch: int, rows: Functionals) -> np.ndarray:
        """(Q,) posterior means of functionals of a patch's undeformed shape."""
        return self._own_seen_by(patch, rows) @ self.weights[self._of(patch)]

    def spread(self, patch: int, rows: Functionals) -> np.ndarray:
        """(Q,) posterior standard deviations of functionals of a patch's undeformed shape."""
        seen, half = self.whitened(patch, rows)
        posterior = variance(rows, self.priors[patch]) - np.sum(half**2, axis=0)
        posterior += (seen @ self.lift[self._of(patch)]) ** 2 * self.variance
        return np.sqrt(np.maximum(posterior, 0.0))

    def joint(self, views: list[tuple[int, Functionals]]) -> np.ndarray:
        """(Q, Q) posterior covariance of functionals of several patches, concatenated."""
        seen, half = zip(*(self.whitened(patch, rows) for patch, rows in views), strict=True)
        prior = _block_diagonal([covariance(rows, rows, self.priors[patch]) for patch, rows in views])
        whole = np.concatenate(half, axis=1)
        lifted = np.concatenate([own @ self.lift[self._of(patch)] for own, (patch, _) in zip(seen, views, strict=True)])
        return prior - whole.T @ whole + self.variance * np.outer(lifted, lifted)

    def in_place(self, patch: int, rows: Functionals) -> tuple[np.ndarray, np.ndarray]:
        """(2N,) posterior means of functionals of a patch; (N, 2, 2) covariances of the first N with the last N, at the
        same places."""
        (seen, half), count, prior = self.whitened(patch, rows), len(rows) // 2, self.priors[patch]
        lifted, sides = seen @ self.lift[self._of(patch)], [slice(0, count), slice(count, None)]
        found = np.empty((count, 2, 2))
        for a, b in ((0, 0), (0, 1), (1, 1)):
            of, to = sides[a], sides[b]
            posterior = variance(rows.picked(of), prior, rows.picked(to)) - np.einsum(
                "mn,mn->n", half[:, of], half[:, to]
            )
            found[:, a, b] = found[:, b, a] = posterior + self.variance * lifted[of] * lifted[to]
        return seen @ self.weights[self._of(patch)], found

    @property
    def leave_one_out_residuals(self) -> np.ndarray:
        """(M,) each equation less its prediction by all others, in standard deviations (Rasmussen and Williams, Eq.
        5.12)."""
        return self.weights / np.sqrt(np.einsum("mn,mn->n", self.root, self.root))


def _block_diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    """(N, N) matrix of square blocks along its diagonal."""
    end = np.cumsum([len(block) for block in blocks])
    whole = np.zeros((end[-1], end[-1]))
    for block, to in zip(blocks, end, strict=True):
        whole[to - len(block) : to, to - len(block) : to] = block
    return whole


def _inverse_of_lower(lower: np.ndarray) -> np.ndarray:
    """(N, N) inverse of a lower triangle, by halves. SciPy's, which a report would load for it alone, takes longer to
    load than hundreds of contacts to solve."""
    half = len(lower) // 2
    if half < 24:
        return np.tril(np.linalg.inv(lower))
    first, last = _inverse_of_lower(lower[:half, :half]), _inverse_of_lower(lower[half:, half:])
    return np.block([[first, np.zeros((half, len(last)))], [-last @ (lower[half:, :half] @ first), last]])


def _factor(matrix: np.ndarray) -> np.ndarray:
    """Lower Cholesky factor, with the least diagonal addition that rounding makes necessary."""
    for jitter in (0.0, 1e-12, 1e-10, 1e-8):
        try:
            whole = matrix + jitter * np.diag(np.diag(matrix)) if jitter else matrix
            return np.linalg.cholesky(whole)
        except LinAlgError:
            continue
    raise LinAlgError("the covariance of the touches is not positive definite")


def solve(every: tuple[ShapeEquations, ...], priors: tuple[SmoothnessPrior, ...], yielding: bool) -> ShapeSolution:
    """Solve all patches jointly, from the equations and the prior of each. yielding : whether with a compliance;
    otherwise the object is rigid."""
    modes = np.concatenate([each.modes for each in every])
    y, force = np.concatenate([each.y for each in every]), np.concatenate([each.force_N for each in every])
    own = _block_diagonal([each.own(prior) for each, prior in zip(every, priors, strict=True)])
    root = _inverse_of_lower(_factor(own + modes @ modes.T))
    weights, lift = root.T @ (root @ y), root.T @ (root @ force)
    compliance = spread = 0.0
    information = float(force @ lift)
    if yielding and information > 0.0:
        spread = 1.0 / information
        compliance = spread * float(lift @ y)
        weights = weights - compliance * lift
    start = np.cumsum([0, *map(len, every[:-1])])
    return ShapeSolution(every, priors, start, root, weights, lift, compliance, spread)


def learn_prior(
    equations: ShapeEquations, extent_m: float, start: SmoothnessPrior | None, yield_per_N: float, roughly: bool
) -> SmoothnessPrior:
    """The most probable prior of a patch. start : an earlier one. extent_m : the patch's. yield_per_N : the largest
    compliance, m/N, zero for none. roughly : stop at the search by a few of the equations, which otherwise only finds
    where the search by all of them begins.
    """
    extent_m = max(extent_m, 1e-3)
    count = min(len(equations), SurfaceSettings.most_equations)
    # at random: evenly spaced ones of strokes that repeat would all lie at the same places
    chosen = np.sort(np.random.default_rng(0).choice(len(equations), count, replace=False))
    free = 3 if equations.slack[chosen].any() else 2

    def prior_of(logs: np.ndarray) -> SmoothnessPrior:
        length, amplitude, turn = np.exp(np.clip(np.concatenate([logs, _BEST[len(logs) :]]), _LOWEST, _HIGHEST))
        lengths_m = length * extent_m, amplitude * extent_m, 10 * extent_m
        return SmoothnessPrior(*lengths_m, SurfaceSettings.incline, float(turn))

    def improbability_by(thin: np.ndarray) -> _Improbability:
        """The negative log posterior by some of the equations, and its gradient (Rasmussen and Williams, Eqs. 2.43 and
        5.9), as a function of the logarithms.

        The trend's variance is so large that in one sum with the rest it would take half of the digits.
        """
        rows, y, slack = equations.rows.picked(thin), equations.y[thin], equations.slack[thin]
        modes = np.column_stack([equations.modes[thin], yield_per_N * equations.force_N[thin]])
        fixed = equations.noise[np.ix_(thin, thin)] + modes @ modes.T

        def improbability(logs: np.ndarray) -> tuple[float, np.ndarray]:
            prior = prior_of(logs)
            shape, by_log_length = core.surface.covariance(rows, rows, replace(prior, offset_m=0.0, incline=0.0), True)
            doubt = (prior.slack_rad * slack) ** 2
            whole = shape + fixed
            np.einsum("mm->m", whole)[:] += doubt
            try:
                lower = _factor(whole)
            except LinAlgError:
                # a search that meets a wall stops there: somewhat rougher numbers lead on
                lower = np.linalg.cholesky(whole + SurfaceSettings.rougher * np.diag(np.diag(whole)))
            # the columns H in the middle have the trend's covariance H·Hᵀ
            trend = np.column_stack([prior.offset_m * rows.value, prior.incline * rows.of_lines])
            root = _inverse_of_lower(lower)
            lines, seen, inverse = root @ trend, root @ y, root.T @ root
            within = np.eye(lines.shape[1]) + lines.T @ lines
            inner, course = np.linalg.cholesky(within), np.linalg.solve(within, lines.T @ seen)
            rest = seen - lines @ course
            weights = root.T @ rest
            unlikely = 0.5 * float(rest @ rest + course @ course)
            unlikely += float(np.log(np.diag(lower)).sum() + np.log(np.diag(inner)).sum())
            along = np.linalg.solve(inner, trend.T @ inverse)
            taken = np.vstack([along, weights])
            sensitivity = inverse - taken.T @ taken
            slopes = np.array(
                [
                    np.vdot(sensitivity, by_log_length),
                    2.0 * np.vdot(sensitivity, shape),
                    2.0 * np.diag(sensitivity) @ doubt,
                ]
            )
            away = (logs - _BEST[:free]) / _WIDTH[:free]
            return unlikely + 0.5 * float(away @ away), 0.5 * slopes[:free] + away / _WIDTH[:free]

        return improbability

    first = _BEST[:free]
    if start is not None:
        first = np.log([start.length_m / extent_m, start.amplitude_m / extent_m, start.slack_rad])[:free]
    first, bend = np.clip(first, _LOWEST[:free], _HIGHEST[:free]), None
    if count >= SurfaceSettings.fewest_thinned:
        first, bend = _lowest(improbability_by(chosen[:: SurfaceSettings.thinned]), first)
        bend = SurfaceSettings.thinned * bend
        if roughly:
            return prior_of(first)
    return prior_of(_lowest(improbability_by(chosen), first, bend)[0])


def _lowest(
    improbability: _Improbability, logs: np.ndarray, bend: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms within bounds that minimise the objective, by BFGS's method from nearby ones and the second
    derivatives there (by differences unless these come along), and the second derivatives at the end. Where rounding
    hides the objective's decrease the gradient alone decides."""
    low, high = _LOWEST[: len(logs)], _HIGHEST[: len(logs)]
    value, slope = improbability(logs)
    if bend is None:
        moves = SurfaceSettings.difference_step * np.eye(len(logs))
        bend = np.array([improbability(logs + move)[1] - slope for move in moves]) / SurfaceSettings.difference_step
    values, axes = np.linalg.eigh(0.5 * (bend + bend.T))
    bend = (axes * np.maximum(np.abs(values), SurfaceSettings.least_bend)) @ axes.T
    longest = SurfaceSettings.longest_step
    for _ in range(SurfaceSettings.search_steps):
        free = ((logs > low) | (slope < 0.0)) & ((logs < high) | (slope > 0.0))
        step = np.zeros(len(logs))
        step[free] = -np.linalg.solve(bend[np.ix_(free, free)], slope[free])
        step *= min(1.0, longest / max(np.abs(step).max(), 1e-300))
        moved = np.clip(logs + step, low, high) - logs
        size = float(np.abs(moved).max())
        there, slope_there = improbability(logs + moved)
        turned = slope_there - slope
        if (curvature := float(moved @ turned)) > 0.0:
            along = bend @ moved
            bend = bend + np.outer(turned, turned) / curvature - np.outer(along, along) / float(moved @ along)
        if there <= value + SurfaceSettings.lost_digits * abs(value):
            logs, value, slope = logs + moved, there, slope_there
            longest = min(max(longest, 2.0 * size), SurfaceSettings.longest_step)
        else:
            longest = 0.3 * size
        if size < SurfaceSettings.search_ends:
            break
    return logs, bend
