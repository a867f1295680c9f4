"""Do two halves of the views tell of the same lens? Their difference over the picture, in units of the predicted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.stats import chi2

from .corner_stack import FLEX
from .lens_information import Information
from .lens_models import LensModel, camera_of
from .lens_uncertainty import compensate, pixel_grid, projection_jacobian

AGREE = 1e-4
"""Halves of good data differ by so much that chance explains it with less than this about once in ten thousand."""

OPEN = 1e6
"""A half leaves the lens open where one of its directions is seen so many times worse than another, of those that all
views see alike."""

_LEAST_VIEWS = 6
_GRID = (9, 7)


@dataclass(frozen=True)
class Halves:
    """How far the lenses of two halves of the views differ.

    Attributes
    ----------
    deviations : the difference over its predicted deviation, rms over the picture; about 1 when all is well.
    p_value : chance of this much. One weak direction of the lens may make up all of the difference, so that 2.5
        deviations are sometimes much and sometimes little.
    """

    deviations: float
    p_value: float


def compare_halves(
    model: LensModel, intrinsics: np.ndarray, known: Information, image_size: tuple[int, int]
) -> Halves | None:
    """The views are dealt out in turn; each half's lens is one Gauss–Newton step from that of all views.

    intrinsics : (4 + k,) of all views. What a turn of the camera explains is left out, and so is what holds
    the lens from folding. None with under 6 views, or when
    a half leaves the lens open.
    """
    if len(known.squares) < _LEAST_VIEWS:
        return None
    difference, covariance = np.zeros(known.half.shape[1]), np.zeros_like(known.prior)
    for first, sign in ((0, 1.0), (1, -1.0)):
        size = known.half.shape[1]
        _, factor = np.linalg.qr(known.roots[first::2].reshape(-1, size + 1))
        own, pull = factor[:size, :size], factor[:size, size]
        freedom = known.counts[first::2].sum() - size - 6 * len(known.counts[first::2])
        if freedom <= 0 or np.linalg.cond(own) > OPEN:
            return None
        inverse = solve_triangular(own, np.eye(size))
        variance = factor[size, size] ** 2 / freedom
        difference += sign * (inverse @ pull)
        covariance += variance * (inverse @ inverse.T)
    camera, pixels = camera_of(model, intrinsics, image_size), pixel_grid(image_size, _GRID)
    jacobian = compensate(camera, pixels, projection_jacobian(camera, pixels)) @ known.half[:-FLEX]
    jacobian = jacobian[np.isfinite(jacobian).all(axis=(-1, -2))]
    if not len(jacobian):
        return None
    predicted = np.trace(jacobian @ covariance @ np.swapaxes(jacobian, -1, -2), axis1=-2, axis2=-1)
    seen = jacobian / np.sqrt(predicted * len(jacobian))[:, None, None]
    form = np.einsum("nki,nkj->ij", seen, seen)
    square = float(difference @ form @ difference)
    # a sum of squares of unequal share, by the chi-squared law with its mean, which is 1, and its variance
    freedom = 1.0 / float(np.sum((form @ covariance) * (form @ covariance).T))
    return Halves(float(np.sqrt(square)), float(chi2.sf(square * freedom, freedom)))
