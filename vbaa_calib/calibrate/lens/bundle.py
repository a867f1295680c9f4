"""Bundle adjustment of one lens, one board and many board poses; the poses are eliminated view by view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.core.least_squares import Rules, levenberg_marquardt, schur_complement, solve_scaled, view_products
from vbaa_calib.core.robust import cauchy_weights, radial_std

from .models import PROJECTIONS, LensModel, Unfolding

FLEX = 2
"""Numbers that describe a board that is not flat (`board_flex`)."""


@dataclass(frozen=True, eq=False)
class Observation:
    """Corners of one view: board points (N, 3) m and their pixels (N, 2).

    bend : (N, 2) how far each point rises along the board's z for a metre of each sagitta; a flat board has none.
    """

    points_m: np.ndarray
    pixels: np.ndarray
    bend: np.ndarray | None = None

    def picked(self, which: np.ndarray) -> Observation:
        """The corners of a mask or of indices."""
        bend = None if self.bend is None else self.bend[which]
        return Observation(self.points_m[which], self.pixels[which], bend)


@dataclass(frozen=True, eq=False)
class Stack:
    """All corners one after the other: view `i` has rows bounds[i] to bounds[i + 1]."""

    points_m: np.ndarray
    pixels: np.ndarray
    bend: np.ndarray
    view: np.ndarray
    bounds: np.ndarray

    @staticmethod
    def of(observations: Sequence[Observation]) -> Stack:
        counts = [len(view.pixels) for view in observations]
        return Stack(
            np.concatenate([view.points_m for view in observations]),
            np.concatenate([view.pixels for view in observations]),
            np.concatenate([np.zeros((len(v.pixels), FLEX)) if v.bend is None else v.bend for v in observations]),
            np.repeat(np.arange(len(counts)), counts),
            np.concatenate([[0], np.cumsum(counts)]),
        )


@dataclass(frozen=True, eq=False)
class State:
    """Where the descent is: what all views share (4 + k + 2,), and the poses (V, 6)."""

    shared: np.ndarray
    poses: np.ndarray

    def moved(self, shared: np.ndarray, poses: np.ndarray) -> State:
        """Poses turn about the board's origin by a rotation vector in the camera frame, and shift."""
        turned = Rotation.from_rotvec(poses[:, :3]) * Rotation.from_rotvec(self.poses[:, :3])
        return State(self.shared + shared, np.hstack([turned.as_rotvec(), self.poses[:, 3:] + poses[:, 3:]]))


