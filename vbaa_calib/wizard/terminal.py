"""The wizard in a terminal, with its page beside it: whichever is answered first."""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any

from ..console import say
from ..errors import InputError
from .desk import COMMANDS, Command, Interrupted, Live, lines_of
from .page import Page
from .progress import Progress
from .questions import Question, Value
from .steps.step import Step

_TICK_S = 0.1
_LINE_EVERY_S = 0.4


class Terminal:
    """Questions and progress as lines; single words are commands. `page` shows the same, None for none."""

    interactive = True

    def __init__(self, page: Page | None = None) -> None:
        self._page = page
        self._typed: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._bold = ("\033[1m", "\033[0m") if sys.stderr.isatty() else ("", "")
        self._lived, self._open_line = 0.0, False
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        # a thread of its own: nothing else reads a terminal without waiting on every system
        for line in sys.stdin:
            self._typed.put(line.strip())
        self._typed.put(None)

    def _next_line(self) -> str | None:
        """A line that was typed, None where there is none. The end of the input is the command quit."""
        try:
            line = self._typed.get_nowait()
        except queue.Empty:
            return None
        return "quit" if line is None else line

    def ask(self, question: Question, facts: Mapping[str, Any]) -> Value:
        """Ask until the answer is one."""
        words = question.words.format_map(facts)
        self._write(f"{self._bold[0]}{words}{self._bold[1]}")
        if question.why:
            self._write(f"  ({question.why})")
        problem = ""
        while True:
            if self._page is not None:
                self._page.ask(question, words, problem)
            self._prompt(question)
            given = self._answer(question)
            try:
                value = question.read(given)
            except InputError as error:
                problem = str(error)
                self._write(f"  {problem}")
                continue
            if self._page is not None:
                self._page.answered()
            return value

    def _prompt(self, question: Question) -> None:
        unit = f" [{question.unit}]" if question.unit else ""
        choices = f" [{'/'.join(question.choices)}]" if question.choices else ""
        default = "" if question.default is None else f" (Enter: {_shown(question.default)})"
        print(f"  {question.key}{unit}{choices}{default}: ", end="", file=sys.stderr, flush=True)
        self._open_line = True

    def _answer(self, question: Question) -> object:
        while True:
            line = self._next_line()
            if line is not None:
                self._open_line = False
                if line == "help":
                    self._help()
                elif line in COMMANDS and line not in question.choices:
                    raise Interrupted(Command(line))
                elif line or question.default is None:
                    return line
                else:
                    return question.default
                self._prompt(question)
                continue
            if self._page is not None:
                for kind, value in self._page.take():
                    if kind == "answer" and question.key in value:
                        self._write("")
                        return value[question.key]
                    if kind != "answer":
                        raise Interrupted(Command(kind))
            time.sleep(_TICK_S)

    def begin(self, step: Step) -> None:
        """A heading, and what and why."""
        self._write(f"\n{self._bold[0]}── {step.title} {'─' * max(60 - len(step.title), 3)}{self._bold[1]}")
        self._write(f"{step.what}\n{step.why}")
        if self._page is not None:
            self._page.begin(step)

    def show(self, step: Step, progress: Progress) -> None:
        """How far the step is."""
        for line in lines_of(progress):
            self._write(f"  {line}")
        if self._page is not None:
            self._page.show(step, progress)

    def live(self, step: Step, live: Live) -> None:
        """A line that is written over, and the picture on the page."""
        if self._page is not None:
            self._page.live(live)
        now = time.monotonic()
        if now - self._lived < _LINE_EVERY_S:
            return
        self._lived = now
        hint = live.judged.refusal or next((one.words for one in live.judged.hints), "")
        held = "▮" * round(4 * live.held) + "▯" * (4 - round(4 * live.held))
        line = f"  {held} {len(live.judged.corners_px)} corners  {hint or live.judged.closer or 'good; hold it still'}"
        print(f"\r{line[:118]:118s}", end="", file=sys.stderr, flush=True)
        self._open_line = True

    def say(self, line: str) -> None:
        """A line."""
        self._write(f"  {line}")
        if self._page is not None:
            self._page.log(line)

    def commands(self) -> list[Command]:
        """Typed and clicked."""
        found = []
        while (line := self._next_line()) is not None:
            self._open_line = False
            if line == "help":
                self._help()
            elif line in COMMANDS:
                found.append(Command(line))
            elif line:
                self._write(f"  {line!r} is no command; they are {', '.join(COMMANDS)}")
            if line == "quit":
                break
        if self._page is not None:
            found += [Command(kind) for kind, _ in self._page.take() if kind != "answer"]
        return found

    def done(self, words: str, report: str | None) -> None:
        """The verdict."""
        self._write(f"\n{self._bold[0]}{words}{self._bold[1]}")
        if self._page is not None:
            self._page.done(words, report)

    def _help(self) -> None:
        for name, words in COMMANDS.items():
            self._write(f"  {name:8s} {words}")

    def _write(self, text: str) -> None:
        if self._open_line:
            print(file=sys.stderr)
            self._open_line = False
        say(text)


def _shown(value: Value) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(f"{part:g}" for part in value)
    return f"{value:g}" if isinstance(value, int | float) else str(value)
