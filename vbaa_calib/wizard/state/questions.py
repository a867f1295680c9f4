"""What the wizard asks. Each question is a prompt, a flag and an entry of the answers file, by the same key."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from vbaa_calib.core.errors import InputError

Answers = Mapping[str, Any]
Value = Any


@dataclass(frozen=True)
class Question:
    """One question.

    Attributes
    ----------
    key : `antenna_length_mm` is `--antenna-length-mm` and `antenna_length_mm:`.
    step : which step asks it. words : the question. why : what it is good for.
    kind : number, numbers, choice, yesno or text. unit : of a number.
    default : taken when nothing is typed; None: there is none.
    low, high : the range of a number. choices : of a choice. length : of numbers, 0 for any.
    needed : whether it is asked, given the answers so far.
    """

    key: str
    step: str
    words: str
    why: str = ""
    kind: str = "number"
    unit: str = ""
    default: Value = None
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    length: int = 0
    needed: Callable[[Answers], bool] = lambda answers: True

    @property
    def flag(self) -> str:
        """On the command line."""
        return "--" + self.key.replace("_", "-")

    def read(self, given: object, where: object = None) -> Value:
        """The answer that was typed, written or clicked, checked. Raises InputError saying what is expected."""
        try:
            return _READERS[self.kind](self, given)
        except (TypeError, ValueError, OverflowError) as error:
            what = f"{self.key} is {_short(given)}: {error}"
            raise InputError(what, where=where, remedy=self._expected()) from None

    def _expected(self) -> str:
        expected = {
            "number": f"give a number{self._unit()}{self._range()}",
            "numbers": f"give {self.length or 'some'} numbers{self._unit()}{self._range()}, commas between them",
            "choice": f"give one of {', '.join(self.choices)}",
            "yesno": "give yes or no",
            "text": f"give a text: {self.words}",
        }
        return expected[self.kind]

    def _unit(self) -> str:
        return f" in {self.unit}" if self.unit else ""

    def _range(self) -> str:
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f" from {self.low:g} to {self.high:g}"
        return ""

    def to_dict(self) -> dict[str, Any]:
        """What a page needs to ask it."""
        names = ("key", "words", "why", "kind", "unit", "default")
        return {name: getattr(self, name) for name in names} | {"choices": list(self.choices)}


def _short(given: object) -> str:
    if given is None:
        return "empty"
    try:
        text = repr(given)
    except ValueError:  # Python writes out no number of thousands of digits
        text = "a number of thousands of digits"
    return text if len(text) <= 60 else text[:57] + "..."


def shown(value: Value) -> str:
    """An answer as one types it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(shown, value))
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def _as_number(given: object) -> float:
    """A finite number. Raises ValueError; 1_0 and true are slips, not numbers; a decimal comma is named."""
    if isinstance(given, bool) or not isinstance(given, int | float | str):
        raise ValueError("that is not a number")
    if isinstance(given, str):
        text = given.strip()
        if "_" in text or not text.isascii():
            raise ValueError("that is not a number")
        if text.count(",") == 1 and "." not in text:
            raise ValueError("the decimal sign is a point")
        given = float(text) if _looks_like_number(text) else math.nan
        if math.isnan(given):
            raise ValueError("that is not a number" + _unit_typed(text))
    value = float(given)
    if not math.isfinite(value):
        raise ValueError("that is not a finite number")
    return value


def _looks_like_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _unit_typed(text: str) -> str:
    head = text.rstrip("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ%° ")
    return ", leave the unit out" if head != text and _looks_like_number(head) else ""


def _read_number(question: Question, given: object) -> float:
    value = _as_number(given)
    if not question.low <= value <= question.high:
        raise ValueError(f"{value:g}{' ' + question.unit if question.unit else ''} cannot be")
    return value


def _read_numbers(question: Question, given: object) -> list[float]:
    parts = given
    if isinstance(given, str):
        parts = [part for part in given.replace(";", ",").split(",") if part.strip()]
        parts = given.split() if len(parts) == 1 else parts
    elif isinstance(given, int | float) and not isinstance(given, bool):
        parts = [given]
    if not isinstance(parts, list | tuple):
        raise ValueError("those are not numbers")
    if not parts or (question.length and len(parts) != question.length):
        raise ValueError(f"those are {len(parts)} numbers")
    return [_read_number(question, part) for part in parts]


def _read_choice(question: Question, given: object) -> str:
    text = str(given).strip().lower() if isinstance(given, str | int | float) else ""
    fitting = [choice for choice in question.choices if choice.lower() == text]
    if not fitting and text:
        fitting = [choice for choice in question.choices if choice.lower().startswith(text)]
    if len(fitting) != 1:
        raise ValueError("that is none of them" if not fitting else f"that may be {' or '.join(fitting)}")
    return fitting[0]


def _read_yesno(question: Question, given: object) -> bool:
    if isinstance(given, bool):
        return given
    text = str(given).strip().lower()
    if text in ("y", "yes", "true"):
        return True
    if text in ("n", "no", "false"):
        return False
    raise ValueError("that is neither")


def _read_text(question: Question, given: object) -> str:
    if not isinstance(given, str) or not given.strip():
        raise ValueError("that is no text")
    if "\0" in given or len(given) > 4096:
        raise ValueError("that cannot be")
    return given.strip()


_READERS: Mapping[str, Callable[[Question, object], Value]] = {
    "number": _read_number,
    "numbers": _read_numbers,
    "choice": _read_choice,
    "yesno": _read_yesno,
    "text": _read_text,
}
