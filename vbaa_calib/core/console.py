"""Prose and progress on stderr while a command works, so that stdout is left to results."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

_Item = TypeVar("_Item")


def say(text: str) -> None:
    """Print a line or paragraph to stderr."""
    print(text, file=sys.stderr, flush=True)


def _in_lines(items: Iterable[_Item], what: str, total: int | None) -> Iterator[_Item]:
    """The same items, with a line on stderr every ten seconds."""
    total = len(items) if total is None and isinstance(items, Sized) else total
    begun_s = printed_s = time.monotonic()
    for number, item in enumerate(items):
        if (now_s := time.monotonic()) - printed_s >= 10.0:
            say(f"{what}: {number}{f' of {total}' if total else ''}, {now_s - begun_s:.0f} s")
            printed_s = now_s
        yield item


def progress(items: Iterable[_Item], what: str, total: int | None = None) -> Iterable[_Item]:
    """The same items, with a progress bar on stderr; where that is no terminal, with a line every ten seconds."""
    if sys.stderr is None or not sys.stderr.isatty():
        return _in_lines(items, what, total)
    from rich.console import Console
    from rich.progress import track

    return track(items, what, total, console=Console(stderr=True), transient=True)
