"""A step of the wizard: how far it is, and whether a picture is good for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.wizard.sources.picture import Picture
from vbaa_calib.wizard.state.session_state import SessionState

ENOUGH = "enough, more will not help"


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
