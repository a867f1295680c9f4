"""Levenberg–Marquardt on the reprojection error, compiled; the poses are eliminated view by view."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import kernel

from .board_shape import SHAPE, TAIL
from .projection import WORK, Corners, corner_radius, most_corners, radial_slope, turned, view_rows

_LEAST_DAMPING, _MOST_DAMPING, _SINGULAR = 1e-15, 1e12, 1e-15
_REWEIGHTINGS, _CONVERGED_WEIGHTS, _FEW, _ROUGH = 12, 1e-2, 2, 1e-4
_SAMPLES, _FURTHEST_PER_CORNER = 160, 4.0
_CAUCHY_PER_MEDIAN, _LEAST_PX = 2.385 / 1.1774, 2.385e-9
"""Scale of Cauchy's loss: 95 % efficiency on normal noise."""


class Held(NamedTuple):
    """What holds the board's shape and the lens, besides the corners.

    mean, std : (5,) of the shape's prior, weighed by noise_px; zero where there is none.
    least_slope : of the distorted radius by the ideal one, wherever the picture reaches; zero where there is none.
    stiffness_px : residual of a slope of zero at one of the radii checked.
    """

    mean: np.ndarray
    std: np.ndarray
    noise_px: float
    least_slope: float
    stiffness_px: float
    image_size: tuple[int, int]


class Stop(NamedTuple):
    """When a descent ends, as `core.least_squares.Rules` says it."""

    iterations: int
    tolerance: float
    damping: float
    growth: float
    may_rise_share: float


class State(NamedTuple):
    """Lens (4 + k,), board's shape (5,), poses (V, 6)."""

    lens: np.ndarray
    shape: np.ndarray
    poses: np.ndarray


class _System(NamedTuple):
    """The normal equations at a state; the last row and column of `total` and `coupling` are the residuals'."""

    state: State
    residuals: np.ndarray
    cost: float
    total: np.ndarray
    coupling: np.ndarray
    own: np.ndarray


@kernel
def unfolding_rows(lens: np.ndarray, fisheye: bool, held: Held) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (m,) px of the radii where the slope is too small, their negative derivatives (m, 4 + k)."""
    reach = corner_radius(lens, held.image_size)
    furthest = _FURTHEST_PER_CORNER * reach
    if fisheye:
        furthest = min(furthest, np.pi)
    lacking, by_lens = np.empty(_SAMPLES), np.zeros((_SAMPLES, len(lens)))
    count, highest, scale = 0, -np.inf, held.stiffness_px / held.least_slope
    for i in range(_SAMPLES):
        curve, slope = radial_slope(lens[4:], fisheye, furthest * i / (_SAMPLES - 1), by_lens[count, 4:])
        # beyond the picture nothing is required
        if slope < held.least_slope and (i == 0 or highest < reach):
            lacking[count] = scale * (held.least_slope - slope)
            for j in range(4, len(lens)):
                by_lens[count, j] *= scale
            count += 1
        highest = max(highest, curve)
    return lacking[:count], by_lens[:count]


@kernel
def _normal_equations(
    state: State, fisheye: bool, corners: Corners, weights: np.ndarray, column: np.ndarray, held: Held
) -> _System:
    """Linearised at a state; column : (4 + k + 5,) among the unknowns, -1 of what is not one."""
    views, size, free = len(state.poses), len(column), 0
    for one in column:
        free = max(free, one + 1)
    most, residuals, width = most_corners(corners), np.empty((len(corners.pixels), 2)), free + 7
    work, slopes, picked = np.empty((WORK, most)), np.empty((size + 7, 2 * most)), np.empty((width, 2 * most))
    total, block = np.zeros((free + 1, free + 1)), np.empty((width, width))
    coupling, own = np.empty((views, 6, free + 1)), np.empty((views, 6, 6))
    for view in range(views):
        count = view_rows(view, corners, (state.lens, state.shape, state.poses), fisheye, work, slopes)
        for n in range(count):
            at = corners.bounds[view] + n
            residuals[at, 0], residuals[at, 1] = slopes[size + 6, n], slopes[size + 6, count + n]
            work[0, n] = np.sqrt(weights[at])
        _pick(picked, slopes, work[0], count, column)
        _products(block, picked, 2 * count)
        for j in range(free + 1):
            for i in range(j, free + 1):
                total[i, j] += block[i, j]
            for i in range(6):
                coupling[view, i, j] = block[free + 1 + i, j]
        for i in range(6):
            for j in range(i + 1):
                own[view, i, j] = block[free + 1 + i, free + 1 + j]
    cost = total[free, free] + _hold(total, state, fisheye, column, held)
    return _System(state, residuals, cost, total, coupling, own)


@kernel
def _pick(picked: np.ndarray, slopes: np.ndarray, roots: np.ndarray, count: int, column: np.ndarray) -> None:
    """Weighted rows of the unknowns (p,), the residuals and the pose (6,), from a view's slopes (4 + k + 5 + 7, 2M)."""
    free, size = len(picked) - 7, len(column)
    picked[:free] = 0.0
    for i in range(size + 7):
        to = column[i] if i < size else free + 1 + i - size if i < size + 6 else free
        if i >= size:
            picked[to] = 0.0
        if to >= 0:
            for axis in range(2):
                for n in range(count):
                    picked[to, axis * count + n] += roots[n] * slopes[i, axis * count + n]


