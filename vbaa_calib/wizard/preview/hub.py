"""Where the wizard's thread and the page's threads meet: the newest snapshot one way, commands the other."""

from __future__ import annotations

import json
import threading
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from vbaa_calib.core.errors import InputError

from .snapshot import KINDS, Command, Snapshot, encoded

BODY_LIMIT = 16 * 1024
"""Bytes of a request's body."""

KEY_LIMIT, TEXT_LIMIT, NUMBER_LIMIT = 100, 2000, 1e15


def command_of(body: bytes) -> Command:
    """The command in a request's body, {"kind": ..., "value": ..., "seen": ...}.

    Raises
    ------
    InputError : no JSON, an unknown kind, or a value of a wrong type or size.
    """
    try:
        told = json.loads(body.decode("utf-8"), parse_constant=_refused)
    except (ValueError, RecursionError) as error:
        raise InputError("the command is no JSON") from error
    if not isinstance(told, dict) or not set(told) <= {"kind", "value", "seen"}:
        raise InputError("a command has a kind, a value and the snapshot that was seen")
    kind, value, seen = told.get("kind"), told.get("value"), told.get("seen")
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"the command is none of {', '.join(KINDS)}")
    if seen is not None and (type(seen) is not int or not 0 <= seen < NUMBER_LIMIT):
        raise InputError("the snapshot seen is no number of one")
    if kind == "answer":
        return Command(kind, _answer(value), seen)
    if value is not None:
        raise InputError(f"{kind} takes no value")
    return Command(kind, None, seen)


def _refused(word: str) -> NoReturn:
    raise ValueError(word)


def _answer(value: Any) -> dict[str, object]:
    if not isinstance(value, dict) or len(value) != 1:
        raise InputError("an answer is one key with its value")
    ((key, given),) = value.items()
    if not key or len(key) > KEY_LIMIT or not _printable(key):
        raise InputError("the answer's key is empty, too long or not printable")
    if given is None or isinstance(given, bool):
        return {key: given}
    if isinstance(given, (int, float)):
        if abs(given) > NUMBER_LIMIT:
            raise InputError("the answer's number is infinite, or too large")
        return {key: given}
    if isinstance(given, str):
        if len(given) > TEXT_LIMIT or not _printable(given):
            raise InputError(f"the answer's text is longer than {TEXT_LIMIT} characters, or not printable")
        return {key: given}
    raise InputError("an answer is a number, a text, true, false or null")


def _printable(text: str) -> bool:
    """No control characters, no lone surrogates: the text can be printed to a terminal and written to a file."""
    return all(character.isprintable() for character in text)


PICTURES_KEPT = 8
"""A browser that is a little behind still gets the picture that belongs to the corners it draws."""

COMMANDS_KEPT = 100


@dataclass(frozen=True, eq=False)
class Shown:
    """A snapshot as it is sent: its number, and JSON {"n": number, "picture": number or null, "state": ...}."""

    number: int
    body: bytes
    report: Path | None


class Hub:
    """Thread-safe; nobody waits for a browser: the lock is held only to exchange references."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._shown: Shown | None = None
        self._number = 0
        self._pictures: deque[tuple[int, bytes]] = deque(maxlen=PICTURES_KEPT)
        self._commands: deque[Command] = deque()
        self._closed = False

    def publish(self, snapshot: Snapshot) -> int:
        """Make this the newest snapshot; its number. Later changes of its state do not reach the page."""
        state = encoded(snapshot.state)
        report = snapshot.state.get("report")
        with self._changed:
            self._number += 1
            number = self._number
            picture = self._picture_number(snapshot.jpeg, number)
            told = "null" if picture is None else str(picture)
            body = b'{"n":%d,"picture":%s,"state":%s}' % (number, told.encode(), state)
            self._shown = Shown(number, body, None if report is None else Path(str(report)))
            self._changed.notify_all()
        return number

    def _picture_number(self, jpeg: bytes | None, number: int) -> int | None:
        """The number under which a picture is fetched: its snapshot's, or of the one before if it is the same."""
        if jpeg is None:
            return None
        if not self._pictures or self._pictures[-1][1] is not jpeg:
            self._pictures.append((number, jpeg))
        return self._pictures[-1][0]

    def wait(self, after: int, timeout_s: float) -> Shown | None:
        """The newest snapshot as soon as its number is not `after`; None: nothing new in that time, or closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._number != after, timeout_s)
            return self._shown if self._number != after else None

    def newest(self) -> Shown | None:
        """What was shown last."""
        with self._changed:
            return self._shown

    def picture(self, number: int) -> bytes | None:
        """The picture of that number, or the newest where it is no longer kept; None: there is none."""
        with self._changed:
            kept = dict(self._pictures)
            return kept.get(number) or (self._pictures[-1][1] if self._pictures else None)

    def give(self, command: Command) -> bool:
        """Queue a command; False: too many wait already."""
        with self._changed:
            if len(self._commands) >= COMMANDS_KEPT:
                return False
            self._commands.append(command)
            return True

    def take(self) -> list[Command]:
        """All commands that wait, in the order given."""
        with self._changed:
            waiting = list(self._commands)
            self._commands.clear()
            return waiting

    def close(self) -> None:
        """Wake whoever waits: nothing new will come."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
