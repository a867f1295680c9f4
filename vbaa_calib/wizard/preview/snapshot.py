"""What the wizard shows on its page, and what the page sends back: the contract of the two."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, NotRequired, TypedDict

KINDS = ("answer", "take", "enough", "back", "redo", "drop", "quit")
"""The commands that a person can give on the page."""


class StepLine(TypedDict):
    """One step in the list at the left; `status` is "done", "now", "todo" or "skipped"."""

    name: str
    title: str
    status: str
    note: str


class Number(TypedDict):
    """A number against its goal, both as they are to be read, with their unit: "0.14 mm"; None is shown as "–"."""

    label: str
    value: str | float | None
    goal: str | float | None
    met: NotRequired[bool | None]
    """Whether the goal is reached; None or absent: not told."""


class Step(TypedDict):
    """The step at hand; `what`, `why`: a line each; `enough`: it can be left, `next` says if more would help."""

    name: str
    title: str
    what: str
    why: str
    seen: list[str]
    missing: list[str]
    next: str
    enough: bool
    numbers: list[Number]


class Question(TypedDict):
    """What is asked now; `kind` is "number", "choice", "text" or "yesno".

    The answer is {key: value}: a bool for "yesno", one of `choices` for "choice", the text for "text". For "number"
    it is a float, or the text as it was typed where that is no plain number ("120 g"): the wizard judges it.
    """

    key: str
    words: str
    why: str
    kind: str
    unit: str | None
    default: float | str | bool | None
    choices: list[str]
    problem: NotRequired[str | None]
    """Why the answer before was not accepted."""


class Coverage(TypedDict):
    """How often each cell of the picture has held corners: `counts` by rows, top row first."""

    columns: int
    rows: int
    counts: list[list[int]]


class Hint(TypedDict):
    """`Diagnosis.to_dict()`."""

    name: str
    words: str
    remedy: str
    grave: bool


class Live(TypedDict):
    """The camera's picture and what is drawn over it; pixels count from the centre of the first one.

    `suggested_px` is the board's outline in the order top left, top right, bottom right, bottom left *of the board as
    printed*, so that its first edge can be marked "top". `hold` is the share of holding still, 0..1.
    """

    image_size: list[int]
    corners_px: list[list[float]]
    coverage: Coverage | None
    suggested_px: list[list[float]] | None
    suggestion: str
    closeness: float | None
    hold: float
    hints: list[Hint]


class Verdict(TypedDict):
    """How it ended; `level` is "holds", "look at" or "does not hold", as in the check report."""

    level: str
    words: str


class State(TypedDict):
    """All that the page shows, but for the picture itself."""

    session: str
    steps: list[StepLine]
    step: Step
    question: Question | None
    live: Live | None
    log: list[str]
    finished: bool
    report: str | None
    """An HTML file that stands alone; the page links to it and the server serves it, and no other file."""
    can: NotRequired[list[str]]
    """The commands of `KINDS` that make sense now. Absent: all but "take", which then needs a live picture."""
    verdict: NotRequired[Verdict | None]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The wizard at one moment.

    Attributes
    ----------
    state : a `State`; NumPy numbers and arrays and paths may stand in it.
    jpeg : the camera's picture as a JPEG file, of the size that `live` names (or scaled); None: nothing to show.
    """

    state: State | Mapping[str, Any]
    jpeg: bytes | None = None


@dataclass(frozen=True)
class Command:
    """What a person wants.

    Attributes
    ----------
    kind : one of `KINDS`.
    value : {key: value} for "answer", else None.
    seen : number of the snapshot that was on the page (as `Preview.show` returned it); None: not told.
    """

    kind: str
    value: object = None
    seen: int | None = None


def encoded(state: Mapping[str, Any]) -> bytes:
    """The state as strict JSON; what is not finite becomes null, lone surrogates of file names a question mark.

    Raises
    ------
    TypeError : something in it has no JSON form.
    """
    text = json.dumps(_plain(state), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.encode("utf-8", errors="replace")


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, PurePath):
        return str(value)
    if hasattr(value, "tolist"):  # NumPy's scalars and arrays
        return _plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, (bytes, bytearray)):
        return [_plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no form on the page")
