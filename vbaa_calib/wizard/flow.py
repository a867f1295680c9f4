"""From the first question to the verdict, step by step, onwards and backwards."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError, VbaaError
from ..files import read_text, sha256, write_text
from ..images import list_images, read_picture
from ..session import Session, load_session, read_loads, read_noload, read_sweep
from .asking import answer_all, take_back
from .catalogue import BOARD_ANSWERS, SOURCES, by_key
from .desk import Command, Desk, Interrupted
from .journal import STEPS, Record, Taken
from .known import Known
from .questions import Question
from .readings import Given, from_list, from_table
from .session_file import COLUMNS, answers_of
from .sources import Source, SourceLost, open_source
from .steps import board, lens, loads, noload, plane, sensor, verdict
from .steps.step import Step
from .store import ASIDE, FOLDERS, WAYS, Store
from .taking import GO_ON, NoMore, Taking

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


def walk(known: Known, desk: Desk) -> dict[str, Any]:
    """All steps that are open, to the verdict; its document. Raises Quit, InputError, SolveError."""
    at, store = 0, known.store
    steps = [ALL[name] for name in STEPS]
    while True:
        step = steps[at]
        if step is not steps[-1] and store.journal.of(step.name).closed:
            at += 1
            continue
        desk.begin(step)
        try:
            if step is steps[-1]:
                return _concluded(known, desk)
            command = _through(known, desk, step)
        except Interrupted as interrupt:
            command = interrupt.command
        except VbaaError as error:
            if not desk.interactive or step.judge is not None:
                raise
            command = _stuck(desk, error)
        if command.kind == "quit":
            raise Quit
        if command.kind == "back":
            at = _before(known, desk, at)
        elif command.kind == "redo":
            redo(store, desk, step.name)


def _before(known: Known, desk: Desk, at: int) -> int:
    """The step to go back to, opened again: one with pictures, or with an answer to take back."""
    for index in range(at - 1, -1, -1):
        step = ALL[STEPS[index]]
        if step.judge is not None or take_back(known.store, step.name):
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


def _concluded(known: Known, desk: Desk) -> dict[str, Any]:
    step, store = ALL[STEPS[-1]], known.store
    desk.show(step, step.look(known))
    known.write_files()
    # the calibration reads whole folders: what came into them meanwhile was judged by nobody
    put_strangers_aside(store, desk)
    desk.working("everything in one solve")
    return verdict.conclude(store.root)


def redo(store: Store, desk: Desk, step: str) -> None:
    """Start a step again, and say where the old one is."""
    place = store.redo(step, _asked_again(step))
    desk.say(f"{ALL[step].title}: starts again" + (f", what it had is in {place}" if place else ""))


def _asked_again(step: str) -> tuple[str, ...]:
    return {
        "board": BOARD_ANSWERS,
        "plane": ("plane_way", "jig_given", "over_given"),
    }.get(step, ())


def _through(known: Known, desk: Desk, step: Step) -> Command:
    """One step from its questions to its end. Returns `closed`, or raises Interrupted for a command that leaves it."""
    answer_all(known, desk, step)
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
            given = given_of(known.store, step.name)
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


def _opened(known: Known, desk: Desk, step: Step) -> Source:
    """The step's source; asked for again where somebody is there and it cannot be opened."""
    while True:
        try:
            return source_of(known.store, step.name, desk.interactive)
        except InputError as error:
            if not desk.interactive:
                raise
            desk.wrong(str(error))
        _ask_for_source(known.store, desk, step)


def _ask_for_source(store: Store, desk: Desk, step: Step) -> None:
    question = next(question for question in SOURCES if question.step == step.name)
    if step.name == "lens" and question.key not in store.journal.answers:
        question = by_key()["source"]
    store.answer({question.key: desk.ask(question, {})})


def _goes_on(known: Known, desk: Desk, step: Step) -> tuple[bool, bool]:
    """Whether what was there when the step began will do, so that no source is opened; whether more was wanted."""
    unattended = not desk.interactive and not source_text(known.store, step.name)
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


def adopt(store: Store, desk: Desk) -> None:
    """Begin with a session that was made without the wizard: what it says and shows counts as answered and taken."""
    path = store.root / "session.yaml"
    if not store.is_new or not path.exists():
        return
    session, found = load_session(store.root), answers_of(path)
    given = store.root / ASIDE / "given"
    given.mkdir(parents=True, exist_ok=True)
    tables = [folder / f"{folder.name}.csv" for folder in map(store.root.joinpath, COLUMNS)]
    for file in (path, *tables):
        if file.is_file():
            write_text(given / file.name, read_text(file))
    made = board.make_board(store, found)
    journal = store.journal.with_answers({**made, **found})
    for step in ("lens", "plane", "noload", "loads"):
        taken = _adopted(store, session, step, WAYS.get(str(found.get("plane_way")), "plane"))
        if taken:
            journal = journal.with_step(step, Record(taken))
            desk.say(f"{ALL[step].title}: {len(taken)} pictures are there already")
    # at once: a stop in between must not leave half of it to be taken for strangers
    store.save(journal)


def _adopted(store: Store, session: Session, step: str, way: str) -> tuple[Taken, ...]:
    folder = store.root / FOLDERS.get(step, way)
    if not folder.is_dir():
        return ()
    rows = _rows(session, folder.name)
    if rows is None:
        return tuple(_taken(folder, image, {}) for image in list_images(folder))
    return tuple(_taken(folder, row.image, _row_readings(row)) for row in rows)


def _rows(session: Session, folder: str) -> Sequence[Any] | None:
    """The table of a folder; None where its pictures have none."""
    if folder == "noload":
        return read_noload(session)
    if folder == "loads":
        return read_loads(session)
    return read_sweep(session) if folder == "sweep" else None


def _taken(folder: Path, image: Path, readings: Mapping[str, float]) -> Taken:
    read_picture(image)
    if image.parent.resolve() != folder.resolve():
        raise InputError(f"lies outside {folder}", where=image, remedy="move it there, and mend its row in the table")
    return Taken(f"{folder.name}/{image.name}", image.name, sha256(image), readings)


def _row_readings(row: Any) -> dict[str, float]:
    names = ("pan_rad", "tilt_rad", "moment_Nm", "distance_m", "force_y_N", "force_z_N", "time_s")
    return {name: getattr(row, name) for name in names if getattr(row, name, None) is not None}


def put_strangers_aside(store: Store, desk: Desk) -> None:
    """Pictures in the session's folders that nobody was told of: left by a stop, or put there by hand."""
    strangers = store.strangers()
    if strangers:
        names = [path.relative_to(store.root).as_posix() for path in strangers]
        place = store.put_aside(strangers, "found")
        shown = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        desk.say(f"not taken by the wizard, and put aside into {place}: {shown}")
