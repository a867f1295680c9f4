"""Joint least squares over one lens and many board poses, with the poses eliminated view by view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .lens_models import PROJECTIONS, LensModel

_RELATIVE_DECREASE = 1e-13
_OPEN = 1e-10
_CAUCHY_PER_SIGMA = 2.385  # 95 % efficiency on normal noise


@dataclass(frozen=True, eq=False)
class Observation:
    """Corners of one view: board points (N, 3) m and their pixels (N, 2)."""

    points_m: np.ndarray
    pixels: np.ndarray


@dataclass(frozen=True, eq=False)
class Bundle:
    """A solution of the joint problem.

    Attributes
    ----------
    intrinsics : (4 + k,) fx, fy, cx, cy, distortion.
    poses : (V, 6) rotation vector rad and translation m, T_camera_board of each view.
    residuals_px : per view (N, 2), observed minus projected.
    """

    intrinsics: np.ndarray
    poses: np.ndarray
    residuals_px: tuple[np.ndarray, ...]

    @property
    def rms_px(self) -> float:
        """Root mean square distance between observed and projected corners, over all corners."""
        return float(np.sqrt(np.mean(np.concatenate([np.sum(r**2, axis=1) for r in self.residuals_px]))))

    @property
    def view_rms_px(self) -> np.ndarray:
        """(V,) the same, view by view."""
        return np.array([np.sqrt(np.mean(np.sum(r**2, axis=1))) for r in self.residuals_px])


def free_directions(model: LensModel, square_pixels: bool = False) -> np.ndarray:
    """(4 + k, p) columns span the intrinsics that are solved for; with square pixels fx and fy move as one."""
    size = 4 + model.distortion_count
    columns = [np.eye(size)[index] for index in (2, 3, *(4 + index for index in model.free))]
    focal = [np.eye(size)[0] + np.eye(size)[1]] if square_pixels else [np.eye(size)[0], np.eye(size)[1]]
    return np.stack([*focal, *columns], axis=1)


def refine(
    model: LensModel,
    intrinsics: np.ndarray,
    poses: np.ndarray,
    observations: Sequence[Observation],
    directions: np.ndarray,
    robust: bool = False,
    iterations: int = 300,
) -> Bundle:
    """Levenberg–Marquardt on the reprojection error from a start.

    Parameters
    ----------
    intrinsics : (4 + k,) start. poses : (V, 6) start.
    directions : (4 + k, p) from `free_directions`; p = 0 solves the poses alone.
    robust : weigh corners down by Cauchy's rule, so that gross errors do not pull.
    iterations : at most; a few are enough to tell good starts from bad ones.
    """
    intrinsics, poses = np.array(intrinsics, float), np.array(poses, float)
    weights = [np.ones(len(view.pixels)) for view in observations]
    for _ in range(6 if robust else 1):
        intrinsics, poses, system = _descend(model, intrinsics, poses, observations, weights, directions, iterations)
        if robust:
            weights = _cauchy_weights(system.residuals_px)
    return Bundle(intrinsics, poses, system.residuals_px)


@dataclass(frozen=True, eq=False)
class _System:
    """The normal equations in blocks: lens, poses, and what couples them; all weighted."""

    residuals_px: tuple[np.ndarray, ...]
    cost: float
    lens: np.ndarray
    lens_gradient: np.ndarray
    pose: np.ndarray
    pose_gradient: np.ndarray
    coupling: np.ndarray


def _linearise(
    model: LensModel,
    intrinsics: np.ndarray,
    poses: np.ndarray,
    observations: Sequence[Observation],
    weights: Sequence[np.ndarray],
    directions: np.ndarray,
) -> _System:
    project = PROJECTIONS[model.camera_model]
    count = directions.shape[1]
    lens, lens_gradient = np.zeros((count, count)), np.zeros(count)
    pose, pose_gradient = np.zeros((len(poses), 6, 6)), np.zeros((len(poses), 6))
    coupling = np.zeros((len(poses), count, 6))
    residuals, cost = [], 0.0
    for index, (view, weight) in enumerate(zip(observations, weights, strict=True)):
        pixels, by_intrinsics, by_pose = project(view.points_m, poses[index], intrinsics)
        residual = view.pixels - pixels
        root = np.sqrt(np.repeat(weight, 2))
        scaled, a, b = root * residual.ravel(), root[:, None] * (by_intrinsics @ directions), root[:, None] * by_pose
        lens += a.T @ a
        lens_gradient += a.T @ scaled
        pose[index], pose_gradient[index], coupling[index] = b.T @ b, b.T @ scaled, a.T @ b
        residuals.append(residual)
        cost += float(scaled @ scaled)
    return _System(tuple(residuals), cost, lens, lens_gradient, pose, pose_gradient, coupling)


def _step(system: _System, damping: float) -> tuple[np.ndarray, np.ndarray]:
    grow = 1.0 + damping
    pose = system.pose * (1.0 + damping * np.eye(6))
    through = np.linalg.solve(pose, np.swapaxes(system.coupling, 1, 2))
    own = np.linalg.solve(pose, system.pose_gradient[..., None])[..., 0]
    lens = system.lens + (grow - 1.0) * np.diag(np.diag(system.lens))
    reduced = lens - np.einsum("vpk,vkq->pq", system.coupling, through)
    gradient = system.lens_gradient - np.einsum("vpk,vk->p", system.coupling, own)
    lens_step = _solve_scaled(reduced, gradient)
    return lens_step, own - np.einsum("vkp,p->vk", through, lens_step)


def _solve_scaled(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    # coefficients differ by many orders of magnitude from focal lengths
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    return scale * np.linalg.lstsq(matrix * np.outer(scale, scale), scale * vector, rcond=1e-15)[0]


def _descend(
    model: LensModel,
    intrinsics: np.ndarray,
    poses: np.ndarray,
    observations: Sequence[Observation],
    weights: Sequence[np.ndarray],
    directions: np.ndarray,
    iterations: int,
) -> tuple[np.ndarray, np.ndarray, _System]:
    system = _linearise(model, intrinsics, poses, observations, weights, directions)
    damping = 1e-3
    for _ in range(iterations):
        try:
            lens_step, pose_step = _step(system, damping)
        except np.linalg.LinAlgError:
            damping *= 10.0
            continue
        new_intrinsics, new_poses = intrinsics + directions @ lens_step, poses + pose_step
        trial = _linearise(model, new_intrinsics, new_poses, observations, weights, directions)
        if np.isfinite(trial.cost) and trial.cost <= system.cost:
            decrease = system.cost - trial.cost
            intrinsics, poses, system = new_intrinsics, new_poses, trial
            damping = max(0.2 * damping, 1e-15)
            if decrease <= _RELATIVE_DECREASE * system.cost:
                break
        else:
            damping *= 8.0
            if damping > 1e12:
                break
    return intrinsics, poses, system


def _cauchy_weights(residuals_px: Sequence[np.ndarray]) -> list[np.ndarray]:
    distances = [np.linalg.norm(residual, axis=1) for residual in residuals_px]
    # the median length of a plane normal vector is 1.1774 standard deviations per axis
    sigma = max(float(np.median(np.concatenate(distances))) / 1.1774, 1e-9)
    return [1.0 / (1.0 + (distance / (_CAUCHY_PER_SIGMA * sigma)) ** 2) for distance in distances]


def lens_covariance(
    model: LensModel, bundle: Bundle, observations: Sequence[Observation], directions: np.ndarray
) -> np.ndarray | None:
    """(4 + k, 4 + k) covariance of the intrinsics, the poses marginalised, scaled by the residual variance.

    Zero for what is held fixed; None where the views leave a free parameter open.
    """
    freedom = sum(view.pixels.size for view in observations) - directions.shape[1] - 6 * len(observations)
    project, blocks = PROJECTIONS[model.camera_model], []
    for view, pose in zip(observations, bundle.poses, strict=True):
        _, by_intrinsics, by_pose = project(view.points_m, pose, bundle.intrinsics)
        # what the view's own pose cannot explain; by QR, for normal equations would lose half the digits
        basis, _ = np.linalg.qr(by_pose)
        by_lens = by_intrinsics @ directions
        blocks.append(by_lens - basis @ (basis.T @ by_lens))
    jacobian = np.vstack(blocks)
    norms = np.linalg.norm(jacobian, axis=0)
    if freedom <= 0 or not np.all(np.isfinite(norms)) or not np.all(norms > 0.0):
        return None
    _, values, rows = np.linalg.svd(jacobian / norms, full_matrices=False)
    if values[-1] < _OPEN * values[0]:
        return None
    half = directions @ ((rows.T / values) / norms[:, None])
    variance = float(sum(np.sum(residual**2) for residual in bundle.residuals_px)) / freedom
    return variance * half @ half.T
