"""The questions of a step: asked in order, acted on, and taken back."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.board_file import load_board
from vbaa_calib.wizard.state.catalogue import BOARD_ANSWERS, QUESTIONS, by_key, keeps_jig, open_questions
from vbaa_calib.wizard.state.questions import Question
from vbaa_calib.wizard.state.session_file import check_jig_axes, square_scale_of
from vbaa_calib.wizard.state.session_state import Known
from vbaa_calib.wizard.state.store import Store
from vbaa_calib.wizard.steps import board
from vbaa_calib.wizard.steps.step import Step
from vbaa_calib.wizard.ui.interface import Desk, Interrupted

_JIG = {key for key in by_key() if key.startswith("jig_")} | {"board_thickness_mm"}
BOARD, PAPER = by_key()["board"], by_key()["paper"]


class Earlier:
    """Answers that were taken back: what is offered when their questions are asked again."""

    def __init__(self) -> None:
        self._answers: dict[str, Any] = {}

    def take_back(self, store: Store, step: str) -> bool:
        """Forget the last answer of a step, so that it is asked again; False where there is none."""
        taken_back = _take_back(store, step)
        self._answers |= taken_back
        return bool(taken_back)

    def offered(self, question: Question) -> Question:
        """The question, with what was answered before as its default."""
        return replace(question, default=self._answers.get(question.key, question.default))

    def answer(self, store: Store, key: str, value: Any) -> None:
        """Keep an answer. Where it is another than before, what rested on that one is void."""
        other = key in self._answers and self._answers[key] != value
        if other and key in (BOARD.key, PAPER.key):
            self.void(BOARD_ANSWERS)
        store.answer({key: value}, other)

    def void(self, keys: Collection[str]) -> None:
        """Offer these no more."""
        self._answers = {key: value for key, value in self._answers.items() if key not in keys}


def answer_all(known: Known, desk: Desk, step: Step, earlier: Earlier) -> None:
    """Ask what the step has to ask, and act on it; `back` asks the question before again.

    Raises Interrupted for a command that leaves the step, InputError where nobody is there.
    """
    store = known.store
    while True:
        if step.name == "board":
            _make_board(store, desk)
        questions = open_questions(step.name, store.journal.answers)
        if not questions or (questions[0].key == "source" and not desk.interactive and known.taken(step.name)):
            return
        question = earlier.offered(questions[0])
        try:
            value = desk.ask(question, facts(store.journal.answers))
        except Interrupted as interrupt:
            kind = interrupt.command.kind
            if kind in ("redo", "quit") or (kind == "back" and not earlier.take_back(store, step.name)):
                raise
            if kind != "back":
                desk.say(f"{kind} is for pictures, and they come after the questions")
            continue
        if question.key in ("board", "source"):
            value = absolute(Path(), str(value))
        earlier.answer(store, question.key, value)
        _keep_if_right(store, desk)


def absolute(folder: Path, text: str) -> str:
    """A path, from then on wherever the wizard is called; what names nothing in `folder` is left for its own errors."""
    path = os.path.abspath(folder / text)
    if text == "new" or "://" in text or text.startswith("camera:") or not os.path.exists(path):
        return text
    return path


def _take_back(store: Store, step: str) -> dict[str, Any]:
    """Forget the last answer of a step, so that it is asked again, and what rests on it. Those answers; empty for none.

    The way to plane C stays while it has pictures: they are in that way's folder, and `redo` puts them aside.
    """
    answers = store.journal.answers
    still = open_questions(step, answers)
    before = QUESTIONS[: QUESTIONS.index(still[0])] if still else QUESTIONS
    answered = [q.key for q in before if q.step == step and q.key in answers and q.needed(answers)]
    if not answered or (step == "board" and answers.get("board_given")):
        return {}
    last = answered[-1]
    if last == "plane_way" and store.journal.of(step).taken:
        return {}
    gone = {last}
    if last in (BOARD.key, PAPER.key):
        gone |= {key for key in BOARD_ANSWERS if last == BOARD.key or key != BOARD.key}
    store.forget_answers(gone)
    return {key: value for key, value in answers.items() if key in gone}


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
        store.forget_answers(wrong)
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
    square_scale_of(answers)
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
