"""The sequence of steps, from the first question to the verdict, forwards and back."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from vbaa_calib.core.errors import Disconnected, InputError, VbaaError
from vbaa_calib.core.files import is_bag, sha256
from vbaa_calib.core.images import SUFFIXES
from vbaa_calib.sources import PictureSource, VideoSource, open_source

from ..streams.pictures import BagPictures
from .asking import answer_all, archive_unlisted, change, take_back
from .capture import GO_ON, Capture
from .questions import BOARD_ANSWERS, BY_KEY, OF_LENS_FILE, PICTURES, SOURCES, STEPS, Question, ReadingsTable
from .session_state import SessionState
from .steps import REPORT, RIG, STEP_BY_NAME, Advise, Report, Step, conclude
from .store import Store
from .ui import Interrupted, Ui

_ASKED_AGAIN = {
    "board": BOARD_ANSWERS,
    "lens": ("camera", *(one.key for one in OF_LENS_FILE)),
    "plane": ("plane_way", "jig_given", "over_given"),
}
"""Answers that `redo` of a step forgets."""


def walk(state: SessionState, ui: Ui, report: Report, advise: Advise | None = None) -> dict[str, Any]:
    """Take all open steps up to the verdict. Returns check.json's content. report : writes its page.

    Raises Interrupted("quit") where the person stops, InputError, SolveError.
    """
    at, store = 0, state.store
    _reread(state, ui)
    ui.change = partial(change, state, ui)
    back = Question(
        "go_back",
        "",
        "Press Enter to go back to the step before",
        "other pictures there may help",
        kind="text",
        default="back",
    )
    while True:
        step = STEP_BY_NAME[STEPS[at]]
        is_last = step.name == STEPS[-1]
        if not is_last and store.journal.of(step.name).closed:
            at += 1
            continue
        ui.begin(step)
        try:
            if is_last:
                return _conclude(state, ui, report, advise)
            _archive_results(store, ui)
            command = _take_step(state, ui, step)
        except Interrupted as interrupt:
            command = interrupt.command
        except VbaaError as error:
            if not ui.interactive or step.check is not None:
                raise
            ui.wrong(str(error))
            try:
                ui.ask(back)
                command = "back"
            except Interrupted as interrupt:
                command = interrupt.command
        if command == "quit":
            raise Interrupted(command)
        if command == "back":
            at = _step_before(store, ui, at)
        elif command == "redo":
            redo(store, ui, step.name)
            store.offer_no_more(_ASKED_AGAIN.get(step.name, ()))


def _step_before(store: Store, ui: Ui, at: int) -> int:
    """Reopen the step to go back to: this one if one of its answers was taken back, else an earlier one."""
    for index in range(at, -1, -1):
        step = STEP_BY_NAME[STEPS[index]]
        found = (index < at and step.check is not None) or take_back(store, step.name)
        store.close(step.name, "")
        if found:
            return index
    ui.say("there is nothing before this")
    return at


def _conclude(state: SessionState, ui: Ui, report: Report, advise: Advise | None) -> dict[str, Any]:
    step, store = STEP_BY_NAME[STEPS[-1]], state.store
    ui.show(step, step.progress(state))
    state.write_files()
    # the calibration reads whole folders: what came into them meanwhile was checked by nobody
    archive_unlisted(store, ui)
    ui.working("everything in one solve")
    try:
        return conclude(store.root, report, state.given_lens, advise)
    except VbaaError:
        _archive_results(store, ui)
        raise


def _archive_results(store: Store, ui: Ui) -> None:
    """Move away a rig solved from other pictures, so that it is not taken for this session's."""
    there = [path for path in (store.root / RIG, store.root / REPORT) if path.exists()]
    if there:
        place = store.archive(there, "before")
        ui.say(f"{' and '.join(path.name for path in there)} of an earlier state: now in {place}")


