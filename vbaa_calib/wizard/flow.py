"""From the first question to the verdict, step by step, onwards and backwards."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from vbaa_calib.core.errors import InputError, VbaaError
from vbaa_calib.wizard.state.catalogue import BOARD_ANSWERS, SOURCES, by_key
from vbaa_calib.wizard.state.journal import STEPS
from vbaa_calib.wizard.state.questions import Question
from vbaa_calib.wizard.state.readings import Given, from_list, from_table
from vbaa_calib.wizard.state.session_state import Known
from vbaa_calib.wizard.state.store import Store
from vbaa_calib.wizard.steps import board, lens, loads, noload, plane, sensor, verdict
from vbaa_calib.wizard.steps.step import Step
from vbaa_calib.wizard.ui.interface import Command, Desk, Interrupted

from .adopting import put_strangers_aside
from .asking import Earlier, answer_all
from .capture import GO_ON, NoMore, Taking
from .sources import Source, SourceLost, open_source


def _opened(known: Known, desk: Desk, step: Step) -> Source:
    """The step's source; asked for again where somebody is there and it cannot be opened."""
    while True:
        try:
            return _source_of(known.store, step.name, desk.interactive)
        except InputError as error:
            if not desk.interactive:
                raise
            desk.wrong(str(error))
        _ask_for_source(known.store, desk, step)


def _ask_for_source(store: Store, desk: Desk, step: Step) -> None:
    """Ask where the step's pictures come from."""
    question = next(question for question in SOURCES if question.step == step.name)
    if step.name == "lens" and question.key not in store.journal.answers:
        question = by_key()["source"]
    store.answer({question.key: desk.ask(question, {})})


def _source_text(store: Store, step: str) -> str:
    """Where a step's pictures come from: its own source, or the folder of its name in the source of all; "" unknown."""
    answers = store.journal.answers
    own = answers.get(f"{step}_source")
    if own:
        return str(own)
    text = str(answers.get("source", ""))
    inside = os.path.join(text, store.folder(step))
    return inside if "://" not in text and os.path.isdir(inside) else text


def _source_of(store: Store, step: str, wait: bool) -> Source:
    """The source of a step's pictures, those that were judged already left out. Raises InputError."""
    text, record = _source_text(store, step), store.journal.of(step)
    folder = Path(text)
    if "://" not in text and os.path.isdir(text) and folder.resolve().is_relative_to(store.root.resolve()):
        raise InputError(
            "lies inside the session, where the wizard keeps what it took",
            where=text,
            remedy="let the camera's program write into another folder",
        )
    return open_source(text, () if os.path.isfile(text) else record.judged, wait)


def _given_of(store: Store, step: str) -> Given:
    """Readings that were written down beforehand: those named, or the table in the folder of the pictures."""
    named = store.journal.answers.get(f"{step}_readings")
    if isinstance(named, list):
        return from_list(named, f"{step}_readings")
    if named:
        return from_table(Path(str(named)))
    beside = Path(_source_text(store, step)) / f"{store.folder(step)}.csv"
    return from_table(beside) if os.path.isfile(beside) else Given()


ALL = {one.name: one for one in (s.STEP for s in (board, lens, plane, noload, loads, sensor, verdict))}
assert tuple(ALL) == STEPS
AGAIN = Question("again", "", "Press Enter to try again", "what was taken is kept", kind="text", default="again")
GO_BACK = Question(
    "go_back",
    "",
    "Press Enter to go back to the step before",
    "other pictures there may mend it",
    "text",
    default="back",
)


class Quit(Exception):
    """The person stops here."""


def walk(known: Known, desk: Desk, page: verdict.Page) -> dict[str, Any]:
    """All steps that are open, to the verdict; its document, of which `page` makes the report.

    Raises Quit, InputError, SolveError.
    """
    at, store, earlier = 0, known.store, Earlier()
    steps = [ALL[name] for name in STEPS]
    while True:
        step = steps[at]
        if step is not steps[-1] and store.journal.of(step.name).closed:
            at += 1
            continue
        desk.begin(step)
        try:
            if step is steps[-1]:
                return _concluded(known, desk, page)
            _put_results_aside(store, desk)
            command = _through(known, desk, step, earlier)
        except Interrupted as interrupt:
            command = interrupt.command
        except VbaaError as error:
            if not desk.interactive or step.judge is not None:
                raise
            command = _stuck(desk, error)
        if command.kind == "quit":
            raise Quit
        if command.kind == "back":
            at = _before(known, desk, at, earlier)
        elif command.kind == "redo":
            redo(store, desk, step.name)
            earlier.void(_asked_again(step.name))


