"""How far a step is, as terminal and page show it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vbaa_calib.core.errors import Diagnosis


@dataclass(frozen=True)
class Number:
    """A number against its goal, in words with units. `met` is None where there is no goal."""

    label: str
    value: str
    goal: str = ""
    met: bool | None = None


@dataclass(frozen=True, eq=False)
class Target:
    """What to shoot next where it is a place for the board: outline (4, 2) px as printed from top left, clockwise."""

    outline_px: np.ndarray
    words: str


@dataclass(frozen=True, eq=False)
class Progress:
    """What was seen, what is missing, what to do next.

    Attributes
    ----------
    enough : more will not help. usable : the step may be closed as it is.
    """

    seen: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    next: str = ""
    enough: bool = False
    usable: bool = False
    numbers: tuple[Number, ...] = ()
    target: Target | None = None
    diagnoses: tuple[Diagnosis, ...] = ()


@dataclass(frozen=True, eq=False)
class Judged:
    """One picture: whether it is good for this step.

    Attributes
    ----------
    refusal : why it is not taken; empty where it is. corners_px : (N, 2) what was found of the board, ids : (N,) which.
    hints : what could be better. words : what it shows, for the log.
    closeness : to the pose that is wanted, 0..1, and what to change; None where none is wanted.
    """

    refusal: str = ""
    corners_px: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    hints: tuple[Diagnosis, ...] = ()
    words: str = ""
    closeness: float | None = None
    closer: str = ""
    ids: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
