"""What pictures of the board have in common, in whichever step they are taken."""

from __future__ import annotations

from ...calibrate.diagnose_views import resolution_changed
from ...detect.corners import BoardView, detect_corners
from ...detect.picture_hints import picture_hints, wrong_board
from ...detect.view_quality_screen import LEAST_CORNERS
from ..known import Known
from ..progress import Judged
from ..sources.offered import Offered


def judged(known: Known, offered: Offered, live: bool) -> tuple[BoardView, Judged]:
    """A picture of the board, and whether it is good.

    live : a preview: the slow search for another board is left out.
    """
    image = offered.image
    view = detect_corners(image, known.board, offered.name)
    first = known.image_size
    changed = None if first is None else resolution_changed(view.image_size, first)
    if changed is not None:
        return view, Judged(str(changed), view.corners_px, (changed,), ids=view.ids)
    hints = list(picture_hints(image, view, known.board))
    other = None if live or len(view.ids) >= LEAST_CORNERS else wrong_board(image, view, known.board)
    if other is not None:
        hints.insert(0, other)
    grave = next((hint for hint in hints if hint.grave), None)
    refusal = "" if grave is None else str(grave)
    if not refusal and len(view.ids) < LEAST_CORNERS:
        refusal = f"{len(view.ids)} corners of the board are seen; show more of it"
    return view, Judged(refusal, view.corners_px, tuple(hints), f"{len(view.ids)} corners", ids=view.ids)