def _before(known: Known, desk: Desk, at: int, earlier: Earlier) -> int:
    """The step to go back to, opened again: this one with an answer taken back, else one before it."""
    for index in range(at, -1, -1):
        step = ALL[STEPS[index]]
        if (index < at and step.judge is not None) or earlier.take_back(known.store, step.name):
            known.store.open(step.name)
            return index
        known.store.open(step.name)
    desk.say("there is nothing before this")
    return at


def _stuck(desk: Desk, error: VbaaError) -> Command:
    desk.wrong(str(error))
    try:
        desk.ask(GO_BACK, {})
    except Interrupted as interrupt:
        return interrupt.command
    return Command("back")


def _concluded(known: Known, desk: Desk, page: verdict.Page) -> dict[str, Any]:
    step, store = ALL[STEPS[-1]], known.store
    desk.show(step, step.look(known))
    known.write_files()
    # the calibration reads whole folders: what came into them meanwhile was judged by nobody
    put_strangers_aside(store, desk)
    desk.working("everything in one solve")
    try:
        return verdict.conclude(store.root, page)
    except VbaaError:
        _put_results_aside(store, desk)
        raise


def _put_results_aside(store: Store, desk: Desk) -> None:
    """A rig that was solved from something else must not be taken for this session's."""
    there = [path for path in (store.root / verdict.RIG, store.root / verdict.REPORT) if path.exists()]
    if there:
        place = store.put_aside(there, "before")
        desk.say(f"{' and '.join(path.name for path in there)} of an earlier state: now in {place}")


def redo(store: Store, desk: Desk, step: str) -> None:
    """Start a step again, and say where the old one is."""
    place = store.redo(step, _asked_again(step))
    desk.say(f"{ALL[step].title}: starts again" + (f", what it had is in {place}" if place else ""))


def _asked_again(step: str) -> tuple[str, ...]:
    return {
        "board": BOARD_ANSWERS,
        "plane": ("plane_way", "jig_given", "over_given"),
    }.get(step, ())


def _through(known: Known, desk: Desk, step: Step, earlier: Earlier) -> Command:
    """One step from its questions to its end. Returns `closed`, or raises Interrupted for a command that leaves it."""
    answer_all(known, desk, step, earlier)
    if step.judge is None:
        desk.show(step, step.look(known))
        known.store.close(step.name, "done")
        return Command("closed")
    wants_more = False
    if known.taken(step.name):
        done, wants_more = _goes_on(known, desk, step)
        if done:
            return Command("closed")
    while True:
        source = _opened(known, desk, step)
        try:
            desk.say(f"pictures from {source.name}")
            given = _given_of(known.store, step.name)
            return Taking(known, desk, step, source, given, wants_more).run()
        except (SourceLost, NoMore) as error:
            if not desk.interactive:
                raise
            desk.wrong(str(error))
            lost = isinstance(error, SourceLost)
        finally:
            source.close()
        if lost:
            desk.ask(AGAIN, {})
        else:
            _ask_for_source(known.store, desk, step)


def _goes_on(known: Known, desk: Desk, step: Step) -> tuple[bool, bool]:
    """Whether what was there when the step began will do, so that no source is opened; whether more was wanted."""
    unattended = not desk.interactive and not _source_text(known.store, step.name)
    if not unattended and not desk.interactive:
        return False, False
    progress = step.look(known)
    if unattended and not progress.usable:
        raise InputError(
            f"{step.title}: {'; '.join(progress.missing)}", remedy="give --source, where more pictures come from"
        )
    if not unattended and not progress.enough:
        return False, False
    desk.show(step, progress)
    if not unattended and not _is_done(desk):
        return False, True
    known.store.close(step.name, "there already")
    return True, False


def _is_done(desk: Desk) -> bool:
    try:
        return bool(desk.ask(GO_ON, {}))
    except Interrupted as interrupt:
        if interrupt.command.kind in ("take", "drop"):
            return False
        if interrupt.command.kind != "enough":
            raise
        return True
