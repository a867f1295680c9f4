"""What the page may send: small, of known kinds, and finite. What an answer means is the wizard's to judge."""

from __future__ import annotations

import json
from typing import Any, NoReturn

from vbaa_calib.errors import InputError

from .snapshot import KINDS, Command

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
