"""Least squares of a sweep in pixels, where the joint angles of each picture may be a little off.

Angles that are a milliradian off shift all corners of their picture alike. Such shifts do not average out over the
corners, so they are part of the model: two unknown angles a picture, normally distributed with one variance that the
residuals themselves tell (restricted maximum likelihood), eliminated picture by picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize_scalar

from vbaa_calib.camera import Camera
from vbaa_calib.core.robust import radial_std, soft_l1_weights

from .sweep_model import STATE, Linearised, SweepCorners, SweepState, linearise

ALL_FREE = np.ones(STATE, bool)
AXES_HELD = np.arange(STATE) < 12
"""Which of a step's columns are solved for."""

_SOFT_PER_SIGMA = 1.5
_REWEIGHTINGS = 15
_STEPS_PER_WEIGHTING = 3
_SETTLED = 1e-2
_STEPS = 100
_RELATIVE_DECREASE = 1e-14
_ROUNDING_PX = 1e-7
_HOPELESS = 1e8
_RATIO_POWERS = (-2.0, 12.0)
_RATIO_ROUNDS, _SAME_RATIO = 6, 1e-4
_CORNER_ROUNDS = 6
_CHANCE_SIGMAS = 6.4  # one good corner in 1e9 lies further off
_LEAST_PX = 0.25


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations A·step = b, angles eliminated; `cost` is the sum of squares that they leave at no step."""

    A: np.ndarray
    b: np.ndarray
    cost: float
    log_determinant: float


@dataclass(frozen=True, eq=False)
class SweepFit:
    """A minimum, and what it is worth.

    Attributes
    ----------
    angle_ratio : (rad/px)² variance of the joint angles over that of a corner's coordinate.
    variance_px2 : of a corner's coordinate. residuals_px : (N, 2) once the pictures' angles are put right.
    covariance : (14, 14) of the state's step, zero where it was held. by_lens : (14, 4 + k) derivative of the step.
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


def _picture_blocks(rows: np.ndarray, corners: SweepCorners) -> np.ndarray:
    """(P, m, m) sums of products of rows (N, 2, m), picture by picture."""
    bounds = np.searchsorted(corners.picture, np.arange(corners.pictures + 1))
    flat = [rows[first:last].reshape(-1, rows.shape[-1]) for first, last in pairwise(bounds)]
    return np.array([block.T @ block for block in flat])


def _eliminated(blocks: np.ndarray, angle_ratio: float) -> tuple[np.ndarray, float]:
    """Sum of blocks (P, m, m) with the last two columns, the angles, marginalised: (m − 2, m − 2), and its log det."""
    total = blocks[:, :-2, :-2].sum(axis=0)
    if angle_ratio == 0.0:
        return total, 0.0
    own, cross = blocks[:, -2:, -2:], blocks[:, -2:, :-2]
    through = np.linalg.solve(own + np.eye(2) / angle_ratio, cross)
    shrink = np.linalg.slogdet(np.eye(2) + angle_ratio * own)[1].sum()
    return total - np.einsum("pai,paj->ij", cross, through), float(shrink)


def _normal_equations(blocks: np.ndarray, angle_ratio: float) -> Normal:
    """From blocks (P, m, m) of columns: free steps, residual, angles."""
    whole, shrink = _eliminated(blocks, angle_ratio)
    return Normal(whole[:-1, :-1], whole[:-1, -1], float(whole[-1, -1]), shrink)


def _blocks(moved: Linearised, corners: SweepCorners, weights: np.ndarray, free: np.ndarray) -> np.ndarray:
    rows = np.concatenate([moved.by_state[..., free], moved.residuals_px[..., None], moved.by_angles], axis=-1)
    return _picture_blocks(rows * np.sqrt(weights)[:, None, None], corners)


def _solved(A: np.ndarray, b: np.ndarray, damping: float = 0.0) -> np.ndarray:
    # metres and radians: columns of one length first
    scale = np.diag(1.0 / np.sqrt(np.maximum(np.diag(A), 1e-30)))
    return scale @ np.linalg.lstsq(scale @ A @ scale + damping * np.eye(len(A)), scale @ b, rcond=1e-15)[0]


def descend(
    camera: Camera,
    state: SweepState,
    corners: SweepCorners,
    weights: np.ndarray,
    free: np.ndarray,
    angle_ratio: float = 0.0,
    steps: int = _STEPS,
) -> tuple[SweepState, Linearised]:
    """Levenberg–Marquardt from a start, corners weighed by weights (N,)."""
    moved = linearise(camera, state, corners)
    system = _normal_equations(_blocks(moved, corners, weights, free), angle_ratio)
    damping = 1e-4
    for _ in range(steps):
        step = np.zeros(STATE)
        step[free] = _solved(system.A, system.b, damping)
        if float(system.b @ step[free]) <= _RELATIVE_DECREASE * system.cost and damping < 1.0:
            break
        new_state = state.moved(step)
        trial = linearise(camera, new_state, corners)
        new = _normal_equations(_blocks(trial, corners, weights, free), angle_ratio)
        if np.isfinite(new.cost) and new.cost <= system.cost:
            state, moved, system = new_state, trial, new
            damping = max(0.1 * damping, 1e-15)
        else:
            damping = max(10.0 * damping, 1e-9)
            if damping > _HOPELESS:
                break
    return state, moved


