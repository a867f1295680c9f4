"""The house's docstrings for napoleon: after `name :` stand words, not a type; the type is the annotation's."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

_ENTRY = re.compile(r"(\*{0,2}\w[\w*, ]*?) : (.+)")
_BEFORE_NAPOLEON = 400


def setup(app: Sphinx) -> dict[str, Any]:
    """Rewrite each docstring before napoleon reads it."""
    app.connect("autodoc-process-docstring", _process, priority=_BEFORE_NAPOLEON)
    return {"parallel_read_safe": True}


def _process(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    lines[:] = with_words_below(lines)
    if what in ("property", "attribute", "data"):
        # an empty comment, or napoleon takes what stands before a colon in the first line for a type
        lines[:0] = ["..", ""]


def with_words_below(lines: list[str]) -> list[str]:
    """In sections `name : words` becomes the name, and the words indented below it; attributes become a list."""
    done: list[str] = []
    section = ""
    skip = False
    for number, line in enumerate(lines):
        if skip:
            skip = False
            continue
        if number + 1 < len(lines) and set(lines[number + 1].strip()) == {"-"}:
            section = line.strip()
            skip = section == "Attributes"
            done += [".. rubric:: Attributes", ""] if skip else [line]
            continue
        entry = _ENTRY.fullmatch(line) if section in ("Parameters", "Attributes", "Raises") else None
        if entry is None:
            done.append(line)
            continue
        names = ", ".join(f"``{one}``" for one in entry[1].split(", ")) if section == "Attributes" else entry[1]
        done += [names, f"    {entry[2]}"]
    return done
