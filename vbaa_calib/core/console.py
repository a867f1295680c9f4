"""What a person reads while a command works: prose and progress on stderr, so that stdout stays for results."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TypeVar

_Item = TypeVar("_Item")


def say(text: str) -> None:
    """One line or paragraph of prose, to stderr."""
    print(text, file=sys.stderr, flush=True)


def progress(items: Iterable[_Item], what: str, total: int | None = None) -> Iterable[_Item]:
    """The same items, with a progress bar on stderr; quiet when stderr is not a terminal."""
    if sys.stderr is None or not sys.stderr.isatty():
        return items
    from rich.console import Console
    from rich.progress import track

    return track(items, what, total, console=Console(stderr=True), transient=True)