def robust(
    camera: Camera, state: SweepState, corners: SweepCorners, used: np.ndarray, free: np.ndarray
) -> tuple[SweepState, np.ndarray]:
    """A state that gross ones among the corners used (N,) pull little, and all residuals (N, 2) px.

    Distances count, not their squares. A rule that forgets large ones would fit some pictures all but exactly and give
    up others, where it is the angles that scatter.
    """
    weights = used.astype(float)
    moved = linearise(camera, state, corners)
    for _ in range(_REWEIGHTINGS):
        distance = np.linalg.norm(moved.residuals_px, axis=1)
        scale = _SOFT_PER_SIGMA * max(radial_std(distance[used]), 1e-9)
        before, weights = weights, used * soft_l1_weights(distance, scale)
        state, moved = descend(camera, state, corners, weights, free, steps=_STEPS_PER_WEIGHTING)
        if np.abs(weights - before).max() < _SETTLED:
            break
    return state, moved.residuals_px


def fit(camera: Camera, state: SweepState, corners: SweepCorners, used: np.ndarray, free: np.ndarray) -> SweepFit:
    """The minimum over the corners used (N,) bool, with the scatter of the joint angles that the residuals show."""
    weights, ratio = used.astype(float), 0.0
    for _ in range(_RATIO_ROUNDS):
        state, moved = descend(camera, state, corners, weights, free, ratio)
        before, ratio = ratio, _angle_variance_ratio(_blocks(moved, corners, weights, free), 2 * int(used.sum()))
        if abs(ratio - before) <= _SAME_RATIO * before:
            break
    state, moved = descend(camera, state, corners, weights, free, ratio)
    return _worth(moved, state, corners, weights, free, ratio)


def _angle_variance_ratio(blocks: np.ndarray, rows: int) -> float:
    """Variance of the joint angles over that of a corner's coordinate, (rad/px)², by restricted likelihood.

    Parameters
    ----------
    blocks : (P, m, m) columns: free steps, residual, angles. rows : how many residuals there are.
    """
    freedom = rows - (blocks.shape[-1] - 3)
    sight = float(np.mean(np.trace(blocks[:, -2:, -2:], axis1=1, axis2=2))) / 2

    def badness(power: float) -> float:
        system = _normal_equations(blocks, 10**power / sight)
        left = max(system.cost - float(system.b @ _solved(system.A, system.b)), 1e-30)
        return system.log_determinant + _log_determinant(system.A) + freedom * np.log(left)

    # not one valley only: a flat stretch, where the angles count as exact, may come before it
    powers = np.arange(*_RATIO_POWERS)
    best = powers[np.argmin([badness(power) for power in powers])]
    found = minimize_scalar(badness, bounds=(best - 1.0, best + 1.0), method="bounded", options={"xatol": 1e-5})
    return float(10**found.x / sight) if found.fun < badness(-np.inf) else 0.0


def _log_determinant(matrix: np.ndarray) -> float:
    """Of a positive matrix that may be singular to working precision."""
    diagonal = np.maximum(np.diag(matrix), 1e-30)
    values = np.linalg.eigvalsh(matrix / np.sqrt(np.outer(diagonal, diagonal)))
    return float(np.log(diagonal).sum() + np.log(np.maximum(values, 1e-15)).sum())


def inlying(
    camera: Camera, state: SweepState, corners: SweepCorners, candidates: np.ndarray, free: np.ndarray
) -> tuple[SweepFit, np.ndarray]:
    """The fit to the candidates (N,) but for wrong ones, judged by the spread of the others; and who is in it."""
    used = candidates
    for _ in range(_CORNER_ROUNDS):
        found = fit(camera, state, corners, used, free)
        distance = np.linalg.norm(found.residuals_px, axis=1)
        limit = max(_CHANCE_SIGMAS * radial_std(distance[used]), _LEAST_PX)
        state, before, used = found.state, used, candidates & (distance <= limit)
        if np.array_equal(used, before):
            break
    return found, before


def _worth(
    moved: Linearised, state: SweepState, corners: SweepCorners, weights: np.ndarray, free: np.ndarray, ratio: float
) -> SweepFit:
    lens = moved.by_lens.shape[-1]
    count = int(free.sum())
    rows = np.concatenate(
        [moved.by_state[..., free], moved.by_lens, moved.residuals_px[..., None], moved.by_angles], axis=-1
    )
    blocks = _picture_blocks(rows * np.sqrt(weights)[:, None, None], corners)
    whole, _ = _eliminated(blocks, ratio)
    A, coupling, cost = whole[:count, :count], whole[:count, count : count + lens], float(whole[-1, -1])
    variance = max(cost / max(2 * weights.sum() - count, 1.0), _ROUNDING_PX**2)
    covariance, by_lens = np.zeros((STATE, STATE)), np.zeros((STATE, lens))
    covariance[np.ix_(free, free)] = variance * _solved(A, np.eye(count))
    by_lens[free] = -_solved(A, coupling)
    residuals = moved.residuals_px
    if ratio > 0.0:
        shift = np.linalg.solve(blocks[:, -2:, -2:] + np.eye(2) / ratio, blocks[:, -2:, -3, None])[..., 0]
        residuals = residuals - np.einsum("nij,nj->ni", moved.by_angles, shift[corners.picture])
    return SweepFit(state, ratio, variance, residuals, covariance, by_lens)
