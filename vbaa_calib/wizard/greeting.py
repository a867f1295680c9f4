"""The wizard's first words: what is needed, or where a session goes on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from .journal import PICTURES, STEPS, Journal
from .store import Store


def greeting(store: Store, session: Path, page: str, titles: Mapping[str, str]) -> list[str]:
    """Paragraphs for whoever starts the wizard. page : the live page's address, "" for none. titles : of the steps."""
    lines = [_resumed(store.journal, session, titles)] if not store.is_new else _new(session)
    if page:
        lines.append(f"The same with the live picture, in a browser on this machine: {page}")
    lines.append("Type an answer, or Enter for the one in brackets; help lists the commands, quit stops.")
    return lines


def _new(session: Path) -> list[str]:
    return [
        "From a camera and a steel whisker to a calibrated rig. You need: the camera, fixed and focused, its autofocus "
        "off; the antenna with its moment sensor; a printer, a ruler or caliper, and something flat to glue the board "
        "on; three small weights that you know; about half an hour.",
        f"Seven steps, and the wizard says at each what to do next. Whatever it says it took is safe in {session}: "
        "stop whenever you like, the same command goes on there.",
    ]


def _resumed(journal: Journal, session: Path, titles: Mapping[str, str]) -> str:
    done = [titles[name] for name in STEPS if journal.of(name).closed]
    left = next((titles[name] for name in STEPS if not journal.of(name).closed), titles[STEPS[-1]])
    counts = [f"{len(journal.of(name).taken)} {words}" for name, words in PICTURES.items() if journal.of(name).taken]
    parts = [f"{session} goes on with: {left}."]
    if done:
        parts.append(f"Done: {', '.join(done)}.")
    if counts:
        parts.append(f"Pictures: {', '.join(counts)}.")
    return " ".join(parts)
