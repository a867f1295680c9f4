"""Where a person meets the wizard: a terminal, a page, or nobody."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.state.progress import Judged, Progress
from vbaa_calib.wizard.state.questions import Question, Value
from vbaa_calib.wizard.steps.step import Step

COMMANDS = {
    "enough": "close this step with what it has",
    "take": "take the live picture now",
    "drop": "take back the last picture",
    "back": "to the question before, or the step before",
    "redo": "start this step again, the old pictures go aside",
    "quit": "stop here; run the wizard again to go on",
    "help": "this list",
}


@dataclass(frozen=True)
class Command:
    """What a person wants besides answering."""

    kind: str


class Interrupted(Exception):
    """A command came where an answer was asked for."""

    def __init__(self, command: Command) -> None:
        super().__init__(command.kind)
        self.command = command


@dataclass(frozen=True, eq=False)
class Live:
    """A live picture: (H, W) uint8, what was found in it, how long it is held still (0..1), and words about that."""

    image: np.ndarray
    judged: Judged
    held: float
    words: str = ""


class Desk(Protocol):
    """Where questions are asked and progress is shown."""

    interactive: bool
    """Whether somebody is there to answer."""

    def ask(self, question: Question, facts: Mapping[str, Any]) -> Value:
        """An answer, checked. Raises Interrupted for a command, InputError where nobody is there."""
        ...

    def greet(self, paragraphs: Sequence[str]) -> None:
        """The first words."""
        ...

    def begin(self, step: Step) -> None:
        """A step begins."""
        ...

    def show(self, step: Step, progress: Progress) -> None:
        """How far the step is."""
        ...

    def working(self, words: str) -> None:
        """Something takes a while; what is told next stands in its place."""
        ...

    def live(self, step: Step, live: Live) -> None:
        """A live picture."""
        ...

    def say(self, line: str) -> None:
        """A line for the log."""
        ...

    def wrong(self, line: str) -> None:
        """Something is wrong, and what is asked next is about it."""
        ...

    def commands(self) -> list[Command]:
        """What came in since the last call; does not wait."""
        ...

    def done(self, document: Mapping[str, Any], report: str) -> None:
        """The end. document : check.json's content. report : its page."""
        ...

    def close(self) -> None:
        """Nothing more is told or asked."""
        ...


class Nobody:
    """No terminal: answers come from flags and files, progress goes to stderr as lines, nothing ever waits."""

    interactive = False

    def ask(self, question: Question, facts: Mapping[str, Any]) -> Value:
        """The default, or InputError."""
        if question.default is not None:
            return question.default
        words = question.words.format_map(facts)
        raise InputError(
            f"{question.key} is not answered ({words})",
            remedy=f"give {question.flag}, or {question.key}: in --answers FILE, or run it in a terminal",
        )

    def greet(self, paragraphs: Sequence[str]) -> None:
        """Nobody is there."""

    def begin(self, step: Step) -> None:
        """A heading."""
        say(f"{step.title}")

    def show(self, step: Step, progress: Progress) -> None:
        """The step's numbers."""
        for line in lines_of(progress):
            say(f"  {line}")

    def working(self, words: str) -> None:
        """Nobody waits."""

    def live(self, step: Step, live: Live) -> None:
        """Nobody watches."""

    def say(self, line: str) -> None:
        """To stderr."""
        say(f"  {line}")

    def wrong(self, line: str) -> None:
        """To stderr."""
        self.say(line)

    def commands(self) -> list[Command]:
        """None."""
        return []

    def done(self, document: Mapping[str, Any], report: str) -> None:
        """The verdict."""
        say(document["words"])

    def close(self) -> None:
        """Nothing is open."""


def lines_of(progress: Progress) -> list[str]:
    """A step's progress in lines for a terminal, what is wrong before what is doubtful, what is next last."""
    lines = [f"seen      {line}" for line in progress.seen]
    for number in progress.numbers:
        goal = f" (goal {number.goal}{', reached' if number.met else ''})" if number.goal else ""
        lines.append(f"          {number.label}: {number.value}{goal}")
    lines += [f"missing   {line}" for line in progress.missing]
    for diagnosis in sorted(progress.diagnoses, key=lambda one: not one.grave):
        lines.append(f"{'WRONG' if diagnosis.grave else 'look at':9s} {diagnosis.words}")
        lines.append(f"          → {diagnosis.remedy}")
    if progress.next:
        lines.append(f"next      {progress.next}")
    return lines
