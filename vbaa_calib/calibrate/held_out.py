"""How well a lens predicts views that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .bundle import Bundle, refine
from .corner_stack import Observation
from .lens_models import LensModel

_FOLDS = 5
_ITERATIONS = 20  # from a start that is all but the answer


def held_out_squares(
    model: LensModel, bundle: Bundle, observations: Sequence[Observation], directions: np.ndarray
) -> np.ndarray:
    """(V,) sum of squared distances of each view's corners, px², under a lens fitted without a fifth of the views.

    The pose of a held-out view is solved for, lens and board are not.
    """
    squares = np.zeros(len(observations))
    folds = min(_FOLDS, len(observations))
    for fold in range(folds):
        held = np.arange(len(observations)) % folds == fold
        seen = [view for view, out in zip(observations, held, strict=True) if not out]
        unseen = [view for view, out in zip(observations, held, strict=True) if out]
        lens = refine(
            model,
            bundle.intrinsics,
            bundle.poses[~held],
            seen,
            directions,
            iterations=_ITERATIONS,
            sagittas_m=bundle.sagittas_m,
            shrink_px2=bundle.shrink_px2,
        )
        tested = refine(
            model,
            lens.intrinsics,
            bundle.poses[held],
            unseen,
            directions[:, :0],
            iterations=_ITERATIONS,
            sagittas_m=lens.sagittas_m,
            shrink_px2=lens.shrink_px2,
        )
        squares[held] = [np.sum(residual**2) for residual in tested.residuals_px]
    return squares


def rms_over(squares: np.ndarray, observations: Sequence[Observation]) -> float:
    """Root mean square distance out of each view's sum."""
    return float(np.sqrt(squares.sum() / sum(len(view.pixels) for view in observations)))


def excess_in_errors(squares: np.ndarray, reference: np.ndarray) -> float:
    """By how many standard errors, over views, squared errors (V,) exceed those of a reference."""
    excess = squares - reference
    standard_error = np.sqrt(len(excess)) * np.std(excess, ddof=1)
    return float(excess.sum() / standard_error) if standard_error > 0.0 else 0.0
