"""Which lens model? The simplest that predicts views it has not seen as well as the best does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .bundle import Bundle, Observation, free_directions, lens_covariance, refine
from .lens_models import LENS_MODELS, LensModel, is_monotonic
from .lens_start import fit_lens

CANDIDATES = ("none", "radial", "opencv4", "opencv5", "fisheye", "rational")
"""What `auto` compares, from simple to rich. Thin-prism and tilted lenses must be asked for by name."""

_FOLDS = 5
_ITERATIONS = 20  # from a start that is all but the answer
_WORTH = 0.01
_MONOTONIC_MAY_COST = 1.1


@dataclass(frozen=True, eq=False)
class Candidate:
    """How one lens model does.

    Attributes
    ----------
    model : its name. free_parameters : of the lens, focal lengths and principal point included.
    rms_px : over the corners it was fitted to. held_out_rms_px : over views that only had their poses fitted.
    monotonic : whether it maps the whole picture without folding.
    """

    model: str
    free_parameters: int
    rms_px: float
    held_out_rms_px: float
    monotonic: bool


def choose_lens(
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    square_pixels: bool = False,
    known: dict[str, Bundle] | None = None,
) -> tuple[LensModel, tuple[Candidate, ...]]:
    """The lens model that the views ask for, and the comparison it rests on.

    Each model is fitted to four fifths of the views and tested on the rest, whose poses alone are solved for. Taken is
    the first in order of complexity whose held-out error is within one standard error (over views), or 1 %, of the
    best. A model that folds inside the picture is passed over unless every other is 10 % worse; one that the views
    leave open is left out.
    """
    known = {} if known is None else known
    errors, candidates = {}, []
    for name in CANDIDATES:
        model = LENS_MODELS[name]
        bundle = fit_lens(model, observations, image_size, square_pixels, known)
        if lens_covariance(model, bundle, observations, free_directions(model, square_pixels)) is None:
            continue
        errors[name] = _held_out_squares(model, bundle, observations, square_pixels)
        candidates.append(
            Candidate(
                name,
                free_directions(model, square_pixels).shape[1],
                bundle.rms_px,
                _rms(errors[name], observations),
                is_monotonic(model, bundle.intrinsics, image_size),
            )
        )
    chosen = _simplest_good(candidates, errors) if candidates else CANDIDATES[0]
    return LENS_MODELS[chosen], tuple(candidates)


def _rms(squares: np.ndarray, observations: Sequence[Observation]) -> float:
    return float(np.sqrt(squares.sum() / sum(len(view.pixels) for view in observations)))


def _held_out_squares(
    model: LensModel, bundle: Bundle, observations: Sequence[Observation], square_pixels: bool
) -> np.ndarray:
    """(V,) sum of squared distances of each view's corners, px², under a lens fitted without that view."""
    squares = np.zeros(len(observations))
    directions = free_directions(model, square_pixels)
    folds = min(_FOLDS, len(observations))
    for fold in range(folds):
        held = np.arange(len(observations)) % folds == fold
        seen = [view for view, out in zip(observations, held, strict=True) if not out]
        unseen = [view for view, out in zip(observations, held, strict=True) if out]
        lens = refine(model, bundle.intrinsics, bundle.poses[~held], seen, directions, iterations=_ITERATIONS)
        tested = refine(model, lens.intrinsics, bundle.poses[held], unseen, directions[:, :0], iterations=_ITERATIONS)
        squares[held] = [np.sum(residual**2) for residual in tested.residuals_px]
    return squares


def _simplest_good(candidates: Sequence[Candidate], errors: dict[str, np.ndarray]) -> str:
    least = min(candidate.held_out_rms_px for candidate in candidates)
    monotonic = [c for c in candidates if c.monotonic and c.held_out_rms_px <= _MONOTONIC_MAY_COST * least]
    allowed = monotonic or list(candidates)
    best = min(allowed, key=lambda candidate: candidate.held_out_rms_px)
    for candidate in allowed:
        excess = errors[candidate.model] - errors[best.model]
        standard_error = np.sqrt(len(excess)) * np.std(excess, ddof=1)
        if excess.sum() <= standard_error or candidate.held_out_rms_px <= (1.0 + _WORTH) * best.held_out_rms_px:
            return candidate.model
    return best.model
