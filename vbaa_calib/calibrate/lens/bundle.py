"""Joint least squares over one lens, one board and many board poses, with the poses eliminated view by view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

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


_RELATIVE_DECREASE = 1e-8
_STANDSTILL, _UNDAMPED = 1e-6, 1e-8
_ROUNDING, _POLISHING = 1e-13, 10
_ROUGHLY = 1e-4
_REWEIGHTINGS = 12
_STEPS_PER_WEIGHTING = 2
_SETTLED = 1e-2


@dataclass(frozen=True, eq=False)
class Bundle:
    """A solution of the joint problem.

    Attributes
    ----------
    intrinsics : (4 + k,) fx, fy, cx, cy, distortion.
    poses : (V, 6) rotation vector rad and translation m, T_camera_board of each view.
    residuals_px : per view (N, 2), observed minus projected.
    sagittas_m : (2,) of the board along its x and y.
    unfolding : what held the lens from folding, where that was needed.
    """

    intrinsics: np.ndarray
    poses: np.ndarray
    residuals_px: tuple[np.ndarray, ...]
    sagittas_m: np.ndarray = field(default_factory=lambda: np.zeros(FLEX))
    unfolding: Unfolding | None = None

    @property
    def rms_px(self) -> float:
        """Root mean square distance between observed and projected corners, over all corners."""
        return float(np.sqrt(np.mean(np.concatenate([np.sum(r**2, axis=1) for r in self.residuals_px]))))

    @property
    def view_rms_px(self) -> np.ndarray:
        """(V,) the same, view by view."""
        return np.array([np.sqrt(np.mean(np.sum(r**2, axis=1))) for r in self.residuals_px])

    @property
    def sigma_px(self) -> float:
        """Noise per axis as the median corner has it: half of the corners may be wrong."""
        return radial_std(np.concatenate([np.linalg.norm(r, axis=1) for r in self.residuals_px]))


def free_directions(model: LensModel, square_pixels: bool = False, flex: bool = False) -> np.ndarray:
    """(4 + k + 2, p) columns span what all views share and is solved for: intrinsics, then the board's sagittas.

    With square pixels fx and fy move as one.
    """
    size = 4 + model.distortion_count
    unit = np.eye(size + FLEX)
    columns = [unit[index] for index in (2, 3, *(4 + index for index in model.free))]
    columns += [unit[size], unit[size + 1]] if flex else []
    focal = [unit[0] + unit[1]] if square_pixels else [unit[0], unit[1]]
    return np.stack([*focal, *columns], axis=1)


def refine(
    model: LensModel,
    intrinsics: np.ndarray,
    poses: np.ndarray,
    observations: Sequence[Observation],
    directions: np.ndarray,
    robust: bool = False,
    iterations: int = 300,
    sagittas_m: Sequence[float] | np.ndarray = (0.0, 0.0),
    unfolding: Unfolding | None = None,
    tolerance: float = _RELATIVE_DECREASE,
    damping: float = 1e-3,
) -> Bundle:
    """Levenberg–Marquardt on the reprojection error from a start.

    Parameters
    ----------
    intrinsics : (4 + k,) start. poses : (V, 6) start. sagittas_m : (2,) start.
    directions : (4 + k + 2, p) from `free_directions`; p = 0 solves the poses alone.
    robust : weigh corners down by Cauchy's rule, so that gross errors do not pull.
    iterations : at most; a few are enough to tell good starts from bad ones.
    unfolding : what to add to the cost so that the lens does not fold.
    tolerance : the descent ends when a step takes off less than this share of the cost. damping : of the first step.
    """
    stack = Stack.of(observations)
    state = State(np.concatenate([np.asarray(intrinsics, float), sagittas_m]), np.array(poses, float))
    weights = np.ones(len(stack.pixels))
    if robust:
        weights, state = _reweighted(model, state, stack, directions, unfolding)
    state, system = _descend(model, state, stack, weights, directions, iterations, unfolding, tolerance, damping)
    residuals = tuple(np.split(system.residuals_px, stack.bounds[1:-1]))
    return Bundle(state.shared[:-FLEX], state.poses, residuals, state.shared[-FLEX:], unfolding)


def polished(model: LensModel, bundle: Bundle, observations: Sequence[Observation], directions: np.ndarray) -> Bundle:
    """A solution whose next step would be under a millionth of the parameters' deviations, whatever the problem's size.

    Reported numbers must not show where a descent happened to end; decisions need less.
    """
    freedom = max(sum(view.pixels.size for view in observations) - directions.shape[1] - 6 * len(observations), 1)
    return refine(
        model,
        bundle.intrinsics,
        bundle.poses,
        observations,
        directions,
        sagittas_m=bundle.sagittas_m,
        unfolding=bundle.unfolding,
        iterations=_POLISHING,
        tolerance=_STANDSTILL**2 / freedom,
        damping=_UNDAMPED,
    )


def residuals_px(model: LensModel, bundle: Bundle, observations: Sequence[Observation]) -> list[np.ndarray]:
    """Per view (N, 2), observed minus projected, of any corners of the bundle's views."""
    stack = Stack.of(observations)
    state = State(np.concatenate([bundle.intrinsics, bundle.sagittas_m]), bundle.poses)
    return np.split(rows(model, state, stack)[0], stack.bounds[1:-1])


