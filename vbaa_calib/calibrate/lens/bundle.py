"""Bundle adjustment of one lens, one board and many board poses; the poses are eliminated view by view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.core.least_squares import Rules, levenberg_marquardt, schur_complement, solve_scaled, view_products
from vbaa_calib.core.robust import cauchy_weights, radial_std

from .board_shape import SHAPE, ShapePrior
from .models import PROJECTIONS, LensModel, Unfolding

CONVERGED = Rules(300, 1e-8, may_rise_share=1e-13, damping=1e-3, growth=8.0, after_failure=0.0)
"""Enough for decisions; `polished` for what is reported."""
_STANDSTILL, _POLISH = 1e-6, replace(CONVERGED, iterations=10, damping=1e-8)
_REWEIGHTINGS, _CONVERGED_WEIGHTS = 12, 1e-2
_USUAL_NOISE_PX, _LEAST_NOISE_PX = 0.2, 1e-3
_FEW_STEPS = replace(CONVERGED, iterations=2, tolerance=1e-4)


@dataclass(frozen=True, eq=False)
class Observation:
    """Corners of one view: board points (N, 3) m and their pixels (N, 2).

    deformation : (N, 3, 5) how each point moves with the board's shape (`deformations`); None of a rigid thing.
    weight : of its residuals, as against the others': less than 1 for a view with more noise.
    """

    points_m: np.ndarray
    pixels: np.ndarray
    deformation: np.ndarray | None = None
    weight: float = 1.0

    def picked(self, which: np.ndarray) -> Observation:
        """The corners of a mask or of indices."""
        deformation = None if self.deformation is None else self.deformation[which]
        return Observation(self.points_m[which], self.pixels[which], deformation, self.weight)


def rows(bundle: Bundle, observations: Sequence[Observation]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (N, 2) px of all corners, their negative derivatives by intrinsics and shape (N, 2, 4 + k + 5) and
    by the views' poses (N, 2, 6), and the views' bounds (V + 1,): view v has rows bounds[v] to bounds[v + 1].

    Poses turn about the board's origin by a rotation vector in the camera frame, and shift.
    """
    counts = [len(view.pixels) for view in observations]
    bounds, of_view = np.concatenate([[0], np.cumsum(counts)]), np.repeat(np.arange(len(counts)), counts)
    points_m = np.concatenate([view.points_m for view in observations])
    rigid = [np.zeros((len(v.pixels), 3, SHAPE)) if v.deformation is None else v.deformation for v in observations]
    deformation = np.concatenate(rigid)
    rotations = Rotation.from_rotvec(bundle.poses[:, :3]).as_matrix()[of_view]
    turned = np.einsum("nij,nj->ni", rotations, points_m + deformation @ bundle.shape)
    points = turned + bundle.poses[of_view, 3:]
    pixels, by_intrinsics, by_pose = PROJECTIONS[bundle.model.camera_model](points, np.zeros(6), bundle.intrinsics)
    by_point = by_pose[:, 3:].reshape(-1, 2, 3)
    # gᵀ(ω × q) = ωᵀ(q × g)
    (x, y, z), (a, b, c) = turned.T[:, :, None], np.moveaxis(by_point, -1, 0)
    by_turn = np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=-1)
    by_shape = (by_point @ rotations) @ deformation
    by_shared = np.concatenate([by_intrinsics.reshape(len(points), 2, -1), by_shape], axis=-1)
    residuals = np.concatenate([view.pixels for view in observations]) - pixels
    return residuals, by_shared, np.concatenate([by_turn, by_point], axis=-1), bounds


