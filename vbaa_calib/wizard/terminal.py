"""The wizard's view in a terminal."""

from __future__ import annotations

import os
import queue
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from typing import Any, TextIO

from .questions import STEPS, Question, typed
from .ui import COMMANDS, LivePicture, Ui, WizardView


def _wrapped(text: str, width: int, indent: str = "", hang: str | None = None) -> str:
    """Text wrapped at blanks only, so that paths and addresses can be copied. hang : indent of continuation lines."""
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
    return text if len(text) <= width else text[: max(width - 1, 0)] + "…"


class _Screen:
    """A terminal (default: stderr) with a prompt in its last line, below the text.

    With TERM=dumb nothing is overwritten; NO_COLOR disables styles.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._moves = self._stream.isatty() and os.environ.get("TERM", "dumb") not in ("", "dumb")
        self._styled = self._moves and not os.environ.get("NO_COLOR")
        self._status: str | None = None
        self._prompt: str | None = None

    @property
    def width(self) -> int:
        """Present width of the window in columns."""
        try:
            columns = os.get_terminal_size(self._stream.fileno()).columns
        except (OSError, ValueError):
            columns = 0
        return max(min(columns or shutil.get_terminal_size().columns, 100 + 1) - 1, 40)

    def write(self, text: str, style: str = "", indent: str = "", hang: str | None = None) -> None:
        """Write a paragraph."""
        self.clear()
        styles = {"bold": "\033[1m", "dim": "\033[2m", "next": "\033[1;36m", "wrong": "\033[1;31m", "doubt": "\033[33m"}
        begin, end = (styles[style], "\033[0m") if style and self._styled else ("", "")
        self._put(f"{begin}{_wrapped(text, self.width, indent, hang)}{end}\n")

    def below(self, prompt: str, status: str | None = None) -> None:
        """Draw the prompt with the status line above it; what was typed so far is kept."""
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
        """Note that a line was completed: the prompt scrolls away with it."""
        self._prompt = self._status = None

    def passing(self, text: str) -> None:
        """Print a line that the next one replaces."""
        self.clear()
        if self._moves:
            self._prompt = _clipped(text, self.width)
            self._put(self._prompt)
        else:
            self._put(f"{text}\n")

    def clear(self) -> None:
        """Remove the prompt, or end its line."""
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


_LABEL = 12 * " "
_MOST_IN_PROMPT = 7  # choices; more stand above it


class Terminal(WizardView):
    """Questions and progress as lines of text; single words are commands."""

    def __init__(self) -> None:
        self._screen = _Screen()
        self._write = self._screen.write
        self._typed: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._shown: list[str] = []
        self._status, self._status_s = "", 0.0
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        # In a thread: no other way reads a terminal without blocking on every system. Unbuffered: Python's buffered
        # reader would hold its lock when the program ends.
        with open(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as raw:
            while line := raw.readline():
                self._typed.put(line.decode(sys.stdin.encoding or "utf-8", "replace").strip())
        self._typed.put(None)

    def events(self, ui: Ui) -> Iterator[tuple[str, Any]]:
        """The typed lines as events; the end of input is the command quit."""
        question = ui.question
        if question is not None:
            self._screen.below(_prompt(question))
        elif self._status:
            self._screen.below("  take, enough, drop, back, redo, quit, help: ", self._status)
        else:
            self._screen.below("  waiting for pictures (or: enough, drop, back, redo, quit, help): ")
        while not self._typed.empty():
            line = self._typed.get()
            if line is None:
                yield "quit", None
                return
            self._screen.line_typed()
            word = line.lower()
            if word in ("help", "?"):
                for name, words in COMMANDS.items():
                    self._write(f"{name:9s} {words}", "", "  ", _LABEL)
                self._write("To change an earlier answer, type its name and value: antenna_length_mm = 240", "", "  ")
            elif word in COMMANDS and not (question and line in question.choices):
                yield word, None
            elif question or "=" in line:
                yield "answer", line if line or not question or question.default is None else question.default
            elif line:
                self._write(f"{line!r} is none of {', '.join(COMMANDS)}", "doubt", "  ")

    def update(self, ui: Ui, change: str) -> None:
        match change:
            case "greeting":
                for paragraph in ui.greeting:
                    self._write(f"{paragraph}\n")
            case "step" if ui.step is not None:
                title = f"── {STEPS.index(ui.step.name) + 1} of {len(STEPS)} · {ui.step.title} "
                self._write(f"\n{title.ljust(min(self._screen.width, 79), '─')}", "bold")
                self._write(ui.step.what)
                self._write(ui.step.why, "dim")
                self._shown, self._status = [], ""
            case "progress":
                lines = ui.progress.lines
                for line in lines:
                    label = line.split(maxsplit=1)[0]
                    if line not in self._shown:
                        self._write(
                            line, {"next": "next", "WRONG": "wrong", "look": "doubt"}.get(label, ""), "  ", _LABEL
                        )
                self._shown = lines
            case "question" if ui.question is not None:
                self._write("")
                self._write(ui.words, "bold")
                if ui.question.why:
                    self._write(f"({ui.question.why})", "dim", "  ", "   ")
                if len(ui.question.choices) > _MOST_IN_PROMPT:
                    self._write(", ".join(ui.question.choices), "", "  ")
            case "problem":
                self._write(ui.problem, "doubt", "  ")
            case "doing":
                self._screen.passing(f"  … {ui.doing}")
            case "live" if ui.picture is not None and ui.picture.live:
                now = time.monotonic()
                if now - self._status_s >= 0.25:
                    self._status, self._status_s = f"  {_live_words(ui.picture)}", now
            case "line":
                self._write(ui.lines[-1], "doubt" if ui.problem == ui.lines[-1] else "", "  ", "    ")
            case "verdict":
                self._write("")
                self._write(ui.document["headline"], "bold")
                for one in ui.to_be_done:
                    self._write(f"- {one['question']} {one['words']} → {one['remedy']}", "doubt", "  ", "    ")
                after = (
                    "vbaa estimate finds contacts in a recording; "
                    "vbaa check shows in a month whether the rig is still valid"
                )
                rows = ("report", ui.report, ""), ("rig", ui.document["rig"], ""), ("next", after, "next")
                for label, words, style in rows:
                    self._write(f"{label:9s} {words}", style, "  ", _LABEL)

    def close(self) -> None:
        self._screen.clear()


def _live_words(view: LivePicture) -> str:
    full = round(4 * view.rested)
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
    if 0 < len(choices) <= _MOST_IN_PROMPT:
        parts.append(" / ".join(choices))
    if question.default is not None:
        parts.append(f"Enter for {typed(question.default)}")
    return f"  {', '.join(parts) or 'answer'}: "