def redo(store: Store, ui: Ui, step: str, *, by_flag: bool = False) -> None:
    """Start a step again; prints where its old pictures are and which come next.

    A user who is present takes new pictures: those of a folder that were judged before do not count. Without a user,
    and with `--redo` (by_flag) where the folder holds nothing new, the pictures that it holds are judged again, and
    nothing is waited for.
    """
    there, records = _pictures_in(_source_text(store, step)), [store.journal.of(name) for name in PICTURES]
    judged = {one.sha256 for each in records for one in each.taken} | {
        one.sha256 for each in records for one in each.left
    }
    past = [str(path) for path in there if path.is_file() and sha256(path) in judged] if ui.interactive else None
    again = by_flag and past is not None and len(past) == len(there)
    place = store.redo(step, _ASKED_AGAIN.get(step, ()), None if again else past)
    ui.say(f"{STEP_BY_NAME[step].title}: starts again" + (f", what it had is in {place}" if place else ""))
    if again and there:
        ui.say(f"{there[0].parent} holds nothing new: its {len(there)} pictures are taken once more")


def _take_step(state: SessionState, ui: Ui, step: Step) -> str:
    """Run one step from its questions to "closed", or to a command that leaves it (returned or raised)."""
    answer_all(state, ui, step)
    if step.check is None or (step.name == "lens" and state.given_lens is not None):
        progress = step.progress(state)
        ui.show(step, progress)
        stands = ui.interactive and any(one.grave for one in progress.diagnoses)
        if stands and not ui.ask(replace(GO_ON, default="no", why="no: back to the step before, to correct it")):
            return "back"
        state.store.close(step.name, "done")
        return "closed"
    wants_more = False
    lost: bool | None
    if state.taken(step.name):
        closed, wants_more = _closes_as_it_is(state, ui, step)
        if closed:
            return "closed"
    while True:
        source = _open(state.store, ui, step)
        try:
            past = len(state.store.journal.of(step.name).past or ()) if ui.interactive else 0
            new = f": new ones are waited for, the {past} that are there already do not count" if past else ""
            ui.say(f"pictures from {source.name}{new}")
            table = _readings_table(state.store, step.name)
            if (ended := Capture(state, ui, step, source, table, wants_more).run()) != "again":
                return ended
            lost = None
        except Disconnected as error:
            if not ui.interactive:
                raise
            ui.wrong(str(error))
            lost = not source.ended
        finally:
            source.close()
        if lost is None:
            answer_all(state, ui, step)
        elif lost:
            ui.ask(
                Question(
                    "again", "", "Press Enter to try again", "what was taken is kept", kind="text", default="again"
                )
            )
        else:
            _ask_for_source(state.store, ui, step.name)


def _closes_as_it_is(state: SessionState, ui: Ui, step: Step) -> tuple[bool, bool]:
    """Whether the step closes with the pictures that it has, and whether the user wants more of them."""
    if not ui.interactive and _source_text(state.store, step.name):
        return False, False
    progress = step.progress(state)
    if not ui.interactive and not progress.usable:
        remedy = "give --source, where more pictures come from"
        raise InputError(f"{step.title}: {'; '.join(progress.missing)}", remedy=remedy)
    if ui.interactive and not progress.enough:
        return False, False
    ui.show(step, progress)
    if ui.interactive:
        try:
            done = bool(ui.ask(GO_ON))
        except Interrupted as interrupt:
            if interrupt.command not in ("take", "drop", "enough"):
                raise
            done = interrupt.command == "enough"
        if not done:
            return False, True
    state.store.close(step.name, "there already")
    return True, False


def _open(store: Store, ui: Ui, step: Step) -> PictureSource:
    """Open the source of a step's pictures, behind those already judged; asks for another if it cannot be opened.

    Raises InputError where nobody answers.
    """
    while True:
        text = _source_text(store, step.name)
        is_folder = "://" not in text and os.path.isdir(text)
        try:
            if is_folder and Path(text).resolve().is_relative_to(store.root.resolve()):
                what = "lies inside the session, where the wizard keeps what it took"
                raise InputError(what, where=text, remedy="let the camera's program write into another folder")
            _begin(store, ui, step.name)
            record = store.journal.of(step.name)
            before = {path.name for path in map(Path, record.past or ()) if path.parent == Path(text)}
            judged = () if os.path.isfile(text) else record.judged | before
            from_bag = "://" not in text and is_bag(Path(text.partition("#")[0]))
            source = BagPictures(text) if from_bag else open_source(text, judged, ui.interactive)
            if isinstance(source, BagPictures | VideoSource) and (start := _start_in(store, step.name, text)):
                ui.say(f"of {source.name} the frames from {start} on: the steps before took theirs")
                for _ in range(start):
                    source.skip()
            return source
        except InputError as error:
            if not ui.interactive:
                raise
            ui.wrong(str(error))
        _ask_for_source(store, ui, step.name)


