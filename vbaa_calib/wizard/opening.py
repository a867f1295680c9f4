"""Where the pictures of a step come from, and what was written down with them beforehand."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import InputError
from .catalogue import SOURCES, by_key
from .desk import Desk
from .known import Known
from .readings import Given, from_list, from_table
from .sources import Source, open_source
from .steps.step import Step
from .store import Store


def opened(known: Known, desk: Desk, step: Step) -> Source:
    """The step's source; asked for again where somebody is there and it cannot be opened."""
    while True:
        try:
            return source_of(known.store, step.name, desk.interactive)
        except InputError as error:
            if not desk.interactive:
                raise
            desk.wrong(str(error))
        ask_for_source(known.store, desk, step)


def ask_for_source(store: Store, desk: Desk, step: Step) -> None:
    """Ask where the step's pictures come from."""
    question = next(question for question in SOURCES if question.step == step.name)
    if step.name == "lens" and question.key not in store.journal.answers:
        question = by_key()["source"]
    store.answer({question.key: desk.ask(question, {})})


def source_text(store: Store, step: str) -> str:
    """Where a step's pictures come from: its own source, or the folder of its name in the source of all; "" unknown."""
    answers = store.journal.answers
    own = answers.get(f"{step}_source")
    if own:
        return str(own)
    text = str(answers.get("source", ""))
    inside = os.path.join(text, store.folder(step))
    return inside if "://" not in text and os.path.isdir(inside) else text


def source_of(store: Store, step: str, wait: bool) -> Source:
    """The source of a step's pictures, those that were judged already left out. Raises InputError."""
    text, record = source_text(store, step), store.journal.of(step)
    folder = Path(text)
    if "://" not in text and os.path.isdir(text) and folder.resolve().is_relative_to(store.root.resolve()):
        raise InputError(
            "lies inside the session, where the wizard keeps what it took",
            where=text,
            remedy="let the camera's program write into another folder",
        )
    return open_source(text, () if os.path.isfile(text) else record.judged, wait)


def given_of(store: Store, step: str) -> Given:
    """Readings that were written down beforehand: those named, or the table in the folder of the pictures."""
    named = store.journal.answers.get(f"{step}_readings")
    if isinstance(named, list):
        return from_list(named, f"{step}_readings")
    if named:
        return from_table(Path(str(named)))
    beside = Path(source_text(store, step)) / f"{store.folder(step)}.csv"
    return from_table(beside) if os.path.isfile(beside) else Given()
