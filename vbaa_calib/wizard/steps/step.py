"""What a step is to the flow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from vbaa_calib.wizard.sources.offered import Offered
from vbaa_calib.wizard.state.progress import Judged, Progress
from vbaa_calib.wizard.state.session_state import Known


class Judge(Protocol):
    """Says whether a picture is good for a step. `readings` are those typed with it; None for a live preview."""

    def __call__(self, known: Known, offered: Offered, readings: Mapping[str, float] | None) -> Judged: ...


class Look(Protocol):
    """Says how far a step is."""

    def __call__(self, known: Known) -> Progress: ...


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes
    ----------
    what, why : a line each. judge : None where the step takes no pictures.
    """

    name: str
    title: str
    what: str
    why: str
    look: Look
    judge: Judge | None = None