@kernel
def _products(block: np.ndarray, rows: np.ndarray, count: int) -> None:
    """Lower triangle of the products of rows (m, M), over their first numbers; two rows at once, which reads less."""
    for i in range(0, len(rows), 2):
        other = min(i + 1, len(rows) - 1)
        for j in range(other + 1):
            first, second = 0.0, 0.0
            for n in range(count):
                first += rows[i, n] * rows[j, n]
                second += rows[other, n] * rows[j, n]
            block[i, j], block[other, j] = first, second


@kernel
def _hold(total: np.ndarray, state: State, fisheye: bool, column: np.ndarray, held: Held) -> float:
    """The cost of what holds lens and shape, after it is in the equations."""
    free, cost = len(total) - 1, 0.0
    if held.least_slope > 0.0:
        lacking, by_lens = unfolding_rows(state.lens, fisheye, held)
        for row in range(len(lacking)):
            cost += lacking[row] ** 2
            for i in range(4, len(state.lens)):
                for j in range(4, len(state.lens)):
                    if column[i] >= column[j] >= 0:
                        total[column[i], column[j]] += by_lens[row, i] * by_lens[row, j]
                if column[i] >= 0:
                    total[free, column[i]] += lacking[row] * by_lens[row, i]
    if held.noise_px > 0.0:
        for i in range(SHAPE):
            off, at = (state.shape[i] - held.mean[i]) / held.std[i], column[len(state.lens) + i]
            weight = held.noise_px * np.sqrt((TAIL + 1.0) / (TAIL + off * off))
            if at >= 0:
                total[at, at] += (weight / held.std[i]) ** 2
                total[free, at] -= weight * weight * off / held.std[i]
            cost += held.noise_px**2 * (TAIL + 1.0) * np.log1p(off * off / TAIL)
    return cost


@kernel
def factored(matrix: np.ndarray, size: int) -> bool:
    """Cholesky's factor of the first rows in place, lower; whether there is one.

    Unknowns that the others explain all but for rounding are held.
    """
    whole = True
    for i in range(size):
        square = matrix[i, i]
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            if j < i:
                matrix[i, j] = value * matrix[j, j]
            else:
                whole &= value > _SINGULAR * square
                # one over the diagonal is what is needed
                matrix[i, i] = 1.0 / np.sqrt(value) if value > _SINGULAR * square else 0.0
    return whole


@kernel
def _solve_factored(factor: np.ndarray, right: np.ndarray) -> None:
    """Solve in place for right (n, m), with what `factored` left."""
    n, m = right.shape
    for i in range(n):
        for k in range(i):
            for j in range(m):
                right[i, j] -= factor[i, k] * right[k, j]
        for j in range(m):
            right[i, j] *= factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            for j in range(m):
                right[i, j] -= factor[k, i] * right[k, j]
        for j in range(m):
            right[i, j] *= factor[i, i]


@kernel
def _step(system: _System, damping: float) -> tuple[bool, np.ndarray, np.ndarray, float]:
    """Whether there is a step, that of the unknowns (p,) and poses (V, 6), and the decrease that it promises."""
    free, views = len(system.total) - 1, len(system.own)
    reduced, through = system.total.copy(), system.coupling.copy()
    for i in range(free):
        reduced[i, i] *= 1.0 + damping
    possible = True
    for view in range(views):
        own = system.own[view].copy()
        for i in range(6):
            own[i, i] *= 1.0 + damping
        possible &= factored(own, 6)
        _solve_factored(own, through[view])
        for k in range(6):
            for i in range(free + 1):
                for j in range(i + 1):
                    reduced[i, j] -= system.coupling[view, k, i] * through[view, k, j]
    scale, shared = np.empty(free), np.empty((free, 1))
    for i in range(free):
        scale[i] = 1.0 / np.sqrt(max(reduced[i, i], 1e-30))
        shared[i, 0] = scale[i] * reduced[free, i]
        for j in range(i + 1):
            reduced[i, j] *= scale[i] * scale[j]
    factored(reduced, free)
    _solve_factored(reduced, shared)
    move, poses, promise = np.empty(free), np.empty((views, 6)), 0.0
    for i in range(free):
        move[i] = scale[i] * shared[i, 0]
        promise += system.total[free, i] * move[i]
    for view in range(views):
        for k in range(6):
            poses[view, k] = through[view, k, free]
            for i in range(free):
                poses[view, k] -= through[view, k, i] * move[i]
            promise += system.coupling[view, k, free] * poses[view, k]
    return possible and np.isfinite(promise), move, poses, promise


