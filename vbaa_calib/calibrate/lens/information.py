"""What the corners say of what all views share: view by view, the poses eliminated; and from it the covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vbaa_calib.core.least_squares import without_own

from .bundle import FLEX, Bundle, Observation, rows

_OPEN = 1e-10


@dataclass(frozen=True, eq=False)
class Information:
    """The reduced least-squares problem at a solution, in coordinates z (p,) in which all views together have unit
    information. To first order everything that the views say, alone or in groups, follows from it without a new solve.

    half : (4 + k + 2, p) change of intrinsics and sagittas for a unit of each z.
    blocks : (V, p, p) information of each view, gradients : (V, p) what it pulls with, squares : (V,) its squared
        residuals, px²; its own pose eliminated.
    roots : (V, p + 1, p + 1) triangular factors R of the views' own problems: the first p columns, rᵀr of which is the
        information, then the residuals. Sums of information lose half the digits, stacked factors do not.
    prior : (p, p) information of what holds the lens from folding. counts : (V,) corner coordinates of each view.
    """

    half: np.ndarray
    blocks: np.ndarray
    gradients: np.ndarray
    squares: np.ndarray
    roots: np.ndarray
    prior: np.ndarray
    counts: np.ndarray

    @property
    def variance_px2(self) -> float:
        """Of the residuals, per axis."""
        freedom = self.counts.sum() - self.half.shape[1] - 6 * len(self.counts)
        return float(self.squares.sum()) / max(float(freedom), 1.0)

    @property
    def covariance(self) -> np.ndarray:
        """(4 + k + 2, 4 + k + 2) of intrinsics and sagittas, poses marginalised, scaled by the residual variance.

        What holds the lens from folding is left out: it is no measurement.
        """
        return self.variance_px2 * self.half @ self.half.T


def information(bundle: Bundle, observations: Sequence[Observation]) -> Information | None:
    """At a solution over these corners; None where the views leave a free parameter open."""
    counts = np.array([view.pixels.size for view in observations])
    if counts.sum() <= bundle.directions.shape[1] + 6 * len(observations):
        return None
    residuals, by_shared, by_pose, bounds = rows(bundle, observations)
    left = without_own(by_shared @ bundle.directions, by_pose, bounds)
    jacobian = np.vstack(left)
    norms = np.linalg.norm(jacobian, axis=0)
    if not np.all(np.isfinite(norms)) or not np.all(norms > 0.0):
        return None
    _, values, basis = np.linalg.svd(np.linalg.qr(jacobian / norms, mode="r"), full_matrices=False)
    if values[-1] < _OPEN * values[0]:
        return None
    free = (basis.T / values) / norms[:, None]
    half = bundle.directions @ free
    by_view = [flat @ free for flat in left]
    own = [residual.ravel() for residual in np.split(residuals, bounds[1:-1])]
    held = np.zeros((0, half.shape[1]))
    if bundle.unfolding is not None:
        held = bundle.unfolding.rows(bundle.model, bundle.intrinsics)[1] @ half[:-FLEX]
    return Information(
        half=half,
        blocks=np.array([flat.T @ flat for flat in by_view]),
        gradients=np.array([flat.T @ residual for flat, residual in zip(by_view, own, strict=True)]),
        squares=np.array([residual @ residual for residual in own]),
        roots=np.array([_root(flat, residual) for flat, residual in zip(by_view, own, strict=True)]),
        prior=held.T @ held,
        counts=counts,
    )


def _root(flat: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """(p + 1, p + 1) triangular factor of rows (N, p) and their residuals (N,)."""
    factor = np.zeros((flat.shape[1] + 1,) * 2)
    upper = np.linalg.qr(np.column_stack([flat, residual]), mode="r")
    factor[: len(upper)] = upper
    return factor
