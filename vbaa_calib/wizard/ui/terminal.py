"""The wizard in a terminal, with its page beside it: the first answer counts, typed or clicked."""

from __future__ import annotations

import os
import queue
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any, TextIO

from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.state.catalogue import STEPS
from vbaa_calib.wizard.state.questions import Question, typed
from vbaa_calib.wizard.steps.step import Progress, Step

from .base import COMMANDS, Interrupted, LiveView, Ui, progress_lines
from .page import Page

_WIDEST = 100
_NARROWEST = 40
_STYLES = {"bold": "\033[1m", "dim": "\033[2m", "next": "\033[1;36m", "wrong": "\033[1;31m", "doubt": "\033[33m"}


def wrapped(text: str, width: int, indent: str = "", hang: str | None = None) -> str:
    """Lines broken at blanks to fit `width`; paths and addresses stay whole, so that they can be copied.

    hang : before what a line goes on with, as `indent` where it is None.
    """
    fold = textwrap.TextWrapper(
        width,
        initial_indent=indent,
        subsequent_indent=indent if hang is None else hang,
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
    )
    return "\n".join(part for line in text.split("\n") for part in fold.wrap(line) or [""])


def _clipped(text: str, width: int) -> str:
    """A text on one line that the terminal does not break."""
    return text if len(text) <= width else text[: max(width - 1, 0)] + "…"


