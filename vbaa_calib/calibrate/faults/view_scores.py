"""What each view of a solved set says of one more parameter of its own, the pose and the lens eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.board_flex import observations_of
from vbaa_calib.calibrate.lens.bundle import FLEX, Stack, State, free_directions, rows
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.detect.board.corners import BoardView

_OPEN = 1e-9


@dataclass(frozen=True, eq=False)
class OwnScores:
    """Scores and information of a parameter that every one of V views has to itself, to first order.

    Attributes
    ----------
    score : (V,) what each view pulls with, px². Its covariance is the residuals' variance times `information`.
    information : (V, V) px², the poses and all that the views share eliminated.
    """

    score: np.ndarray
    information: np.ndarray

    @cached_property
    def whitened(self) -> tuple[np.ndarray, np.ndarray]:
        """(R, V) map W and (R,) W s: independent, of the residuals' variance; W maps a contrast h to W⁺ᵀ h."""
        values, vectors = np.linalg.eigh(self.information)
        kept = values > _OPEN * max(float(values[-1]), 1e-300)
        root = np.sqrt(values[kept])
        return (vectors[:, kept] * root).T, (vectors[:, kept] / root).T @ self.score


@dataclass(frozen=True, eq=False)
class SetScores:
    """A solved set, linearised: what is left of the derivatives once every view's pose is taken out.

    Attributes
    ----------
    names : of the V views used, in the order given.
    residuals : (2N,) px, observed less projected. own : (2N, E) derivatives by parameters a view has to itself:
        logarithm of the focal length, cx px, cy px, and relative length of the board along its y.
    basis : (2N, p) orthonormal, of what the views share: lens and bend of the board.
    bounds : (V + 1,) first row of each view.
    focal_px : fx, fy. variance_px2 : of the residuals, per axis.
    """

    names: tuple[str, ...]
    residuals: np.ndarray
    own: np.ndarray
    basis: np.ndarray
    bounds: np.ndarray
    focal_px: tuple[float, float]
    variance_px2: float

    FOCAL, CENTRE_X, CENTRE_Y, ASPECT = range(4)

    def common(self, parameter: int) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives (2N,) by a parameter that all views have alike, and the residuals (2N,) px: what is left of both
        once all that the views share anyway is taken out."""
        both = np.stack([self.own[:, parameter], self.residuals], axis=1)
        both = both - self.basis @ (self.basis.T @ both)
        return both[:, 0], both[:, 1]

    def of(self, parameter: int) -> OwnScores:
        """Of one of the own parameters."""
        column, basis = self.own[:, parameter], self.basis
        left = self.residuals - basis @ (basis.T @ self.residuals)
        starts = self.bounds[:-1]
        shared = np.add.reduceat(basis * column[:, None], starts, axis=0)
        information = np.diag(np.add.reduceat(column**2, starts)) - shared @ shared.T
        return OwnScores(np.add.reduceat(column * left, starts), information)


def set_scores(views: Sequence[BoardView], solution: LensSolution, spec: BoardSpec) -> SetScores | None:
    """Linearise a solved set over the good corners of the views used; None where they are too few to say anything.

    views : in the order taken, the solution's among them by name. The bend of the board counts as open, whether the
    lens was solved with it or not: a print that is not flat must not pass for something else.
    """
    used = {view.name: view for view in solution.views}
    chosen = [view for view in views if view.name in used]
    if len({view.name for view in chosen}) < len(chosen) or len(chosen) < 2:
        return None
    model = LENS_MODELS[solution.model]
    kept = [~np.isin(view.ids, used[view.name].outlier_ids) for view in chosen]
    observations = [one.picked(mask) for one, mask in zip(observations_of(chosen, spec), kept, strict=True)]
    stack = Stack.of(observations)
    flex, intrinsics = solution.board_flex, solution.camera.parameters
    poses = np.array([used[view.name].T_camera_board.vector for view in chosen])
    sagittas = flex.sagittas_m if flex.used else np.zeros(FLEX)
    residuals, by_shared, by_pose = rows(model, State(np.concatenate([intrinsics, sagittas]), poses), stack)
    directions = free_directions(model, square_pixels=bool(intrinsics[0] == intrinsics[1]), flex=True)
    rotations = Rotation.from_rotvec(poses[:, :3]).as_matrix()
    own = np.stack(
        [
            by_shared[..., 0] * intrinsics[0] + by_shared[..., 1] * intrinsics[1],
            by_shared[..., 2],
            by_shared[..., 3],
            np.einsum("nij,nj->ni", by_pose[..., 3:], rotations[stack.view, :, 1] * stack.points_m[:, 1:2]),
        ],
        axis=-1,
    )
    every = np.concatenate([by_shared @ directions, own, residuals[..., None]], axis=-1)
    left = []
    for first, last in zip(stack.bounds[:-1], stack.bounds[1:], strict=True):
        pose, _ = np.linalg.qr(by_pose[first:last].reshape(-1, 6))
        flat = every[first:last].reshape(2 * (last - first), -1)
        left.append(flat - pose @ (pose.T @ flat))
    flat = np.vstack(left)
    basis = _orthonormal(flat[:, : directions.shape[1]])
    freedom = len(flat) - basis.shape[1] - 6 * len(chosen)
    if freedom <= 0 or not np.isfinite(flat).all():
        return None
    rest = flat[:, -1] - basis @ (basis.T @ flat[:, -1])
    return SetScores(
        tuple(view.name for view in chosen),
        flat[:, -1],
        flat[:, directions.shape[1] : -1],
        basis,
        2 * stack.bounds,
        (float(intrinsics[0]), float(intrinsics[1])),
        float(rest @ rest) / freedom,
    )


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    """(n, r) orthonormal basis of what columns (n, p) span, whatever their scales."""
    norms = np.linalg.norm(columns, axis=0)
    vectors, values, _ = np.linalg.svd(columns[:, norms > 0.0] / norms[norms > 0.0], full_matrices=False)
    return vectors[:, values > _OPEN * values[:1]]