def rows(model: LensModel, state: State, stack: Stack) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (N, 2) and their negative derivatives by what is shared (N, 2, 4 + k + 2) and the poses (N, 2, 6)."""
    intrinsics, sagittas = state.shared[:-FLEX], state.shared[-FLEX:]
    rotations = Rotation.from_rotvec(state.poses[:, :3]).as_matrix()[stack.view]
    rise = stack.bend @ sagittas
    turned = np.einsum("nij,nj->ni", rotations, stack.points_m) + rise[:, None] * rotations[:, :, 2]
    points = turned + state.poses[stack.view, 3:]
    pixels, by_intrinsics, by_pose = PROJECTIONS[model.camera_model](points, np.zeros(6), intrinsics)
    by_point = by_pose[:, 3:].reshape(-1, 2, 3)
    # gᵀ(ω × q) = ωᵀ(q × g)
    (x, y, z), (a, b, c) = turned.T[:, :, None], np.moveaxis(by_point, -1, 0)
    by_turn = np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=-1)
    by_sagitta = (by_point @ rotations[:, :, 2:]) * stack.bend[:, None, :]
    by_shared = np.concatenate([by_intrinsics.reshape(len(points), 2, -1), by_sagitta], axis=-1)
    return stack.pixels - pixels, by_shared, np.concatenate([by_turn, by_point], axis=-1)


CONVERGED = Rules(300, 1e-8, may_rise_share=1e-13, damping=1e-3, growth=8.0, after_failure=0.0)
"""Enough for decisions; `polished` for what is reported."""
_STANDSTILL, _POLISH = 1e-6, replace(CONVERGED, iterations=10, damping=1e-8)
_REWEIGHTINGS, _CONVERGED_WEIGHTS = 12, 1e-2
_FEW_STEPS = replace(CONVERGED, iterations=2, tolerance=1e-4)


@dataclass(frozen=True, eq=False)
class Bundle:
    """A lens with the poses of its views: a start, or a solution.

    intrinsics : (4 + k,) fx, fy, cx, cy, distortion. sagittas_m : (2,) of the board along its x and y.
    poses : (V, 6) rotation vector rad and translation m, T_camera_board of each view.
    directions : (4 + k + 2, p) from `free_directions`: what is solved for besides the poses.
    residuals_px : per view (N, 2), observed minus projected; none at a start.
    unfolding : what keeps the lens from folding, where that was needed.
    """

    model: LensModel
    intrinsics: np.ndarray
    poses: np.ndarray
    directions: np.ndarray
    residuals_px: tuple[np.ndarray, ...] = ()
    sagittas_m: np.ndarray = field(default_factory=lambda: np.zeros(FLEX))
    unfolding: Unfolding | None = None

    @staticmethod
    def start(model: LensModel, intrinsics: np.ndarray, poses: np.ndarray, square_pixels: bool = False) -> Bundle:
        """Before anything is solved, the board flat."""
        return Bundle(model, intrinsics, poses, free_directions(model, square_pixels))

    @property
    def poses_only(self) -> Bundle:
        """The same with nothing but the poses to be solved for."""
        return replace(self, directions=self.directions[:, :0])

    def freed(self, square_pixels: bool, flex: bool) -> Bundle:
        """The same with intrinsics, and the board's sagittas or none, to be solved for."""
        sagittas = self.sagittas_m if flex else np.zeros(FLEX)
        return replace(self, directions=free_directions(self.model, square_pixels, flex), sagittas_m=sagittas)

    @property
    def state(self) -> State:
        """Where a descent from here begins."""
        return State(np.concatenate([self.intrinsics, self.sagittas_m]), self.poses)

    @property
    def rms_px(self) -> float:
        """Root mean square distance between observed and projected corners, over all corners."""
        return float(np.sqrt(np.mean(np.sum(np.concatenate(self.residuals_px) ** 2, axis=1))))

    @property
    def view_rms_px(self) -> np.ndarray:
        """(V,) the same, view by view."""
        return np.array([np.sqrt(np.mean(np.sum(r**2, axis=1))) for r in self.residuals_px])

    @property
    def sigma_px(self) -> float:
        """Noise per axis as the median corner has it: half of the corners may be wrong."""
        return radial_std(np.linalg.norm(np.concatenate(self.residuals_px), axis=1))


def free_directions(model: LensModel, square_pixels: bool = False, flex: bool = False) -> np.ndarray:
    """(4 + k + 2, p) columns span what all views share and is solved for: intrinsics, then the board's sagittas.

    With square pixels fx and fy move as one.
    """
    size = 4 + model.distortion_count
    unit = np.eye(size + FLEX)
    rest = [2, 3, *(4 + index for index in model.free), *((size, size + 1) if flex else ())]
    focal = unit[:, :1] + unit[:, 1:2] if square_pixels else unit[:, :2]
    return np.hstack([focal, unit[:, rest]])