class Screen:
    """A terminal, standard error where none is named. What is written goes above the prompt, which `below` draws again.

    Without a cursor that can be moved (TERM=dumb) nothing is written over, and NO_COLOR leaves the styles out.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._moves = self._stream.isatty() and os.environ.get("TERM", "dumb") not in ("", "dumb")
        self._styled = self._moves and not os.environ.get("NO_COLOR")
        self._status: str | None = None
        self._prompt: str | None = None

    @property
    def width(self) -> int:
        """Columns to write on, now: a window may be resized."""
        try:
            columns = os.get_terminal_size(self._stream.fileno()).columns
        except (OSError, ValueError):
            columns = 0
        return max(min(columns or shutil.get_terminal_size().columns, _WIDEST + 1) - 1, _NARROWEST)

    def write(self, text: str, style: str = "", indent: str = "", hang: str | None = None) -> None:
        """A paragraph for good."""
        self.clear()
        begin, end = (_STYLES[style], "\033[0m") if style and self._styled else ("", "")
        self._put(f"{begin}{wrapped(text, self.width, indent, hang)}{end}\n")

    def below(self, prompt: str, status: str | None = None) -> None:
        """The line where one types, and a line above it that changes; what was typed so far stays."""
        status = None if status is None else _clipped(status, self.width)
        prompt = _clipped(prompt, self.width)
        if prompt == self._prompt and (status is None) == (self._status is None):
            if status != self._status and self._moves:
                self._put(f"\0337\033[A\r{status}\033[K\0338")
                self._status = status
            return
        self.clear()
        if not self._moves:
            status = None
        self._put(prompt if status is None else f"{status}\n{prompt}")
        self._prompt, self._status = prompt, status

    def line_typed(self) -> None:
        """What was typed behind the prompt stays."""
        self._prompt = self._status = None

    def passing(self, text: str) -> None:
        """A line that stands until something else is written."""
        self.clear()
        if self._moves:
            self._prompt = _clipped(text, self.width)
            self._put(self._prompt)
        else:
            self._put(f"{text}\n")

    def clear(self) -> None:
        """What comes next begins a line of its own."""
        if self._prompt is None:
            return
        if self._moves:
            self._put("\r\033[K" + ("" if self._status is None else "\033[A\033[K"))
        else:
            self._put("\n")
        self.line_typed()

    def _put(self, text: str) -> None:
        # not all encodings of a terminal have every sign
        encoding = self._stream.encoding or "ascii"
        self._stream.write(text.encode(encoding, "replace").decode(encoding))
        self._stream.flush()


_TICK_S = 0.1
_STATUS_EVERY_S = 0.25
_LABEL = 12 * " "
_MESSAGE_STYLES = {"next": "next", "WRONG": "wrong", "look": "doubt"}


class Terminal(Ui):
    """Questions and progress as lines; single words are commands. `page` shows the same, None for none."""

    interactive = True

    def __init__(self, page: Page | None = None) -> None:
        self._page, self._screen = page, Screen()
        self._write = self._screen.write
        self._typed: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._shown: tuple[str, list[str]] = ("", [])
        self._problem = ""
        self._status, self._status_s = "", 0.0
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        # A thread of its own: nothing else reads a terminal without waiting on every system. And past Python's buffer,
        # whose lock a thread that waits would still hold when the program ends.
        with open(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as raw:
            while line := raw.readline():
                self._typed.put(line.decode(sys.stdin.encoding or "utf-8", "replace").strip())
        self._typed.put(None)

    def _next_line(self) -> tuple[str, str] | None:
        """A line that was typed and the command in it, "" for none; the end of the input is the command quit."""
        while True:
            try:
                line = self._typed.get_nowait()
            except queue.Empty:
                return None
            if line is None:
                return "quit", "quit"
            self._screen.line_typed()
            word = line.lower()
            if word not in ("help", "?"):
                return line, word if word in COMMANDS else ""
            for name, words in COMMANDS.items():
                self._write(f"{name:9s} {words}", "", "  ", _LABEL)
            self._write("An answer of before is given anew with its flag: vbaa wizard --help lists them.", "", "  ")

    def ask(self, question: Question, facts: Mapping[str, Any] | None = None) -> Any:
        """Ask until the answer is right."""
        words = question.words.format_map(facts or {})
        self._write("")
        self._write(words, "bold")
        if question.why:
            self._write(f"({question.why})", "dim", "  ", "   ")
        problem, self._problem = self._problem, ""
        try:
            while True:
                if self._page is not None:
                    self._page.ask(question, words, problem)
                try:
                    return question.read(self._first_answer(question))
                except InputError as error:
                    problem = f"{error.what.removeprefix(f'{question.key} is ')}; {error.remedy}"
                    self._write(problem, "doubt", "  ")
        finally:
            if self._page is not None:
                self._page.answered()

    def _first_answer(self, question: Question) -> object:
        """What is typed or clicked first. Raises Interrupted for a command."""
        while True:
            self._screen.below(_prompt(question))
            found = self._next_line()
            if found is not None:
                line, command = found
                if command and line not in question.choices:
                    raise Interrupted(command)
                return line if line or question.default is None else question.default
            for kind, value in [] if self._page is None else self._page.take_commands():
                if kind == "answer" and question.key in value:
                    self._write(f"on the page: {typed(value[question.key])}", "", "  ")
                    return value[question.key]
                if kind not in ("answer", "take"):
                    raise Interrupted(kind)
            time.sleep(_TICK_S)

    def greet(self, paragraphs: Sequence[str]) -> None:
        """The first words, a blank line after each."""
        for paragraph in paragraphs:
            self._write(f"{paragraph}\n")

    def begin(self, step: Step) -> None:
        """A heading, and what and why."""
        title = f"── {STEPS.index(step.name) + 1} of {len(STEPS)} · {step.title} "
        self._write(f"\n{title.ljust(min(self._screen.width, 79), '─')}", "bold")
        self._write(step.what)
        self._write(step.why, "dim")
        self._shown, self._status = ("", []), ""
        if self._page is not None:
            self._page.begin(step)

    def show(self, step: Step, progress: Progress) -> None:
        """How far the step is: what has changed since it was shown before, and what is next."""
        lines = progress_lines(progress)
        before = self._shown[1] if self._shown[0] == step.name else []
        for line in lines:
            label = line.split(maxsplit=1)[0]
            if line not in before or label == "next":
                self._write(line, _MESSAGE_STYLES.get(label, ""), "  ", _LABEL)
        self._shown = (step.name, lines)
        if self._page is not None:
            self._page.show(step, progress)

    def working(self, words: str) -> None:
        """Something takes a while."""
        self._screen.passing(f"  … {words}")
        if self._page is not None:
            self._page.working(words)

    def live(self, view: LiveView) -> None:
        """The picture on the page, and a line about it above the prompt."""
        if self._page is not None:
            self._page.live(view)
        now = time.monotonic()
        if now - self._status_s >= _STATUS_EVERY_S:
            self._status, self._status_s = f"  {_live_words(view)}", now

    def say(self, line: str) -> None:
        """A line."""
        self._log(line)

    def wrong(self, line: str) -> None:
        """A line, and beside the next question on the page."""
        self._problem = line
        self._log(line, "doubt")

    def _log(self, line: str, style: str = "") -> None:
        self._write(line, style, "  ", "    ")
        if self._page is not None:
            self._page.log(line)

    def commands(self) -> list[str]:
        """Typed and clicked."""
        commands: list[str] = []
        while "quit" not in commands and (found := self._next_line()) is not None:
            line, command = found
            if command:
                commands.append(command)
            elif line:
                self._write(f"{line!r} is none of {', '.join(COMMANDS)}", "doubt", "  ")
        if self._page is not None:
            commands += [kind for kind, _ in self._page.take_commands() if kind != "answer"]
        if self._status:
            self._screen.below("  take, enough, drop, back, redo, quit, help: ", self._status)
        else:
            self._screen.below("  waiting for pictures (or: enough, drop, back, redo, quit, help): ")
        return commands

    def done(self, document: Mapping[str, Any], report: str) -> None:
        """The verdict."""
        self._write("")
        self._write(document["words"], "bold")
        self._write(f"report    {report}", "", "  ", _LABEL)
        self._write(f"rig       {document['rig']}", "", "  ", _LABEL)
        after = "vbaa estimate finds contacts in a recording; vbaa check says in a month whether the rig still holds"
        self._write(f"next      {after}", "next", "  ", _LABEL)
        if self._page is not None:
            self._page.done(document, report)

    def close(self) -> None:
        """Leave the terminal as it was, and the page."""
        self._screen.clear()
        if self._page is not None:
            self._page.close()


def _live_words(view: LiveView) -> str:
    """A live picture in a line: how long it is held, what is seen, what to change."""
    full = round(4 * view.held)
    check, parts = view.check, []
    if len(check.corners_px):
        parts.append(f"{len(check.corners_px)} corners")
    if check.refusal:
        grave = next((hint for hint in check.hints if hint.grave), None)
        parts.append(check.refusal if grave is None else f"{grave.words} → {grave.remedy}")
    else:
        if check.closeness is not None:
            parts.append(f"match {100 * check.closeness:.0f} %: {check.closer}")
        parts += [view.words or "hold still", *(hint.words for hint in check.hints)]
    return f"{'▮' * full}{'▯' * (4 - full)} {' · '.join(parts)}"


def _prompt(question: Question) -> str:
    parts = [question.unit] if question.unit else []
    choices = ("yes", "no") if question.kind == "yesno" else question.choices
    if choices:
        parts.append(" / ".join(choices))
    if question.default is not None:
        parts.append(f"Enter for {typed(question.default)}")
    return f"  {', '.join(parts) or 'answer'}: "