@kernel
def _moved(state: State, shared: np.ndarray, poses: np.ndarray, column: np.ndarray) -> State:
    """By steps of the unknowns (p,), and of the poses (V, 6): a turn in the camera frame, and a shift."""
    lens, shape, moved = state.lens.copy(), state.shape.copy(), state.poses.copy()
    for i in range(len(column)):
        if column[i] >= 0:
            if i < len(lens):
                lens[i] += shared[column[i]]
            else:
                shape[i - len(lens)] += shared[column[i]]
    for view in range(len(moved)):
        moved[view, 0], moved[view, 1], moved[view, 2] = turned(poses[view], state.poses[view])
        for i in range(3, 6):
            moved[view, i] += poses[view, i]
    return State(lens, shape, moved)


@kernel
def _descended(
    state: State, fisheye: bool, corners: Corners, weights: np.ndarray, column: np.ndarray, held: Held, stop: Stop
) -> _System:
    """The least cost, as `core.least_squares.levenberg_marquardt` finds it; but a step that changes it by no more than
    its rounding is taken only where less is promised after it."""
    at = _normal_equations(state, fisheye, corners, weights, column, held)
    damping = stop.damping
    for _ in range(stop.iterations):
        possible, shared, poses, promise = _step(at, damping)
        if not possible:
            damping *= stop.growth
            continue
        # a damped step is short wherever it is taken
        if promise <= stop.tolerance * at.cost and damping < 1.0:
            break
        trial = _normal_equations(_moved(at.state, shared, poses, column), fisheye, corners, weights, column, held)
        rounding, decrease, last = stop.may_rise_share * at.cost, at.cost - trial.cost, False
        sooner = decrease > rounding
        if not sooner and decrease >= -rounding:  # what is still promised there tells
            possible, _, _, left = _step(trial, damping)
            sooner = possible and left < promise
        if sooner:
            at, damping = trial, max(0.1 * damping, _LEAST_DAMPING)
            last = rounding < decrease <= stop.tolerance * at.cost and damping < 1.0
        else:
            damping *= stop.growth
        if last or damping > _MOST_DAMPING:
            break
    return at


@kernel
def descend(
    state: State, fisheye: bool, corners: Corners, column: np.ndarray, held: Held, stop: Stop, robust: bool
) -> tuple[State, np.ndarray]:
    """The least cost of the corners and of what holds lens and shape, and the residuals (N, 2) px there.

    robust : by Cauchy's loss, so gross errors do not pull.
    column : (4 + k + 5,) which unknown each number of lens and shape is; -1 of those that are held.
    """
    weights, turn, last = corners.weights * corners.weights, 0, not robust
    while True:
        few = Stop(_FEW if turn else 0, _ROUGH, stop.damping, stop.growth, stop.may_rise_share)
        system = _descended(state, fisheye, corners, weights, column, held, stop if last else few)
        if last:
            return system.state, system.residuals
        state, change = system.state, _reweight(weights, system.residuals, corners.weights)
        last = turn == _REWEIGHTINGS or (turn > 0 and change < _CONVERGED_WEIGHTS)
        turn += 1


@kernel
def _reweight(weights: np.ndarray, residuals: np.ndarray, own: np.ndarray) -> float:
    """Make weights (N,) those on the squares of residuals (N, 2) for Cauchy's loss, its scale from their median.

    Returns by how much they change. own : (N,) weights of the residuals.
    """
    lengths, change = np.empty(len(own)), 0.0
    for n in range(len(own)):
        lengths[n] = own[n] * np.hypot(residuals[n, 0], residuals[n, 1])
    scale = max(_CAUCHY_PER_MEDIAN * np.median(lengths), _LEAST_PX)
    for n in range(len(own)):
        before, weights[n] = weights[n], own[n] ** 2 / (1.0 + (lengths[n] / scale) ** 2)
        change = max(change, abs(weights[n] - before))
    return change
