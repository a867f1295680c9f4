"""What pictures of the antenna have in common, free or loaded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from vbaa_calib.calibrate.faults.variety import resolution_changed
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import picture_from_bytes
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.quality.hints import picture_hints, wrong_board
from vbaa_calib.detect.quality.screen import LEAST_CORNERS
from vbaa_calib.wizard.sources.offered import Offered
from vbaa_calib.wizard.state.progress import Judged
from vbaa_calib.wizard.state.session_state import Known, still_of


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


def found_antenna(known: Known, step: str, offered: Offered, readings: Mapping[str, float] | None) -> Judged:
    """A picture of the antenna, and whether the antenna is found in it.

    readings : SI, those of the session's table; None for a live preview, which is not searched.
    """
    size = offered.image.shape[1], offered.image.shape[0]
    first = known.image_size
    changed = None if first is None else resolution_changed(size, first)
    if changed is not None:
        return Judged(str(changed), hints=(changed,))
    if readings is None:
        return Judged()
    path = Path(offered.name)
    try:
        seen = known.observe(still_of(step, path, readings), step, picture_from_bytes(offered.data, path))
    except InputError as error:
        jig = "" if known.taken(step) else "; or what was said of the jig is wrong, so that it is looked for elsewhere"
        return Judged(f"{error.what}; shoot it again with the antenna lit and wholly in view{jig}")
    return Judged(words=f"antenna seen at {len(seen.points_px)} points")
