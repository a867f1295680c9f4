"""How well a lens predicts views that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .bundle import Bundle, refine
from .corner_stack import Observation
from .lens_information import Information
from .lens_models import LensModel

_FOLDS = 5
_LITTLE_MORE = 1.1
_ITERATIONS, _ROUGHLY = 20, 1e-5  # from a start that is all but the answer


def held_out_squares(
    model: LensModel,
    bundle: Bundle,
    observations: Sequence[Observation],
    directions: np.ndarray,
    known: Information,
) -> np.ndarray:
    """(V,) sum of squared distances of each view's corners, px², under a lens fitted without a fifth of the views.

    The pose of a held-out view is solved for, lens and board are not. One Gauss–Newton step from the solution over all
    views, known, gives the lens without them; where that says that the views are missed by much more than when they are
    seen, the step may be too long to be trusted and the lens is solved anew.
    """
    stepped = stepped_squares(known)
    if stepped.sum() <= _LITTLE_MORE * known.squares.sum():
        return stepped
    return solved_squares(model, bundle, observations, directions)


def stepped_squares(known: Information) -> np.ndarray:
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


def solved_squares(
    model: LensModel, bundle: Bundle, observations: Sequence[Observation], directions: np.ndarray
) -> np.ndarray:
    """(V,) as `held_out_squares`, each lens solved for."""
    squares = np.zeros(len(observations))
    folds = min(_FOLDS, len(observations))
    for fold in range(folds):
        held = np.arange(len(observations)) % folds == fold
        seen = [view for view, out in zip(observations, held, strict=True) if not out]
        unseen = [view for view, out in zip(observations, held, strict=True) if out]
        lens = _refined(model, bundle, bundle.poses[~held], seen, directions)
        tested = _refined(model, lens, bundle.poses[held], unseen, directions[:, :0])
        squares[held] = [np.sum(residual**2) for residual in tested.residuals_px]
    return squares


def _refined(
    model: LensModel, start: Bundle, poses: np.ndarray, views: Sequence[Observation], directions: np.ndarray
) -> Bundle:
    return refine(
        model,
        start.intrinsics,
        poses,
        views,
        directions,
        iterations=_ITERATIONS,
        sagittas_m=start.sagittas_m,
        unfolding=start.unfolding,
        tolerance=_ROUGHLY,
    )


def rms_over(squares: np.ndarray, observations: Sequence[Observation]) -> float:
    """Root mean square distance, px, out of each view's sum of squares (V,)."""
    return float(np.sqrt(squares.sum() / sum(len(view.pixels) for view in observations)))


def excess_in_errors(squares: np.ndarray, reference: np.ndarray) -> float:
    """By how many standard errors, over views, squared errors (V,) exceed those of a reference."""
    excess = squares - reference
    standard_error = np.sqrt(len(excess)) * np.std(excess, ddof=1)
    return float(excess.sum() / standard_error) if standard_error > 0.0 else 0.0
