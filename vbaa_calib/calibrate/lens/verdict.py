"""Verdict on a lens, used by the terminal, camera.json, pages and exit codes alike."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from vbaa_calib.core.errors import Diagnosis

from .board_shape import BoardShape
from .choice import Candidate
from .settings import LensSettings

if TYPE_CHECKING:
    from .intrinsics import LensSolution


def judged(solution: LensSolution, views_px: Sequence[np.ndarray], view_scatter: float) -> LensSolution:
    """The solution with the verdict and reasons that follow from it alone.

    views_px : corners (N, 2) of each view used. view_scatter : as `Information` has it.
    """
    reasons = (*_why(solution), *_split_half(solution.chosen), _board(solution.board_shape))
    return solution.with_diagnoses(_diagnoses(solution, views_px, view_scatter), reasons)


def _diagnoses(solution: LensSolution, views_px: Sequence[np.ndarray], view_scatter: float) -> Iterator[Diagnosis]:
    """Diagnoses against the lens, unordered."""
    chosen, count = solution.chosen, len(views_px)
    if solution.rms_inliers_px > LensSettings.most_rms_px:
        words = f"the corners miss the lens by {solution.rms_inliers_px:.1f} px rms, outliers left out"
        remedy = "see that board and counts are as described, and all pictures of one camera at one focus"
        yield Diagnosis("lens_misses", words, remedy, "wrong")
    if count < LensSettings.halved_views:
        words = f"the lens rests on {count} views: they fit almost any lens, and halves of them cannot be compared"
        missing = f"add {LensSettings.halved_views - count} or more views"
        yield Diagnosis("few_views", words, f"{missing}, the board tilted by 30 to 45 degrees, each time another way")
    if view_scatter >= LensSettings.scattered:
        words = (
            f"the views contradict each other {view_scatter:.1f} times as much as their corners scatter; the "
            "stated uncertainty counts that"
        )
        remedy = (
            "hold board and camera still and the focus fixed, with more light (a rolling shutter bends a moving "
            "board); or choose another --lens-model"
        )
        yield Diagnosis("views_scatter", words, remedy)
    if not solution.monotonic:
        words = f"the {solution.model} lens folds inside the picture: directions near its border are not to be trusted"
        yield Diagnosis("lens_folds", words, "show the board near the border, too, or choose another --lens-model")
    if chosen is not None and chosen.halves is not None and not chosen.split_half_agrees:
        words = f"two halves of the views give lenses that differ by {chosen.halves:.1f} times what is predicted"
        remedy = "the uncertainty is larger than stated by about as much: add views, or choose another --lens-model"
        yield Diagnosis("split_half_differs", words, remedy)
    assert solution.camera.covariance is not None
    focal_std = float((np.sqrt(np.diag(solution.camera.covariance)[:2]) / solution.camera.parameters[:2]).max())
    if focal_std > LensSettings.vague_focal:
        words = f"the focal length is known to {100 * focal_std:.1f} % only"
        yield Diagnosis("focal_vague", words, "add views of the board tilted by 30 to 45 degrees")
    # of an 8 x 6 grid over the picture, the cells in which a corner was seen
    places = (np.concatenate(views_px) + 0.5) / np.array(solution.camera.image_size) * (8, 6)
    share = len(np.unique(np.clip(places, 0, (7, 5)).astype(int), axis=0)) / 48
    if share < LensSettings.covered:
        words = f"the corners cover {100 * share:.0f} % of the picture"
        yield Diagnosis("little_covered", words, "add views with the board near its border")


def _why(solution: LensSolution) -> list[str]:
    """Sentences that explain the choice of the lens model."""
    chosen = solution.chosen
    if chosen is None:
        return []
    name, misses = chosen.model, f"misses held-out views by {chosen.held_out_rms_px:.3f} px rms"
    if len(solution.comparison) < 2:
        return [f"The lens model {name} was given; it {misses}."]
    if chosen.expected_error_px is None:
        return [f"{name} {misses}."]
    expected = f"expected error ({chosen.expected_error_px:.2f} px)"
    best = min(solution.comparison, key=lambda candidate: candidate.held_out_rms_px)
    others = [candidate for candidate in solution.comparison if candidate.model != name]
    less = [one for one in others if (one.expected_error_px or np.inf) < chosen.expected_error_px]
    words = f"The lens model {name} was taken for its {expected}"
    if not less:
        words = f"Of the lens models, {name} has the smallest {expected}"
    if best.model == name:
        words += f", and predicts held-out views best ({chosen.held_out_rms_px:.3f} px rms)"
    else:
        words += f"; it {misses}, {best.model} by {best.held_out_rms_px:.3f} px"
    why = [f"; {one.model} {one.passed_over}" for one in others if one.passed_over and (one is best or one in less)]
    return [f"{words}{''.join(why)}."]


def _split_half(chosen: Candidate | None) -> list[str]:
    if chosen is None:
        return []
    if chosen.halves is None:
        return ["There are too few views to compare halves of them."]
    agree = "agree within" if chosen.split_half_agrees else "differ by more than"
    return [f"Two halves of the views {agree} their uncertainty ({chosen.halves:.1f} predicted deviations)."]


def _board(shape: BoardShape) -> str:
    unseen = "how large its squares are, no picture of it shows: measure them"
    if not shape.findings:
        return f"The board counts as flat and square; {unseen}."
    return f"The board is {', '.join(shape.findings)}; the lens was solved with that; {unseen}."
