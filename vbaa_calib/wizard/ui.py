"""What the wizard displays and asks, and the interface of its views (terminal, page)."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vbaa_calib.core.console import say
from vbaa_calib.core.errors import Diagnosis, InputError

from .questions import Question, typed
from .steps import PictureCheck, Progress, Step

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
    """Raised when a command comes in reply to a question."""

    @property
    def command(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True, eq=False)
class LivePicture:
    """A live picture (H, W) uint8, its check, the fraction of the required rest that has passed, and a comment.

    live : of a stream; else the last one of a folder. drawn : the same in colour with what is drawn in it, of any size.
    """

    image: np.ndarray
    check: PictureCheck
    rested: float
    words: str = ""
    live: bool = True
    drawn: np.ndarray | None = None


class WizardView:
    """Displays a `Ui`. This base class, for runs without a user, writes lines to stderr and delivers no input."""

    def update(self, ui: Ui, change: str) -> None:
        """Display a change: greeting, step, progress, question, problem, answered, doing, live, line, verdict."""
        match change:
            case "step":
                say(ui.step.title if ui.step else "")
            case "progress":
                for line in ui.progress.lines:
                    say(f"  {line}")
            case "line":
                say(f"  {ui.lines[-1]}")
            case "verdict":
                say(ui.document["words"])

    def events(self, ui: Ui) -> Iterable[tuple[str, Any]]:
        """Input since the last call, without waiting: ("answer", the answer) or (command, None)."""
        return ()

    def close(self) -> None:
        """End the display."""


class Ui:
    """What is displayed and asked, the same in all views; any of them may answer.

    interactive : whether a user is there; else answers come from flags and files, and nothing waits.
    """

    def __init__(self, *views: WizardView, interactive: bool = False) -> None:
        self.views, self.interactive = views or (WizardView(),), interactive
        self.greeting: Sequence[str] = ()
        self.step: Step | None = None
        self.progress = Progress()
        self.question: Question | None = None
        self.words = self.problem = self.doing = self.report = ""
        self.picture: LivePicture | None = None
        self.lines: list[str] = []
        self.document: Mapping[str, Any] = {}
        self.usual: Sequence[str] = ()
        self.change: Callable[[str, str], bool] = lambda key, value: False
        """Changes an earlier answer; False if there is no such question."""

    def _changed(self, change: str, **fields: Any) -> None:
        vars(self).update(fields)
        for view in self.views:
            view.update(self, change)

    def ask(self, question: Question, facts: Mapping[str, Any] | None = None) -> Any:
        """Ask a question, with `facts` inserted in its words, until the answer is valid.

        Raises Interrupted for a command; InputError without a user and a default.
        """
        words, before = question.words.format_map(facts or {}), (self.question, self.words)
        if not self.interactive:
            if question.default is None:
                remedy = f"give {question.flag}, or {question.key}: in --answers FILE, or run it in a terminal"
                raise InputError(f"{question.key} is not answered ({words})", remedy=remedy)
            return question.default
        self._changed("question", question=question, words=words, doing="")
        try:
            while True:
                try:
                    return question.read(self._first_answer())
                except InputError as error:
                    problem = f"{error.what.removeprefix(f'{question.key} is ')}; {error.remedy}"
                    self._changed("problem", problem=problem)
        finally:
            self._changed("answered", question=before[0], words=before[1], problem="")

    def keeps(self, doubts: Sequence[Diagnosis]) -> bool:
        """Whether doubtful input is to be kept; asks the user if there is one."""
        for doubt in doubts:
            self.wrong(str(doubt))
        keep = Question("keep", "", "Keep this as it is?", kind="yesno", default="no")
        return bool(self.ask(keep)) if self.interactive else True

    def _first_answer(self) -> object:
        while True:
            for view in self.views:
                for command, entered in view.events(self):
                    if command != "answer":
                        raise Interrupted(command)
                    if self._is_change(entered):
                        continue
                    if view is not self.views[0]:
                        self.say(f"on the page: {typed(entered)}")
                    return entered
            time.sleep(0.03)

    def commands(self) -> list[str]:
        """Commands since the last call; does not wait."""
        commands = []
        for command, entered in [event for view in self.views for event in view.events(self)]:
            if command != "answer":
                commands.append(command)
            elif not self._is_change(entered):
                self.say(f"nothing is asked now: {typed(entered)}")
        return commands

    def _is_change(self, entered: object) -> bool:
        """Whether `key = value` was typed; if so the change is made."""
        found = re.fullmatch(r"\s*(\w+)\s*=\s*(\S.*)", entered) if isinstance(entered, str) else None
        return found is not None and self.change(*found.groups())

    def take_usual(self, lines: Sequence[str]) -> None:
        """Display as `key = value` the answers that were taken by default."""
        self.say(f"assumed; to change one, type it with another value: {'; '.join(lines)}")
        self._changed("usual", usual=[*self.usual, *lines])

    def greet(self, paragraphs: Sequence[str]) -> None:
        self._changed("greeting", greeting=paragraphs)

    def begin(self, step: Step) -> None:
        self._changed("step", step=step, progress=Progress(), question=None, picture=None, doing="")

    def show(self, step: Step, progress: Progress) -> None:
        self._changed("progress", step=step, progress=progress, doing="")

    def working(self, words: str) -> None:
        """Display what is being computed."""
        self._changed("doing", doing=words)

    def live(self, picture: LivePicture) -> None:
        self._changed("live", picture=picture)

    def say(self, line: str) -> None:
        self._changed("line", lines=[*self.lines[-59:], line])

    def wrong(self, line: str) -> None:
        """Log a problem, and display it with the next question, too."""
        self.problem = line
        self.say(line)

    def done(self, document: Mapping[str, Any], report: str) -> None:
        """Display the verdict. document : check.json's content. report : path of its page."""
        self._changed("verdict", document=document, report=report, question=None, picture=None)

    @property
    def to_be_done(self) -> list[Mapping[str, Any]]:
        """The verdict's findings that have a remedy."""
        document = self.document or {"session_findings": [], "findings": []}
        return [one for one in (*document["session_findings"], *document["findings"]) if one["remedy"]]

    def close(self) -> None:
        for view in self.views:
            view.close()
