"""What the wizard asks. Each question is a prompt, a flag and an entry of the answers file, by the same key."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from vbaa_calib.core.errors import InputError

Answers = Mapping[str, Any]
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_YES_NO = dict.fromkeys(("y", "yes", "true"), True) | dict.fromkeys(("n", "no", "false"), False)


@dataclass(frozen=True)
class Question:
    """One question. Its key `antenna_length_mm` is the flag `--antenna-length-mm` and `antenna_length_mm:` in a file.

    step : that asks it. why : what the answer is used for. kind : number, numbers, choice, yesno or text.
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
    default: Any = None
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    length: int = 0
    needed: Callable[[Answers], bool] = lambda answers: True

    @property
    def flag(self) -> str:
        """On the command line."""
        return "--" + self.key.replace("_", "-")

    def read(self, given: object, where: object = None) -> Any:
        """The answer that was typed, written or clicked, checked. Raises InputError saying what is expected."""
        readers = {"number": self._number, "numbers": self._numbers, "choice": self._choice}
        try:
            return readers.get(self.kind, _yesno if self.kind == "yesno" else _text)(given)
        except (TypeError, ValueError, OverflowError) as error:
            unit = f" in {self.unit}" if self.unit else ""
            if math.isfinite(self.low) and math.isfinite(self.high):
                unit += f" from {self.low:g} to {self.high:g}"
            expected = {
                "number": f"a number{unit}",
                "numbers": f"{self.length or 'some'} numbers{unit}, commas between them",
                "choice": f"one of {', '.join(self.choices)}",
                "yesno": "yes or no",
                "text": f"a text: {self.words}",
            }[self.kind]
            what = f"{self.key} is {_short(given)}: {error}"
            raise InputError(what, where=where, remedy=f"give {expected}") from None

    def _number(self, given: object) -> float:
        value = _as_number(given)
        if not self.low <= value <= self.high:
            raise ValueError(f"{value:g}{' ' + self.unit if self.unit else ''} cannot be")
        return value

    def _numbers(self, given: object) -> list[float]:
        parts = given
        if isinstance(given, str):
            parts = [part for part in given.replace(";", ",").split(",") if part.strip()]
            parts = given.split() if len(parts) == 1 else parts
        elif isinstance(given, int | float) and not isinstance(given, bool):
            parts = [given]
        if not isinstance(parts, list | tuple):
            raise ValueError("those are not numbers")
        if not parts or (self.length and len(parts) != self.length):
            raise ValueError(f"those are {len(parts)} numbers")
        return [self._number(part) for part in parts]

    def _choice(self, given: object) -> str:
        text = str(given).strip().lower() if isinstance(given, str | int | float) else ""
        fitting = [choice for choice in self.choices if choice.lower() == text]
        fitting = fitting or [choice for choice in self.choices if text and choice.lower().startswith(text)]
        if len(fitting) != 1:
            raise ValueError("that is none of them" if not fitting else f"that may be {' or '.join(fitting)}")
        return fitting[0]


def _short(given: object) -> str:
    try:
        text = "empty" if given is None else repr(given)
    except ValueError:  # Python writes out no number of thousands of digits
        text = "a number of thousands of digits"
    return text if len(text) <= 60 else text[:57] + "..."


def typed(value: Any) -> str:
    """An answer as one types it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(typed, value))
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def _as_number(given: object) -> float:
    """Raises ValueError; 1_0 and true are slips, not numbers; a decimal comma is named."""
    if isinstance(given, bool) or not isinstance(given, int | float | str):
        raise ValueError("that is not a number")
    if isinstance(given, str):
        given = given.strip()
        if "_" in given or not given.isascii():
            raise ValueError("that is not a number")
        if given.count(",") == 1 and "." not in given:
            raise ValueError("the decimal sign is a point")
        if not _NUMBER.fullmatch(given):
            with_unit = _NUMBER.match(given) and not re.search(r"\d", _NUMBER.sub("", given, count=1))
            raise ValueError("that is not a number" + (", leave the unit out" if with_unit else ""))
    if not math.isfinite(value := float(given)):
        raise ValueError("that is not a finite number")
    return value


def _yesno(given: object) -> bool:
    text = str(given).strip().lower()
    if text not in _YES_NO:
        raise ValueError("that is neither")
    return _YES_NO[text]


def _text(given: object) -> str:
    if not isinstance(given, str) or not given.strip():
        raise ValueError("that is no text")
    if "\0" in given or len(given) > 4096:
        raise ValueError("that cannot be")
    return given.strip()


STEPS = ("board", "lens", "plane", "noload", "loads", "sensor", "verdict")
PICTURES = {"lens": "for the lens", "plane": "for plane C", "noload": "of the free antenna", "loads": "of loads"}
"""Steps that take pictures, and of what those are."""
READINGS: Mapping[str, tuple[str, ...]] = {
    "sweep": ("pan_rad", "tilt_rad"),
    "noload": ("pan_rad", "tilt_rad", "moment_Nm"),
    "loads": ("pan_rad", "tilt_rad", "moment_Nm", "distance_m", "force_y_N", "force_z_N"),
}
"""Folder → what is read with each of its pictures."""


def keeps_jig(answers: Answers) -> bool:
    """Whether the jig is the one that came with the session, and no other was described."""
    return bool(answers.get("jig_given")) and "jig_translation_mm" not in answers


def _needed(only_if: Mapping[str, str], unless: str, answers: Answers) -> bool:
    known = keeps_jig(answers) if unless == "jig_kept" else answers.get(unless)
    return not known and all(answers.get(key) == value for key, value in only_if.items())


def _question(step: str, key: str, entry: dict[str, Any]) -> Question:
    low, high = map(float, entry.pop("range", ("-inf", "inf")))
    entry["choices"] = tuple(entry.get("choices", ()))
    kind = entry.pop("kind", "choice" if entry["choices"] else "number")
    needed = partial(_needed, entry.pop("if", {}), entry.pop("unless", ""))
    return Question(key, step, kind=kind, low=low, high=high, needed=needed, **entry)


_FILE = yaml.safe_load(Path(__file__).with_name("questions.yaml").read_text(encoding="utf-8"))
QUESTIONS = tuple(_question(step, key, entry) for step, entries in _FILE.items() for key, entry in entries.items())
BY_KEY: Mapping[str, Question] = {question.key: question for question in QUESTIONS}
_ELSEWHERE = "Where do the pictures of the step {} come from, if not from source?"
SOURCES = tuple(Question(f"{step}_source", step, _ELSEWHERE.format(step), kind="text") for step in PICTURES)
"""Never asked; flags and answers only."""
TABLES = tuple(
    Question(f"{step}_readings", step, f"CSV with what was read with each picture of the step {step}", kind="text")
    for step in ("plane", "noload", "loads")
)
"""Never asked as a whole; a picture's readings are asked one by one."""
BOARD_ANSWERS = (*_FILE["board"], "measure_x_mm", "measure_y_mm", "board_given")
"""What is known of the board; another board makes all of it void."""


def open_questions(step: str, answers: Answers) -> list[Question]:
    """What a step still has to ask, given the answers so far."""
    return [q for q in QUESTIONS if q.step == step and q.key not in answers and q.needed(answers)]
