"""A step of the wizard: how far it is, and whether a picture is good for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vbaa_calib.calibrate.faults.views import resolution_changed
from vbaa_calib.core.errors import Diagnosis, InputError
from vbaa_calib.core.images import read_picture
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.quality.hints import picture_hints, wrong_board
from vbaa_calib.detect.quality.screen import LEAST_CORNERS

from .session_state import SessionState, still_of
from .sources import Picture


@dataclass(frozen=True)
class Number:
    """A number against its goal, in words with units. `met` is None where there is no goal."""

    label: str
    value: str
    goal: str | None = None
    met: bool | None = None


@dataclass(frozen=True, eq=False)
class Target:
    """Where to show the board next: outline (4, 2) px as printed from top left, clockwise."""

    outline_px: np.ndarray
    words: str


@dataclass(frozen=True, eq=False)
class Progress:
    """How far a step is. enough : more pictures will not help. usable : the step may be closed as it is."""

    seen: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    next: str = ""
    enough: bool = False
    usable: bool = False
    numbers: tuple[Number, ...] = ()
    target: Target | None = None
    diagnoses: tuple[Diagnosis, ...] = ()


@dataclass(frozen=True, eq=False)
class PictureCheck:
    """Whether a picture is good for a step.

    refusal : why it is not taken; empty where it is. words : what it shows, for the log.
    corners_px : (N, 2) corners of the board. ids : (N,) theirs. hints : what could be better.
    closeness : to the suggested pose, 0..1; None where none is suggested. closer : what to change.
    """

    refusal: str = ""
    corners_px: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    hints: tuple[Diagnosis, ...] = ()
    words: str = ""
    closeness: float | None = None
    closer: str = ""
    ids: np.ndarray = field(default_factory=lambda: np.zeros(0, int))


Readings = Mapping[str, float]
"""What was read with a picture, SI."""


@dataclass(frozen=True)
class Step:
    """A step. check : whether a picture is good, None where it takes none; readings are None for a live preview."""

    name: str
    title: str
    what: str
    why: str
    progress: Callable[[SessionState], Progress]
    check: Callable[[SessionState, Picture, Readings | None], PictureCheck] | None = None


def counted(number: int, word: str) -> str:
    """ "1 picture", "2 pictures"."""
    return f"{number} {word}{'' if number == 1 else 's'}"


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
        seen = state.observe(still_of(step, path, readings), step, read_picture(path, picture.data))
    except InputError as error:
        jig = "" if state.taken(step) else "; or the answers about the jig are wrong, so that it is sought elsewhere"
        return PictureCheck(f"{error.what}; shoot it again with the antenna lit and wholly in view{jig}")
    return PictureCheck(words=f"antenna seen at {len(seen.points_px)} points")
