"""Whether a picture shows what a step needs: the board, or the antenna."""

from __future__ import annotations

from pathlib import Path

from vbaa_calib.calibrate.faults.variety import resolution_changed
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import picture_from_bytes
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.quality.hints import picture_hints, wrong_board
from vbaa_calib.detect.quality.screen import LEAST_CORNERS
from vbaa_calib.wizard.sources.picture import Picture
from vbaa_calib.wizard.state.session_state import SessionState, still_of

from .step import PictureCheck, Readings


def check_board(state: SessionState, picture: Picture, live: bool) -> tuple[BoardView, PictureCheck]:
    """The board in a picture, and whether it is good. live : a preview, without the slow search for another board."""
    image = picture.image
    view = detect_corners(image, state.board, picture.name)
    changed = None if state.image_size is None else resolution_changed(view.image_size, state.image_size)
    if changed is not None:
        return view, PictureCheck(str(changed), view.corners_px, (changed,), ids=view.ids)
    hints = list(picture_hints(image, view, state.board))
    if not live and len(view.ids) < LEAST_CORNERS:
        other = wrong_board(image, view, state.board)
        hints = hints if other is None else [other, *hints]
    refusal = next((str(hint) for hint in hints if hint.grave), "")
    if not refusal and len(view.ids) < LEAST_CORNERS:
        refusal = f"{len(view.ids)} corners of the board are seen; show more of it"
    return view, PictureCheck(refusal, view.corners_px, tuple(hints), f"{len(view.ids)} corners", ids=view.ids)


def check_antenna(step: str, state: SessionState, picture: Picture, readings: Readings | None) -> PictureCheck:
    """Whether the antenna is found in a picture; a live preview is not searched."""
    height, width = picture.image.shape
    changed = None if state.image_size is None else resolution_changed((width, height), state.image_size)
    if changed is not None:
        return PictureCheck(str(changed), hints=(changed,))
    if readings is None:
        return PictureCheck()
    path = Path(picture.name)
    try:
        seen = state.observe(still_of(step, path, readings), step, picture_from_bytes(picture.data, path))
    except InputError as error:
        jig = "" if state.taken(step) else "; or the answers about the jig are wrong, so that it is sought elsewhere"
        return PictureCheck(f"{error.what}; shoot it again with the antenna lit and wholly in view{jig}")
    return PictureCheck(words=f"antenna seen at {len(seen.points_px)} points")
