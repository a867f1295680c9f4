"""What to make of a lens, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .board_flex import BoardFlex
from .bundle import Bundle
from .lens_choice import Candidate

_VAGUE_FOCAL = 0.02
_COVERED = 0.5


def verdict(chosen: Candidate | None, comparison: Sequence[Candidate], flex: BoardFlex, warnings: Sequence[str]) -> str:
    """Two to five sentences: is the lens to be trusted, why this model, do halves agree, is the board flat."""
    sentences = ["Look at the warnings before you trust this lens." if warnings else "This lens can be trusted."]
    if chosen is not None:
        sentences.append(_why(chosen, comparison))
        sentences.append(_halves(chosen))
    bent = f"{1e3 * flex.sagittas_m[0]:+.2f} mm along x, {1e3 * flex.sagittas_m[1]:+.2f} mm along y"
    sentences.append(
        f"The board is bent ({bent}); the lens was solved with that." if flex.used else "The board counts as flat."
    )
    return " ".join(sentences)


def _why(chosen: Candidate, comparison: Sequence[Candidate]) -> str:
    if len(comparison) < 2:
        return (
            f"The lens model {chosen.model} was given; it misses views that it has not seen by "
            f"{chosen.held_out_rms_px:.3f} px rms."
        )
    best = min(comparison, key=lambda candidate: candidate.held_out_rms_px)
    if best.model == chosen.model:
        return f"{chosen.model} predicts views that it has not seen best of all ({chosen.held_out_rms_px:.3f} px rms)."
    errors = f"{chosen.held_out_rms_px:.3f} px rms against {best.held_out_rms_px:.3f} px"
    if not best.monotonic:
        return f"{chosen.model} was taken ({errors}) since {best.model} folds inside the picture."
    if not best.halves_agree:
        return f"{chosen.model} was taken ({errors}) since {best.model} differs between halves of the views."
    return f"{chosen.model} is the simplest that predicts unseen views as well as {best.model} does ({errors})."


def _halves(chosen: Candidate) -> str:
    if chosen.halves is None:
        return "There are too few views to compare halves of them."
    agree = "agree within their uncertainty" if chosen.halves_agree else "differ by more than their uncertainty"
    return f"Two halves of the views {agree} ({chosen.halves:.1f} predicted deviations)."


def lens_warnings(
    chosen: Candidate | None,
    model: str,
    monotonic: bool,
    bundle: Bundle,
    covariance: np.ndarray,
    pixels: np.ndarray,
    image_size: tuple[int, int],
) -> tuple[str, ...]:
    """What the user ought to know: folds, disagreement, a vague focal length, poor coverage.

    pixels : (N, 2) all good corners. covariance : (4 + k, 4 + k) of the intrinsics.
    """
    warnings = []
    if not monotonic:
        warnings.append(f"the {model} lens folds inside the picture: directions near its border are not to be trusted")
    if chosen is not None and not chosen.halves_agree:
        warnings.append(
            f"two halves of the views give lenses that differ by {chosen.halves:.1f} times what is predicted: "
            "the uncertainty is larger than stated by about as much"
        )
    focal_std = np.sqrt(np.diag(covariance)[:2]) / bundle.intrinsics[:2]
    if focal_std.max() > _VAGUE_FOCAL:
        warnings.append(
            f"the focal length is known to {100 * focal_std.max():.1f} % only: "
            "add views of the board tilted by 30 to 45 degrees"
        )
    share = _covered_share(pixels, image_size)
    if share < _COVERED:
        warnings.append(
            f"the corners cover {100 * share:.0f} % of the picture: add views with the board near its border"
        )
    return tuple(warnings)


def _covered_share(pixels: np.ndarray, image_size: tuple[int, int]) -> float:
    """Share of an 8 x 6 grid over the picture in which a corner was seen."""
    cells = np.clip((pixels + 0.5) / np.array(image_size) * (8, 6), 0, (7, 5)).astype(int)
    return len(np.unique(cells, axis=0)) / 48
