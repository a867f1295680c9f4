"""Where questions are asked and progress is shown: without a terminal here, with one in `terminal`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.state.questions import Question
from vbaa_calib.wizard.steps.step import PictureCheck, Progress, Step

COMMANDS = {
    "enough": "close this step with what it has",
    "take": "take the live picture now",
    "drop": "take back the last picture",
    "back": "to the question before, or the step before",
    "redo": "start this step again, the old pictures are set aside",
    "quit": "stop here; run the wizard again to go on",
    "help": "this list",
}


class Interrupted(Exception):
    """A command came where an answer was asked for."""

    def __init__(self, command: str) -> None:
        super().__init__(command)
        self.command = command


@dataclass(frozen=True, eq=False)
class LiveView:
    """A live picture: (H, W) uint8, what was found in it, how long it is held still (0..1), and words about that."""

    image: np.ndarray
    check: PictureCheck
    held: float
    words: str = ""


class Ui:
    """No terminal: answers come from flags and files, progress goes to stderr as lines, nothing ever waits."""

    interactive = False
    """Whether somebody is there to answer."""

    def ask(self, question: Question, facts: Mapping[str, Any] | None = None) -> Any:
        """An answer, checked. facts : what the question's words name.

        Raises Interrupted for a command, InputError where nobody is there and there is no default.
        """
        if question.default is not None:
            return question.default
        raise InputError(
            f"{question.key} is not answered ({question.words.format_map(facts or {})})",
            remedy=f"give {question.flag}, or {question.key}: in --answers FILE, or run it in a terminal",
        )

    def greet(self, paragraphs: Sequence[str]) -> None:
        """The first words."""

    def begin(self, step: Step) -> None:
        """A step begins."""
        say(step.title)

    def show(self, step: Step, progress: Progress) -> None:
        """How far the step is."""
        for line in progress_lines(progress):
            self.say(line)

    def working(self, words: str) -> None:
        """Something takes a while; the next line replaces this one."""

    def live(self, view: LiveView) -> None:
        """A live picture."""

    def say(self, line: str) -> None:
        """A line for the log."""
        say(f"  {line}")

    def wrong(self, line: str) -> None:
        """Something is wrong, and the next question is about it."""
        self.say(line)

    def commands(self) -> list[str]:
        """Commands since the last call; does not wait."""
        return []

    def done(self, document: Mapping[str, Any], report: str) -> None:
        """The end. document : check.json's content. report : its page."""
        say(document["words"])

    def close(self) -> None:
        """Nothing more is shown or asked."""


def progress_lines(progress: Progress) -> list[str]:
    """A step's progress for a terminal: what is wrong before what is doubtful, what is next last."""
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