def _start_in(store: Store, step: str, text: str) -> int:
    """The frame of a video or bag at which a step begins: after those that earlier steps have judged."""
    before = list(PICTURES)[: list(PICTURES).index(step)]
    names = {name for other in before if _source_text(store, other) == text for name in store.journal.of(other).judged}
    return max((1 + int(name.split()[1]) for name in names if name.startswith("frame ")), default=0)


def _pictures_in(text: str) -> list[Path]:
    """The pictures of a source that is a folder."""
    if "://" in text or not os.path.isdir(text):
        return []
    return [path for path in sorted(Path(text).iterdir()) if path.suffix.lower() in SUFFIXES]


def _begin(store: Store, ui: Ui, step: str) -> None:
    """Note which pictures of a shared folder belong to earlier steps; of a step's own folder all count.

    To be called once the step's questions are answered: until then the user may be at the step before.
    """
    text = _source_text(store, step)
    if store.journal.of(step).past is not None or not text:
        return
    others = [store.journal.of(other) for other in PICTURES if other != step]
    judged = frozenset[str]().union(*(record.judged for record in others))
    is_shared = text == store.journal.answers.get("source") and bool(judged)
    there = _pictures_in(text) if is_shared else []
    store.begin(step, [str(path) for path in there if ui.interactive or path.name in judged])


def _ask_for_source(store: Store, ui: Ui, step: str) -> None:
    question = next(question for question in SOURCES if question.step == step)
    if step == "lens" and question.key not in store.journal.answers:
        question = BY_KEY["source"]
    store.answer({question.key: ui.ask(question)})


def _source_text(store: Store, step: str) -> str:
    """A step's source: its own, or the folder of the step's name in the common source; "" if unknown."""
    answers = store.journal.answers
    own = answers.get(f"{step}_source")
    if own:
        return str(own)
    text = str(answers.get("source", ""))
    inside = os.path.join(text, store.folder(step))
    return inside if "://" not in text and os.path.isdir(inside) else text


def _reread(state: SessionState, ui: Ui) -> None:
    """Take over the readings in tables that were edited since the session's last answer: those next to the pictures,
    and the session's own, which otherwise repeat what wizard.json has."""
    store = state.store
    for step in PICTURES:
        folder, source = store.folder(step), _readings_path(store, step)
        own = store.root / folder / f"{folder}.csv"
        for path in (own, source):
            if path is not None and path.is_file() and (path == own or path.stat().st_mtime > store.begun_s):
                _take_over(state, ui, step, path, path == own)


def _take_over(state: SessionState, ui: Ui, step: str, path: Path, own: bool) -> None:
    """The readings of a step's pictures from a table, by their names in the session (own) or at the source."""
    store = state.store
    try:
        table = ReadingsTable.read(path)
        for number, taken in enumerate(store.journal.of(step).taken):
            row = table.of(Path(taken.file).name if own else taken.source, number)
            readings = {} if row is None else state.readings(step, row, f"{path} {taken.source}")
            if {**taken.readings, **readings} != taken.readings:
                store.correct(step, number, readings)
                ui.say(f"{taken.file}: its readings are now those of {path}")
    except InputError as error:
        ui.say(f"readings stay as they were: {error}")


def _readings_path(store: Store, step: str) -> Path | None:
    """The file with a step's readings, whether it is there or not; None where the answers hold them."""
    named = store.journal.answers.get(f"{step}_readings")
    if isinstance(named, list):
        return None
    return Path(str(named)) if named else Path(_source_text(store, step)) / f"{store.folder(step)}.csv"


def _readings_table(store: Store, step: str) -> ReadingsTable:
    """The table of readings taken beforehand: the named one, or the one in the pictures' folder."""
    named, path = store.journal.answers.get(f"{step}_readings"), _readings_path(store, step)
    if path is None:
        return ReadingsTable.written(named or (), f"{step}_readings")
    return ReadingsTable.read(path) if named or path.is_file() else ReadingsTable()