def refine(
    start: Bundle, observations: Sequence[Observation], rules: Rules = CONVERGED, robust: bool = False
) -> Bundle:
    """Levenberg–Marquardt on the reprojection error.

    robust : weigh corners down by Cauchy's loss, so that gross errors do not pull.
    """
    stack, state = Stack.of(observations), start.state
    problem = _Problem(start.model, stack, np.ones(len(stack.pixels)), start.directions, start.unfolding)
    if robust:
        weights = cauchy_weights(np.linalg.norm(rows(start.model, state, stack)[0], axis=1))
        for _ in range(_REWEIGHTINGS):
            problem = replace(problem, weights=weights)
            system = problem.descended(state, _FEW_STEPS)
            state, weights = system.state, cauchy_weights(np.linalg.norm(system.residuals_px, axis=1))
            if np.abs(weights - problem.weights).max() < _CONVERGED_WEIGHTS:
                break
        problem = replace(problem, weights=weights)
    system = problem.descended(state, rules)
    return replace(
        start,
        intrinsics=system.state.shared[:-FLEX],
        poses=system.state.poses,
        residuals_px=tuple(np.split(system.residuals_px, stack.bounds[1:-1])),
        sagittas_m=system.state.shared[-FLEX:],
    )


def polished(bundle: Bundle, observations: Sequence[Observation]) -> Bundle:
    """A solution whose next step would be under a millionth of the parameters' deviations, whatever the problem's size.

    Reported numbers must not show where a descent happened to end; decisions need less.
    """
    sizes = sum(view.pixels.size for view in observations) - bundle.directions.shape[1] - 6 * len(observations)
    return refine(bundle, observations, replace(_POLISH, tolerance=_STANDSTILL**2 / max(sizes, 1)))


def residuals_px(bundle: Bundle, observations: Sequence[Observation]) -> list[np.ndarray]:
    """Per view (N, 2), observed minus projected, of any corners of the bundle's views."""
    stack = Stack.of(observations)
    return np.split(rows(bundle.model, bundle.state, stack)[0], stack.bounds[1:-1])


@dataclass(frozen=True, eq=False)
class _Problem:
    """What is minimised: the weighted corners, and what keeps the lens from folding."""

    model: LensModel
    stack: Stack
    weights: np.ndarray
    directions: np.ndarray
    unfolding: Unfolding | None

    def linearised(self, state: State) -> _System:
        residuals, by_shared, by_pose = rows(self.model, state, self.stack)
        columns = np.concatenate([by_shared @ self.directions, residuals[..., None], by_pose], axis=-1)
        blocks = view_products(columns * np.sqrt(self.weights)[:, None, None], self.stack.bounds)
        total = blocks[:, :-6, :-6].sum(axis=0)
        if self.unfolding is not None:
            lacking, by_lens = self.unfolding.rows(self.model, state.shared[:-FLEX])
            held = np.column_stack([by_lens @ self.directions[:-FLEX], lacking])
            total = total + held.T @ held
        return _System(state, residuals, float(total[-1, -1]), total, blocks[:, -6:, :-6], blocks[:, -6:, -6:])

    def moved(self, system: _System, step: np.ndarray) -> _System:
        shared, poses = np.split(step, [self.directions.shape[1]])
        return self.linearised(system.state.moved(self.directions @ shared, poses.reshape(-1, 6)))

    def descended(self, state: State, rules: Rules) -> _System:
        return levenberg_marquardt(self.linearised(state), _step, self.moved, rules).at


@dataclass(frozen=True, eq=False)
class _System:
    """The normal equations at a state; the last row and column of `total` and `coupling` are the residuals'."""

    state: State
    residuals_px: np.ndarray
    cost: float
    total: np.ndarray
    coupling: np.ndarray
    poses: np.ndarray


def _step(system: _System, damping: float) -> tuple[np.ndarray, float]:
    """Steps of what is shared and of the poses, and what they take off the cost if the problem is linear, or less."""
    damped = system.total + damping * np.diag(np.append(np.diag(system.total)[:-1], 0.0))
    reduced, through = schur_complement(damped, system.coupling, system.poses * (1.0 + damping * np.eye(6)))
    shared = solve_scaled(reduced[:-1, :-1], reduced[:-1, -1])
    poses = through[..., -1] - through[..., :-1] @ shared
    promise = float(system.total[:-1, -1] @ shared + np.sum(system.coupling[..., -1] * poses))
    return np.concatenate([shared, poses.ravel()]), promise