@dataclass(frozen=True, eq=False)
class _System:
    """The normal equations in blocks: shared, poses, and what couples them; all weighted."""

    residuals_px: np.ndarray
    cost: float
    shared: np.ndarray
    shared_gradient: np.ndarray
    pose: np.ndarray
    pose_gradient: np.ndarray
    coupling: np.ndarray


def _linearise(
    model: LensModel,
    state: State,
    stack: Stack,
    weights: np.ndarray,
    directions: np.ndarray,
    unfolding: Unfolding | None,
) -> _System:
    residuals, by_shared, by_pose = rows(model, state, stack)
    scaled = np.concatenate([by_shared @ directions, by_pose, residuals[..., None]], axis=-1)
    scaled *= np.sqrt(weights)[:, None, None]
    blocks = np.array(
        [
            (flat := scaled[first:last].reshape(-1, scaled.shape[-1])).T @ flat
            for first, last in zip(stack.bounds[:-1], stack.bounds[1:], strict=True)
        ]
    )
    p = directions.shape[1]
    lacking, held = np.zeros(0), np.zeros((0, p))
    if unfolding is not None:
        lacking, by_lens = unfolding.rows(model, state.shared[:-FLEX])
        held = by_lens @ directions[:-FLEX]
    return _System(
        residuals_px=residuals,
        cost=float(blocks[:, -1, -1].sum() + lacking @ lacking),
        shared=blocks[:, :p, :p].sum(axis=0) + held.T @ held,
        shared_gradient=blocks[:, :p, -1].sum(axis=0) + held.T @ lacking,
        pose=blocks[:, p:-1, p:-1],
        pose_gradient=blocks[:, p:-1, -1],
        coupling=blocks[:, :p, p:-1],
    )


def _step(system: _System, damping: float) -> tuple[np.ndarray, np.ndarray]:
    pose = system.pose * (1.0 + damping * np.eye(6))
    both = np.linalg.solve(
        pose, np.concatenate([np.swapaxes(system.coupling, 1, 2), system.pose_gradient[..., None]], axis=-1)
    )
    through, own = both[..., :-1], both[..., -1]
    shared = system.shared + damping * np.diag(np.diag(system.shared))
    reduced = shared - (system.coupling @ through).sum(axis=0)
    gradient = system.shared_gradient - np.einsum("vpk,vk->p", system.coupling, own)
    shared_step = _solve_scaled(reduced, gradient)
    return shared_step, own - through @ shared_step


def _promise(system: _System, shared_step: np.ndarray, pose_step: np.ndarray) -> float:
    """What a step takes off the cost if the problem is linear, or less."""
    return float(system.shared_gradient @ shared_step + np.sum(system.pose_gradient * pose_step))


def _solve_scaled(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    # coefficients differ by many orders of magnitude from focal lengths
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    return scale * np.linalg.lstsq(matrix * np.outer(scale, scale), scale * vector, rcond=1e-15)[0]


def _descend(
    model: LensModel,
    state: State,
    stack: Stack,
    weights: np.ndarray,
    directions: np.ndarray,
    iterations: int,
    unfolding: Unfolding | None,
    tolerance: float,
    damping: float = 1e-3,
) -> tuple[State, _System]:
    system = _linearise(model, state, stack, weights, directions, unfolding)
    for _ in range(iterations):
        try:
            shared_step, pose_step = _step(system, damping)
        except np.linalg.LinAlgError:
            damping *= 10.0
            continue
        # a step that promises nothing need not be taken to know it
        if _promise(system, shared_step, pose_step) <= tolerance * system.cost and damping < 1.0:
            break
        new_state = state.moved(directions @ shared_step, pose_step)
        trial = _linearise(model, new_state, stack, weights, directions, unfolding)
        if np.isfinite(trial.cost) and trial.cost <= (1.0 + _ROUNDING) * system.cost:
            decrease = system.cost - trial.cost
            state, system = new_state, trial
            damping = max(0.1 * damping, 1e-15)
            # under heavy damping a step is small wherever it is taken, and rounding is no decrease
            if _ROUNDING * system.cost < decrease <= tolerance * system.cost and damping < 1.0:
                break
        else:
            damping *= 8.0
            if damping > 1e12:
                break
    return state, system


def _reweighted(
    model: LensModel, state: State, stack: Stack, directions: np.ndarray, unfolding: Unfolding | None
) -> tuple[np.ndarray, State]:
    """Cauchy weights (N,) that have settled, and the state that they lead to."""
    weights = cauchy_weights(np.linalg.norm(rows(model, state, stack)[0], axis=1))
    for _ in range(_REWEIGHTINGS):
        state, system = _descend(model, state, stack, weights, directions, _STEPS_PER_WEIGHTING, unfolding, _ROUGHLY)
        before, weights = weights, cauchy_weights(np.linalg.norm(system.residuals_px, axis=1))
        if np.abs(weights - before).max() < _SETTLED:
            break
    return weights, state
