"""Least squares of a sweep in pixels, where the joint angles of each picture may be a little off.

Angles that are a milliradian off shift all corners of their picture alike. Such shifts do not average out over the
corners, so they are part of the model: two unknown angles a picture, normally distributed with one variance that the
residuals themselves show (restricted maximum likelihood), eliminated picture by picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from vbaa_calib.camera import Camera
from vbaa_calib.core.least_squares import Rules, levenberg_marquardt, schur_complement, solve_scaled, view_products
from vbaa_calib.core.robust import radial_std, soft_l1_weights

from .sweep_model import STATE, Linearised, SweepCorners, SweepState, linearise

_AXES_FIXED = np.arange(STATE) < 12
_SOFT_PER_SIGMA = 1.5
_REWEIGHTINGS, _CONVERGED_WEIGHTS = 15, 1e-2
_RULES = Rules(100, tolerance=1e-14, damping=1e-4)
_FEW_STEPS = replace(_RULES, iterations=3)
_ROUNDING_PX = 1e-7
_RATIO_POWERS = (-2.0, 12.0)
_RATIO_ROUNDS, _SAME_RATIO = 6, 1e-4
_CORNER_ROUNDS = 6
_CHANCE_SIGMAS = 6.4  # one good corner in 1e9 lies further off
_LEAST_PX = 0.25


@dataclass(frozen=True, eq=False)
class SweepFit:
    """A minimum and its uncertainty.

    angle_ratio : (rad/px)² variance of the joint angles over that of a corner's coordinate.
    variance_px2 : of a corner's coordinate. residuals_px : (N, 2) once the pictures' angles are corrected.
    covariance : (14, 14) of the state's step, zero where it was fixed. by_lens : (14, 4 + k) derivative of the step.
    """

    state: SweepState
    angle_ratio: float
    variance_px2: float
    residuals_px: np.ndarray
    covariance: np.ndarray
    by_lens: np.ndarray

    @property
    def angle_std_rad(self) -> float:
        """Scatter of the joint angles' readings about what the pictures show."""
        return float(np.sqrt(self.angle_ratio * self.variance_px2))


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations A·step = b with the angles eliminated; `cost` is the sum of squares at no step."""

    state: SweepState
    at: Linearised
    blocks: np.ndarray
    A: np.ndarray
    b: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class SweepProblem:
    """The corners of a sweep, seen by a camera; `free` (14,) are the columns of a step that are solved for."""

    camera: Camera
    corners: SweepCorners
    free: np.ndarray

    @staticmethod
    def of(camera: Camera, corners: SweepCorners, axes: bool = True) -> SweepProblem:
        """With the axes' skew and offset free, or fixed where they are."""
        return SweepProblem(camera, corners, np.ones(STATE, bool) if axes else _AXES_FIXED)

    def _blocks(self, at: Linearised, weights: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(P, m, m) products of columns (N, 2, ...), then the residual, then the picture's own angles."""
        whole = np.concatenate([columns, at.residuals_px[..., None], at.by_angles], axis=-1)
        bounds = np.searchsorted(self.corners.picture, np.arange(self.corners.pictures + 1))
        return view_products(whole * np.sqrt(weights)[:, None, None], bounds)

    def _descended(self, state: SweepState, weights: np.ndarray, angle_ratio: float, rules: Rules) -> _System:
        def linearised(state: SweepState) -> _System:
            at = linearise(self.camera, state, self.corners)
            blocks = self._blocks(at, weights, at.by_state[..., self.free])
            whole = _without_angles(blocks, angle_ratio)
            return _System(state, at, blocks, whole[:-1, :-1], whole[:-1, -1], float(whole[-1, -1]))

        def step(system: _System, damping: float) -> tuple[np.ndarray, float]:
            move = solve_scaled(system.A, system.b, damping)
            return move, float(system.b @ move)

        def moved(system: _System, move: np.ndarray) -> _System:
            whole = np.zeros(STATE)
            whole[self.free] = move
            return linearised(system.state.moved(whole))

        return levenberg_marquardt(linearised(state), step, moved, rules).at

    def robust(self, state: SweepState, used: np.ndarray) -> tuple[SweepState, np.ndarray]:
        """A state that gross errors among the corners used (N,) pull little, and all residuals (N, 2) px.

        Distances count, not their squares. A redescending loss would fit some pictures all but exactly and give up
        others, where it is the angles that scatter.
        """
        weights = used.astype(float)
        residuals = linearise(self.camera, state, self.corners).residuals_px
        for _ in range(_REWEIGHTINGS):
            distance = np.linalg.norm(residuals, axis=1)
            scale = _SOFT_PER_SIGMA * max(radial_std(distance[used]), 1e-9)
            before, weights = weights, used * soft_l1_weights(distance, scale)
            system = self._descended(state, weights, 0.0, _FEW_STEPS)
            state, residuals = system.state, system.at.residuals_px
            if np.abs(weights - before).max() < _CONVERGED_WEIGHTS:
                break
        return state, residuals

    def fit(self, state: SweepState, used: np.ndarray) -> SweepFit:
        """The minimum over the corners used (N,) bool, with the scatter of the joint angles that the residuals show."""
        weights, ratio = used.astype(float), 0.0
        for _ in range(_RATIO_ROUNDS):
            system = self._descended(state, weights, ratio, _RULES)
            state, before = system.state, ratio
            ratio = _angle_variance_ratio(system.blocks, 2 * int(used.sum()))
            if abs(ratio - before) <= _SAME_RATIO * before:
                break
        system = self._descended(state, weights, ratio, _RULES)
        return self._with_covariance(system, weights, ratio)

    def inlying(self, state: SweepState, candidates: np.ndarray) -> tuple[SweepFit, np.ndarray]:
        """The fit to the candidates (N,) but for wrong ones, judged by the spread of the others; and who is in it."""
        used = candidates
        for _ in range(_CORNER_ROUNDS):
            found = self.fit(state, used)
            distance = np.linalg.norm(found.residuals_px, axis=1)
            limit = max(_CHANCE_SIGMAS * radial_std(distance[used]), _LEAST_PX)
            state, before, used = found.state, used, candidates & (distance <= limit)
            if np.array_equal(used, before):
                break
        return found, before

    def _with_covariance(self, system: _System, weights: np.ndarray, ratio: float) -> SweepFit:
        at, free = system.at, self.free
        count, lens = int(free.sum()), at.by_lens.shape[-1]
        blocks = self._blocks(at, weights, np.concatenate([at.by_state[..., free], at.by_lens], axis=-1))
        whole = _without_angles(blocks, ratio)
        A, coupling, cost = whole[:count, :count], whole[:count, count:-1], float(whole[-1, -1])
        variance = max(cost / max(2 * weights.sum() - count, 1.0), _ROUNDING_PX**2)
        covariance, by_lens = np.zeros((STATE, STATE)), np.zeros((STATE, lens))
        covariance[np.ix_(free, free)] = variance * solve_scaled(A, np.eye(count))
        by_lens[free] = -solve_scaled(A, coupling)
        residuals = at.residuals_px
        if ratio > 0.0:
            shift = np.linalg.solve(blocks[:, -2:, -2:] + np.eye(2) / ratio, blocks[:, -2:, -3, None])[..., 0]
            residuals = residuals - np.einsum("nij,nj->ni", at.by_angles, shift[self.corners.picture])
        return SweepFit(system.state, ratio, variance, residuals, covariance, by_lens)


def _without_angles(blocks: np.ndarray, angle_ratio: float) -> np.ndarray:
    """(m − 2, m − 2) sum of blocks (P, m, m) with the last two columns, the angles, marginalised."""
    total = blocks[:, :-2, :-2].sum(axis=0)
    if angle_ratio == 0.0:
        return total
    return schur_complement(total, blocks[:, -2:, :-2], blocks[:, -2:, -2:] + np.eye(2) / angle_ratio)[0]


def _angle_variance_ratio(blocks: np.ndarray, rows: int) -> float:
    """Variance of the joint angles over that of a corner's coordinate, (rad/px)², by restricted likelihood.

    blocks : (P, m, m) columns: free steps, residual, angles. rows : how many residuals there are.
    """
    freedom = rows - (blocks.shape[-1] - 3)
    angles = blocks[:, -2:, -2:]
    per_angle = float(np.mean(np.trace(angles, axis1=1, axis2=2))) / 2

    def badness(power: float) -> float:
        ratio = 10**power / per_angle
        whole = _without_angles(blocks, ratio)
        A, b = whole[:-1, :-1], whole[:-1, -1]
        left = max(float(whole[-1, -1]) - float(b @ solve_scaled(A, b)), 1e-30)
        shrink = float(np.linalg.slogdet(np.eye(2) + ratio * angles)[1].sum())
        return shrink + _log_determinant(A) + freedom * np.log(left)

    # there may be several minima: a flat stretch, where the angles count as exact, may come before the right one
    powers = np.arange(*_RATIO_POWERS)
    best = powers[np.argmin([badness(power) for power in powers])]
    found = minimize_scalar(badness, bounds=(best - 1.0, best + 1.0), method="bounded", options={"xatol": 1e-5})
    return float(10**found.x / per_angle) if found.fun < badness(-np.inf) else 0.0


def _log_determinant(matrix: np.ndarray) -> float:
    """Of a positive matrix that may be singular to working precision."""
    diagonal = np.maximum(np.diag(matrix), 1e-30)
    values = np.linalg.eigvalsh(matrix / np.sqrt(np.outer(diagonal, diagonal)))
    return float(np.log(diagonal).sum() + np.log(np.maximum(values, 1e-15)).sum())
