"""How well an explanation fits: the points' scatter that it leaves, beside the scatter that the pictures have anyway."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...reprojection import robust_weights
from ..joint import noise_scale
from ..joint_given import Observation
from .rows import StillRows

DEGREE = 7
"""Of the smooth curve that any bent antenna is in the picture, kinks nearly included."""
FITS = 1.5
"""An explanation fits that leaves no more than this much of the pictures' own scatter."""
MOST_OF_IT = 0.15
"""Or no more than this part of the scatter that was to be explained: small motions are judged to first order."""
ROUNDS = 3


def own_scatter(observations: Sequence[Observation]) -> float:
    """Scatter of the points about a smooth curve of their own picture's, over their claimed deviations; no model in it.

    At least 0.2, as the joint solve's has it.
    """
    left = [_off_smooth(one) for one in observations if len(one.points_px) > 2 * DEGREE]
    return max(1.4826 * float(np.median(np.abs(np.concatenate(left)))), 0.2) if left else 0.2


def fits(left: float, own: float, before: float = 0.0) -> bool:
    """Whether a scatter that is left is the pictures' own, or little of what it was."""
    return bool(left <= max(FITS * own, MOST_OF_IT * before))


def scatter_after(rows: StillRows, columns: np.ndarray, prior_std: float) -> float:
    """The points' scatter, over their claimed deviations, once the residuals may move along columns (R, K) as well."""
    solution = rows.solution
    certain = solution.certain
    jacobian = np.hstack([solution.jacobian, rows.readings, columns])
    scale = np.linalg.norm(jacobian, axis=0)
    known = np.repeat([0.0, 1.0, prior_std**-2], [solution.jacobian.shape[1], rows.readings.shape[1], columns.shape[1]])
    weights, residuals = rows.factor, solution.residuals
    for _ in range(ROUNDS):
        scaled = jacobian / scale * weights[:, None]
        step = np.linalg.solve(scaled.T @ scaled + np.diag(known / scale**2), scaled.T @ (solution.residuals * weights))
        residuals = solution.residuals - jacobian @ (step / scale)
        weights = np.concatenate([robust_weights(residuals[:-certain]), np.ones(certain)])
    blocks = [residuals[span] for span in rows.points if span.stop > span.start]
    return noise_scale(blocks) * rows.joint.noise_scale


def _off_smooth(one: Observation) -> np.ndarray:
    """(N,) distances from the smooth curve, in claimed deviations."""
    centred = one.points_px - one.points_px.mean(axis=0)
    along, aside = (centred @ np.linalg.svd(centred, full_matrices=False)[2].T).T
    smooth = np.polynomial.Polynomial.fit(along, aside, DEGREE)
    slope = smooth.deriv()(along)
    freedom = np.sqrt(len(along) / (len(along) - DEGREE - 1))
    return freedom * (aside - smooth(along)) / np.hypot(1.0, slope) / one.sigma_px
