"""All that a set of pictures of the board says of itself once the lens is solved."""

from __future__ import annotations

from collections.abc import Sequence

from targets.board import BoardSpec

from ...detect.corners import BoardView
from ...diagnosis import Diagnosis
from ..intrinsics import LensSolution
from .aspect import print_stretched
from .focus import centre_moved, focus_changed
from .scores import set_scores
from .variety import little_variety, poorly_covered


def view_set_diagnoses(views: Sequence[BoardView], solution: LensSolution, spec: BoardSpec) -> list[Diagnosis]:
    """Faults of the set, the grave ones first: focus, the lens' centre, the print, what is missing.

    views : in the order taken; those that the solution does not use are passed over.
    """
    names = {view.name for view in solution.views}
    used = [view for view in views if view.name in names]
    if not used:
        return []
    scores = set_scores(used, solution, spec)
    judged = [] if scores is None else [focus_changed(scores), centre_moved(scores)]
    if scores is not None and not any(judged):
        # a lens that did not stay the same shifts the print's aspect by several of its standard deviations
        judged.append(print_stretched(scores))
    found = [one for one in (*judged, poorly_covered(used)) if one is not None]
    return sorted([*found, *little_variety(used, solution, spec)], key=lambda one: not one.grave)
