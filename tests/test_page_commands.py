"""What the pages tell their reader to type is taken: verbs, flags and values."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from vbaa_calib.cli.main import VERBS, _verb_parser

from .test_docs import FENCE, PAGES, name_of


def commands(path: Path) -> Iterator[tuple[str, bool]]:
    """What a page tells its reader to type, and whether it is a whole command line or named in passing."""
    text = path.read_text(encoding="utf-8")
    for block in FENCE.finditer(text):
        if block["language"] in ("", "sh", "bash", "shell"):
            yield from ((line, True) for line in block["code"].splitlines())
    prose = FENCE.sub("", text)
    yield from ((line.strip(), True) for line in prose.splitlines() if line.startswith("    "))
    for line in prose.splitlines():
        if not line.startswith("    "):
            yield from ((found, False) for found in re.findall(r"`((?:\w+=\S+ )*vbaa [^`]+)`", line))


def words_of(line: str) -> list[str] | None:
    """Verb and arguments of a command line; None of another program's, or of one that is not whole."""
    found = re.match(r"(?:\$ )?(?:\w+=\S+ )*vbaa (?P<rest>[a-z].*)", line)
    return None if found is None or "…" in line else shlex.split(found["rest"], comments=True)


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_commands_are_accepted(path: Path) -> None:
    """The verb exists, and its parser takes the flags and their values."""
    for line, whole in commands(path):
        if not (words := words_of(line)):
            continue
        verb, *rest = words
        assert verb in VERBS, f"there is no verb {verb}"
        parser = _verb_parser(verb)
        if not whole:
            _ask_for_nothing(parser)
        if "--help" not in rest:
            parser.parse_args(rest)


def _ask_for_nothing(parser: argparse.ArgumentParser) -> None:
    """What is named in passing need not be complete."""
    for action in parser._actions:
        action.required = False
        if not action.option_strings or action.nargs is None:
            action.nargs = "?"