@dataclass(frozen=True, eq=False)
class Bundle:
    """A lens with the poses of its views: a start, or a solution.

    intrinsics : (4 + k,) fx, fy, cx, cy, distortion. shape : (5,) of the board (`BoardShape`).
    poses : (V, 6) rotation vector rad and translation m, T_camera_board of each view.
    directions : (4 + k + 5, p) from `free_directions`: what is solved for besides the poses.
    residuals_px : per view (N, 2), observed minus projected; none at a start.
    prior : of the shape, where that is solved for. noise_px : of a corner per axis, which the prior is weighed by.
    unfolding : what keeps the lens from folding, where that was needed.
    """

    model: LensModel
    intrinsics: np.ndarray
    poses: np.ndarray
    directions: np.ndarray
    residuals_px: tuple[np.ndarray, ...] = ()
    shape: np.ndarray = field(default_factory=lambda: np.zeros(SHAPE))
    prior: ShapePrior | None = None
    noise_px: float = _USUAL_NOISE_PX
    unfolding: Unfolding | None = None

    @staticmethod
    def start(model: LensModel, intrinsics: np.ndarray, poses: np.ndarray, square_pixels: bool = False) -> Bundle:
        """Before anything is solved, the board flat."""
        return Bundle(model, intrinsics, poses, free_directions(model, square_pixels))

    @property
    def poses_only(self) -> Bundle:
        """The same with nothing but the poses to be solved for."""
        return replace(self, directions=self.directions[:, :0])

    def freed(self, square_pixels: bool, prior: ShapePrior | None = None) -> Bundle:
        """The same with intrinsics to be solved for, and the board's shape where it has a prior."""
        free = free_directions(self.model, square_pixels, prior is not None)
        shape = np.zeros(SHAPE) if prior is None else self.shape
        noise_px = max(self.sigma_px, _LEAST_NOISE_PX) if self.residuals_px else self.noise_px
        intrinsics = self.intrinsics.copy()
        if square_pixels:
            intrinsics[:2] = intrinsics[:2].mean()
        return replace(self, intrinsics=intrinsics, directions=free, shape=shape, prior=prior, noise_px=noise_px)

    def moved(self, shared: np.ndarray, poses: np.ndarray) -> Bundle:
        """By steps of intrinsics and shape (4 + k + 5,), and of the poses (V, 6) as in `rows`."""
        turned = Rotation.from_rotvec(poses[:, :3]) * Rotation.from_rotvec(self.poses[:, :3])
        return replace(
            self,
            intrinsics=self.intrinsics + shared[:-SHAPE],
            poses=np.hstack([turned.as_rotvec(), self.poses[:, 3:] + poses[:, 3:]]),
            shape=self.shape + shared[-SHAPE:],
        )

    def prior_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (m,) px of the shape's prior in reweighted least squares, negative derivatives (m, 4 + k + 5)."""
        size = len(self.intrinsics)
        if self.prior is None:
            return np.zeros(0), np.zeros((0, size + SHAPE))
        residuals, slopes = self.prior.rows(self.shape)
        return self.noise_px * residuals, self.noise_px * np.pad(np.diag(slopes), ((0, 0), (size, 0)))

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


def free_directions(model: LensModel, square_pixels: bool = False, shape: bool = False) -> np.ndarray:
    """(4 + k + 5, p) what is solved for: intrinsics, fx and fy as one with square pixels, then the board's shape."""
    size = 4 + model.distortion_count
    unit = np.eye(size + SHAPE)
    rest = [2, 3, *(4 + index for index in model.free), *(range(size, size + SHAPE) if shape else ())]
    focal = unit[:, :1] + unit[:, 1:2] if square_pixels else unit[:, :2]
    return np.hstack([focal, unit[:, rest]])


