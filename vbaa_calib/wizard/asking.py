"""The questions of a step: asked in order, acted on, and taken back."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..detect.board_file import load_board
from ..errors import InputError
from .catalogue import BOARD_ANSWERS, QUESTIONS, by_key, open_questions
from .catalogue_plane import keeps_jig
from .desk import Desk, Interrupted
from .journal import Journal
from .known import Known
from .session_file import check_jig_axes
from .steps import board
from .steps.step import Step
from .store import Store

_JIG = {key for key in by_key() if key.startswith("jig_")} | {"board_thickness_mm"}
BOARD, PAPER = by_key()["board"], by_key()["paper"]


def answer_all(known: Known, desk: Desk, step: Step) -> None:
    """Ask what the step has to ask, and act on it; `back` asks the question before again.

    Raises Interrupted for a command that leaves the step, InputError where nobody is there.
    """
    store, earlier = known.store, dict[str, Any]()
    while True:
        if step.name == "board":
            _make_board(store, desk)
        questions = open_questions(step.name, store.journal.answers)
        if not questions or (questions[0].key == "source" and not desk.interactive and known.taken(step.name)):
            return
        question = questions[0]
        if question.key in earlier:
            question = replace(question, default=earlier[question.key])
        try:
            value = desk.ask(question, facts(store.journal.answers))
        except Interrupted as interrupt:
            kind = interrupt.command.kind
            taken_back = take_back(store, step.name) if kind == "back" else {}
            earlier |= taken_back
            if kind in ("redo", "quit") or (kind == "back" and not taken_back):
                raise
            if kind != "back":
                desk.say(f"{kind} is for pictures, and they come after the questions")
            continue
        if question.key in ("board", "source"):
            value = absolute(Path(), str(value))
        store.answer({question.key: value})
        _keep_if_right(store, desk)


def absolute(folder: Path, text: str) -> str:
    """A path, from then on wherever the wizard is called; what names nothing in `folder` is left for its own errors."""
    path = os.path.abspath(folder / text)
    if text == "new" or "://" in text or text.startswith("camera:") or not os.path.exists(path):
        return text
    return path


def take_back(store: Store, step: str) -> dict[str, Any]:
    """Forget the last answer of a step, so that it is asked again. What it was; empty where there is none."""
    answers = store.journal.answers
    still = open_questions(step, answers)
    before = QUESTIONS[: QUESTIONS.index(still[0])] if still else QUESTIONS
    answered = [q.key for q in before if q.step == step and q.key in answers and q.needed(answers)]
    if not answered or (step == "board" and answers.get("board_given")):
        return {}
    gone = BOARD_ANSWERS if answered[-1] in (BOARD.key, PAPER.key) else ()
    gone = tuple(key for key in gone if key != BOARD.key) if answered[-1] == PAPER.key else gone
    left = {key: value for key, value in answers.items() if key not in (*gone, answered[-1])}
    store.save(Journal(left, store.journal.steps, store.journal.redone))
    return {answered[-1]: answers[answered[-1]]}


def _make_board(store: Store, desk: Desk) -> None:
    """Once it is known which board it is: board.yaml, the sheet, and how long its print should be."""
    answers = store.journal.answers
    if "measure_x_mm" in answers or open_questions("board", answers)[:1] in ([BOARD], [PAPER]):
        return
    store.answer(board.make_board(store, answers))
    if "board_along_x_mm" not in answers:
        desk.say(board.print_words(store, answers))
    _keep_if_right(store, desk)


def _keep_if_right(store: Store, desk: Desk) -> None:
    """Answers that do not go together are asked again where somebody is there. Raises InputError where nobody is."""
    try:
        check_together(store.journal.answers)
    except InputError as error:
        wrong = {key.strip() for key in str(error.where).split(",")}
        left = {key: value for key, value in store.journal.answers.items() if key not in wrong}
        store.save(Journal(left, store.journal.steps, store.journal.redone))
        if not desk.interactive:
            raise
        desk.wrong(f"{error.what}; {error.remedy}")


def check_together(answers: Mapping[str, Any]) -> None:
    """Raises InputError for answers that are right one by one but do not go together; `where` names their keys."""
    if answers.get("board") not in (None, "new") and "measure_x_mm" not in answers:
        try:
            load_board(Path(str(answers["board"])))
        except InputError as error:
            raise InputError(f"{error.where}: {error.what}", where="board", remedy=error.remedy) from None
    board.check_scale(answers)
    ignored = [key for key in answers if key in _JIG and keeps_jig(answers)]
    if ignored:
        remedy = "give jig_translation_mm and the other answers about the jig too, or mend jig: in session.yaml"
        raise InputError("the jig is the one that session.yaml describes", where=ignored[0], remedy=remedy)
    x, y = answers.get("jig_board_x"), answers.get("jig_board_y")
    if x and y:
        check_jig_axes(x, y)


def facts(answers: Mapping[str, Any]) -> dict[str, Any]:
    """What questions name in their words."""
    new = answers.get("board", "new") == "new"
    return {
        "measured_x": "the ruler along the sheet's lower edge" if new else "the pattern along x, from edge to edge",
        "measured_y": "the ruler along the sheet's left edge" if new else "the pattern along y, from edge to edge",
        "measure_x_mm": answers.get("measure_x_mm", float("nan")),
        "measure_y_mm": answers.get("measure_y_mm", float("nan")),
    }
