"""A terminal to write on: paragraphs that fit it, and below them two lines that are written over."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from typing import TextIO

_WIDEST = 100
_NARROWEST = 40
_STYLES = {"bold": "\033[1m", "dim": "\033[2m", "next": "\033[1;36m", "wrong": "\033[1;31m", "doubt": "\033[33m"}


def wrapped(text: str, width: int, indent: str = "", hang: str | None = None) -> str:
    """Each line of a text broken at blanks to fit `width`; paths and addresses stay whole, so that they can be copied.

    indent : before each line. hang : before what a line goes on with, as `indent` where it is None.
    """
    further = indent if hang is None else hang
    lines: list[str] = []
    for line in text.split("\n"):
        folded = textwrap.wrap(
            line,
            width,
            initial_indent=indent,
            subsequent_indent=further,
            break_long_words=False,
            break_on_hyphens=False,
            replace_whitespace=False,
            drop_whitespace=True,
        )
        lines += folded or [""]
    return "\n".join(lines)


def clipped(text: str, width: int) -> str:
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

    @property
    def moves(self) -> bool:
        """Whether a line can be written over."""
        return self._moves

    def write(self, text: str, style: str = "", indent: str = "", hang: str | None = None) -> None:
        """A paragraph for good."""
        self._clear()
        begin, end = (_STYLES[style], "\033[0m") if style and self._styled else ("", "")
        self._put(f"{begin}{wrapped(text, self.width, indent, hang)}{end}\n")

    def below(self, prompt: str, status: str | None = None) -> None:
        """The line where one types, and a line above it that changes; what was typed so far stays."""
        status = None if status is None else clipped(status, self.width)
        prompt = clipped(prompt, self.width)
        if prompt == self._prompt and (status is None) == (self._status is None):
            if status != self._status and self._moves:
                self._put(f"\0337\033[A\r{status}\033[K\0338")
                self._status = status
            return
        self._clear()
        if not self._moves:
            status = None
        self._put(prompt if status is None else f"{status}\n{prompt}")
        self._prompt, self._status = prompt, status

    def entered(self) -> None:
        """A line was typed: what stands there stays."""
        self._prompt = self._status = None

    def passing(self, text: str) -> None:
        """A line that stands until something else is written."""
        self._clear()
        if self._moves:
            self._prompt = clipped(text, self.width)
            self._put(self._prompt)
        else:
            self._put(f"{text}\n")

    def close(self) -> None:
        """What comes next begins a line of its own."""
        self._clear()

    def _clear(self) -> None:
        if self._prompt is None:
            return
        if self._moves:
            self._put("\r\033[K" + ("" if self._status is None else "\033[A\033[K"))
        else:
            self._put("\n")
        self.entered()

    def _put(self, text: str) -> None:
        # not all encodings of a terminal have every sign
        encoding = self._stream.encoding or "ascii"
        self._stream.write(text.encode(encoding, "replace").decode(encoding))
        self._stream.flush()
