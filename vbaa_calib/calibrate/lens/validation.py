"""Cross-validation of a lens: errors on held-out views, and the difference between two halves of the views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vbaa_calib.core.robust import chi_square_p

from .bundle import CONVERGED, FLEX, Bundle, Observation, refine
from .information import Information
from .models import LensModel, camera_of
from .uncertainty import compensate, pixel_grid, projection_jacobian

_FOLDS = 5
_LITTLE_MORE = 1.1
_NEAR = replace(CONVERGED, iterations=20, tolerance=1e-5)  # from a start that is all but the answer


def held_out_squares(bundle: Bundle, observations: Sequence[Observation], known: Information) -> np.ndarray:
    """(V,) sum of squared distances of each view's corners, px², under a lens fitted without a fifth of the views.

    The pose of a held-out view is solved for, lens and board are not. The lens is one Gauss–Newton step from the
    solution over all views; where held-out errors are much larger than the residuals it is solved anew.
    """
    stepped = _stepped_squares(known)
    if stepped.sum() <= _LITTLE_MORE * known.squares.sum():
        return stepped
    return solved_squares(bundle, observations)


def _stepped_squares(known: Information) -> np.ndarray:
    """(V,) as `held_out_squares`, to first order."""
    folds = min(_FOLDS, len(known.squares))
    group = np.arange(len(known.squares)) % folds
    squares = known.squares.copy()
    for fold in range(folds):
        held = group == fold
        rest = known.blocks[~held].sum(axis=0) + known.prior
        step = np.linalg.lstsq(rest, -known.gradients[held].sum(axis=0), rcond=1e-12)[0]
        squares[held] += step @ known.blocks[held] @ step - 2.0 * known.gradients[held] @ step
    return squares


def solved_squares(bundle: Bundle, observations: Sequence[Observation]) -> np.ndarray:
    """(V,) as `held_out_squares`, each lens solved for."""
    squares = np.zeros(len(observations))
    folds = min(_FOLDS, len(observations))
    for fold in range(folds):
        held = np.arange(len(observations)) % folds == fold
        seen = [view for view, out in zip(observations, held, strict=True) if not out]
        unseen = [view for view, out in zip(observations, held, strict=True) if out]
        lens = refine(replace(bundle, poses=bundle.poses[~held]), seen, _NEAR)
        tested = refine(replace(lens.poses_only, poses=bundle.poses[held]), unseen, _NEAR)
        squares[held] = [np.sum(residual**2) for residual in tested.residuals_px]
    return squares


def rms_over(squares: np.ndarray, observations: Sequence[Observation]) -> float:
    """Root mean square distance, px, out of each view's sum of squares (V,)."""
    return float(np.sqrt(squares.sum() / sum(len(view.pixels) for view in observations)))


def excess_in_errors(squares: np.ndarray, reference: np.ndarray) -> float:
    """By how many standard errors, over views, squared errors (V,) exceed those of a reference."""
    excess = squares - reference
    standard_error = np.sqrt(len(excess)) * np.std(excess, ddof=1)
    return float(excess.sum() / standard_error) if standard_error > 0.0 else 0.0


AGREE = 1e-4
"""Halves of good data differ by so much that chance explains it with less than this about once in ten thousand."""

_OPEN = 1e6
"""A half leaves the lens open where one of its directions is seen so many times worse than another, of those that all
views see alike."""

_LEAST_VIEWS = 6
_GRID = (9, 7)


def compare_split_half(
    model: LensModel, intrinsics: np.ndarray, known: Information, image_size: tuple[int, int]
) -> tuple[float | None, float | None]:
    """How far the lenses of two halves of the views differ over the predicted deviation, and the chance of this much.

    rms over the picture; about 1 when all is well. One weak direction of the lens may make up all of the difference, so
    that 2.5 deviations are sometimes much and sometimes little. The views are dealt out in turn; each half's lens is
    one Gauss–Newton step from that of all views, intrinsics (4 + k,). What a turn of the camera explains is left out,
    and so is what holds the lens from folding. None with under 6 views, or when a half leaves the lens open.
    """
    if len(known.squares) < _LEAST_VIEWS:
        return None, None
    difference, covariance = np.zeros(known.half.shape[1]), np.zeros_like(known.prior)
    for first, sign in ((0, 1.0), (1, -1.0)):
        size = known.half.shape[1]
        _, factor = np.linalg.qr(known.roots[first::2].reshape(-1, size + 1))
        own, pull = factor[:size, :size], factor[:size, size]
        freedom = known.counts[first::2].sum() - size - 6 * len(known.counts[first::2])
        if freedom <= 0 or np.linalg.cond(own) > _OPEN:
            return None, None
        inverse = np.linalg.inv(own)
        variance = factor[size, size] ** 2 / freedom
        difference += sign * (inverse @ pull)
        covariance += variance * (inverse @ inverse.T)
    camera, pixels = camera_of(model, intrinsics, image_size), pixel_grid(image_size, _GRID)
    jacobian = compensate(camera, pixels, projection_jacobian(camera, pixels)) @ known.half[:-FLEX]
    jacobian = jacobian[np.isfinite(jacobian).all(axis=(-1, -2))]
    if not len(jacobian):
        return None, None
    predicted = np.trace(jacobian @ covariance @ np.swapaxes(jacobian, -1, -2), axis1=-2, axis2=-1)
    seen = jacobian / np.sqrt(predicted * len(jacobian))[:, None, None]
    form = np.einsum("nki,nkj->ij", seen, seen)
    square = float(difference @ form @ difference)
    # a sum of squares of unequal share, by the chi-squared law with its mean, which is 1, and its variance
    freedom = 1.0 / float(np.sum((form @ covariance) * (form @ covariance).T))
    return float(np.sqrt(square)), chi_square_p(square * freedom, freedom)