def refine(
    start: Bundle, observations: Sequence[Observation], rules: Rules = CONVERGED, robust: bool = False
) -> Bundle:
    """Levenberg–Marquardt on the reprojection error; robust : by Cauchy's loss, so gross errors do not pull."""
    own = np.repeat([view.weight for view in observations], [len(view.pixels) for view in observations])

    def reweighted(residuals_px: np.ndarray) -> np.ndarray:
        return own**2 * cauchy_weights(own * np.linalg.norm(residuals_px, axis=1))

    weights = own**2
    if robust:
        weights = reweighted(rows(start, observations)[0])
        for _ in range(_REWEIGHTINGS):
            before, system = weights, _descended(start, observations, weights, _FEW_STEPS)
            start = system.bundle
            weights = reweighted(system.residuals_px)
            if np.abs(weights - before).max() < _CONVERGED_WEIGHTS:
                break
    system = _descended(start, observations, weights, rules)
    return replace(system.bundle, residuals_px=tuple(np.split(system.residuals_px, system.bounds[1:-1])))


def polished(bundle: Bundle, observations: Sequence[Observation]) -> Bundle:
    """Converged to a millionth of the deviations: what is reported must not show where a descent ended."""
    sizes = sum(view.pixels.size for view in observations) - bundle.directions.shape[1] - 6 * len(observations)
    return refine(bundle, observations, replace(_POLISH, tolerance=_STANDSTILL**2 / max(sizes, 1)))


def residuals_px(bundle: Bundle, observations: Sequence[Observation]) -> list[np.ndarray]:
    """Per view (N, 2), observed minus projected, of any corners of the bundle's views."""
    residuals, _, _, bounds = rows(bundle, observations)
    return np.split(residuals, bounds[1:-1])


class _System(NamedTuple):
    """The normal equations at a bundle; the last row and column of `total` and `coupling` are the residuals'."""

    bundle: Bundle
    residuals_px: np.ndarray
    bounds: np.ndarray
    cost: float
    total: np.ndarray
    coupling: np.ndarray
    poses: np.ndarray


def _descended(bundle: Bundle, observations: Sequence[Observation], weights: np.ndarray, rules: Rules) -> _System:
    """The least cost of the corners with weights (N,), and of what keeps the lens from folding."""

    def linearised(bundle: Bundle) -> _System:
        residuals, by_shared, by_pose, bounds = rows(bundle, observations)
        columns = np.concatenate([by_shared @ bundle.directions, residuals[..., None], by_pose], axis=-1)
        blocks = view_products(columns * np.sqrt(weights)[:, None, None], bounds)
        total = blocks[:, :-6, :-6].sum(axis=0)
        if bundle.unfolding is not None:
            lacking, by_lens = bundle.unfolding.rows(bundle.model, bundle.intrinsics)
            held = np.column_stack([by_lens @ bundle.directions[:-SHAPE], lacking])
            total = total + held.T @ held
        cost, coupling, poses = float(total[-1, -1]), blocks[:, -6:, :-6], blocks[:, -6:, -6:]
        if bundle.prior is not None:
            off, by_shape = bundle.prior_rows()
            held = np.column_stack([by_shape @ bundle.directions, off])
            total, cost = total + held.T @ held, cost + bundle.noise_px**2 * bundle.prior.loss(bundle.shape)
        return _System(bundle, residuals, bounds, cost, total, coupling, poses)

    def step(system: _System, damping: float) -> tuple[np.ndarray, float]:
        damped = system.total + damping * np.diag(np.append(np.diag(system.total)[:-1], 0.0))
        reduced, through = schur_complement(damped, system.coupling, system.poses * (1.0 + damping * np.eye(6)))
        shared = solve_scaled(reduced[:-1, :-1], reduced[:-1, -1])
        poses = through[..., -1] - through[..., :-1] @ shared
        promise = float(system.total[:-1, -1] @ shared + np.sum(system.coupling[..., -1] * poses))
        return np.concatenate([shared, poses.ravel()]), promise

    def moved(system: _System, step: np.ndarray) -> _System:
        directions = system.bundle.directions
        shared, poses = np.split(step, [directions.shape[1]])
        return linearised(system.bundle.moved(directions @ shared, poses.reshape(-1, 6)))

    return levenberg_marquardt(linearised(bundle), step, moved, rules).at
