"""From the first question to the verdict, step by step, onwards and backwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..detect.board_file import load_board
from ..errors import InputError
from ..files import sha256, write_text
from ..images import list_images, read_picture
from ..session import Session, load_session, read_loads, read_noload, read_sweep
from .catalogue import by_key, open_questions
from .desk import Command, Desk, Interrupted
from .journal import STEPS, Journal, Record, Taken
from .known import Known
from .readings import Given, from_list, from_table
from .session_file import answers_of
from .sources import Source, open_source
from .steps import board, lens, loads, noload, plane, sensor, verdict
from .steps.step import Step
from .store import ASIDE, FOLDERS, WAYS, Store
from .taking import GO_ON, Taking

ALL = {one.name: one for one in (s.STEP for s in (board, lens, plane, noload, loads, sensor, verdict))}
assert tuple(ALL) == STEPS
BOARD, PAPER = by_key()["board"], by_key()["paper"]


class Quit(Exception):
    """The person stops here."""


def walk(known: Known, desk: Desk) -> dict[str, Any]:
    """All steps that are open, to the verdict; its document. Raises Quit, InputError, SolveError."""
    at, store = 0, known.store
    steps = [ALL[name] for name in STEPS[:-1]]
    while at < len(steps):
        step = steps[at]
        if store.journal.of(step.name).closed:
            at += 1
            continue
        desk.begin(step)
        command = _through(known, desk, step)
        if command.kind == "quit":
            raise Quit
        if command.kind == "back":
            at = max(at - 1, 0)
            store.open(steps[at].name)
        elif command.kind == "redo":
            redo(store, desk, step.name)
    last = ALL[STEPS[-1]]
    desk.begin(last)
    desk.show(last, last.look(known))
    known.write_files()
    return verdict.conclude(store.root)


def redo(store: Store, desk: Desk, step: str) -> None:
    """Start a step again, and say where the old one is."""
    place = store.redo(step)
    forgotten = {key: value for key, value in store.journal.answers.items() if key not in _asked_again(step)}
    if len(forgotten) < len(store.journal.answers):
        store.save(Journal(forgotten, store.journal.steps, store.journal.redone))
    desk.say(f"{ALL[step].title}: starts again" + (f", what it had is in {place}" if place else ""))


def _asked_again(step: str) -> tuple[str, ...]:
    return {
        "board": ("board", "paper", "measure_x_mm", "measure_y_mm", "board_along_x_mm", "board_along_y_mm"),
        "plane": ("plane_way", "jig_given", "over_given"),
    }.get(step, ())


def _through(known: Known, desk: Desk, step: Step) -> Command:
    """One step from its questions to its end. Returns `closed` or the command that leaves it."""
    try:
        _answered(known, desk, step)
        if step.judge is None:
            desk.show(step, step.look(known))
            known.store.close(step.name, "done")
            return Command("closed")
        if known.taken(step.name) and _goes_on(known, desk, step):
            return Command("closed")
        source = source_of(known.store, step.name, desk.interactive)
        try:
            desk.say(f"pictures from {source.name}")
            return Taking(known, desk, step, source, given_of(known.store, step.name)).run()
        finally:
            source.close()
    except Interrupted as interrupt:
        return interrupt.command


def _goes_on(known: Known, desk: Desk, step: Step) -> bool:
    """Whether what was there when the step began will do, so that no source is opened."""
    unattended = not desk.interactive and not source_text(known.store, step.name)
    if not unattended and not desk.interactive:
        return False
    progress = step.look(known)
    if unattended and not progress.usable:
        raise InputError(
            f"{step.title}: {'; '.join(progress.missing)}", remedy="give --source, where more pictures come from"
        )
    if not unattended and not (progress.enough and desk.ask(GO_ON, {})):
        return False
    desk.show(step, progress)
    known.store.close(step.name, "there already")
    return True


def _answered(known: Known, desk: Desk, step: Step) -> None:
    """Ask what the step has to ask, and act on it. Raises Interrupted, InputError."""
    store = known.store
    while True:
        if step.name == "board":
            _make_board(store, desk)
        questions = open_questions(step.name, store.journal.answers)
        if not questions or (questions[0].key == "source" and not desk.interactive and known.taken(step.name)):
            return
        value = desk.ask(questions[0], facts(store.journal.answers))
        store.answer({questions[0].key: value})
        _keep_if_right(store, desk)


def _make_board(store: Store, desk: Desk) -> None:
    """Once it is known which board it is: board.yaml, the sheet, and how long its print should be."""
    answers = store.journal.answers
    if "measure_x_mm" in answers or open_questions("board", answers)[:1] in ([BOARD], [PAPER]):
        return
    store.answer(board.make_board(store, answers))
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
        desk.say(str(error))


def check_together(answers: Mapping[str, Any]) -> None:
    """Raises InputError for answers that are right one by one but do not go together; `where` names their keys."""
    if answers.get("board") not in (None, "new") and "measure_x_mm" not in answers:
        try:
            load_board(Path(str(answers["board"])))
        except InputError as error:
            raise InputError(f"{error.where}: {error.what}", where="board", remedy=error.remedy) from None
    board.check_scale(answers)
    x, y = answers.get("jig_board_x"), answers.get("jig_board_y")
    if x and y and x.lstrip("-") == y.lstrip("-"):
        what = f"the board's x runs along {x} and its y along {y}"
        raise InputError(what, where="jig_board_x, jig_board_y", remedy="the two are at right angles: answer anew")


def facts(answers: Mapping[str, Any]) -> dict[str, Any]:
    """What questions name in their words."""
    new = answers.get("board", "new") == "new"
    return {
        "measured_x": "the ruler along the sheet's lower edge" if new else "the pattern along x, from edge to edge",
        "measured_y": "the ruler along the sheet's left edge" if new else "the pattern along y, from edge to edge",
        "measure_x_mm": answers.get("measure_x_mm", float("nan")),
        "measure_y_mm": answers.get("measure_y_mm", float("nan")),
    }


def source_text(store: Store, step: str) -> str:
    """Where a step's pictures come from: its own source, or the folder of its name in the source of all; "" unknown."""
    answers = store.journal.answers
    own = answers.get(f"{step}_source")
    if own:
        return str(own)
    text = str(answers.get("source", ""))
    inside = Path(text) / store.folder(step)
    return str(inside) if "://" not in text and inside.is_dir() else text


def source_of(store: Store, step: str, wait: bool) -> Source:
    """The source of a step's pictures, those that were judged already left out. Raises InputError."""
    text, record = source_text(store, step), store.journal.of(step)
    folder = Path(text)
    if "://" not in text and folder.is_dir() and folder.resolve().is_relative_to(store.root.resolve()):
        raise InputError(
            "lies inside the session, where the wizard keeps what it took",
            where=text,
            remedy="let the camera's program write into another folder",
        )
    return open_source(text, () if folder.is_file() else record.judged, wait)


def given_of(store: Store, step: str) -> Given:
    """Readings that were written down beforehand: those named, or the table in the folder of the pictures."""
    named = store.journal.answers.get(f"{step}_readings")
    if isinstance(named, list):
        return from_list(named, f"{step}_readings")
    if named:
        return from_table(Path(str(named)))
    beside = Path(source_text(store, step)) / f"{store.folder(step)}.csv"
    return from_table(beside) if beside.is_file() else Given()


def adopt(store: Store, desk: Desk) -> None:
    """Begin with a session that was made without the wizard: what it says and shows counts as answered and taken."""
    path = store.root / "session.yaml"
    if not store.is_new or not path.exists():
        return
    session, found = load_session(store.root), answers_of(path)
    given = store.root / ASIDE / "given"
    given.mkdir(parents=True, exist_ok=True)
    write_text(given / path.name, path.read_text(encoding="utf-8-sig"))
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
    rows: Sequence[Any]  # stills and pictures of a sweep have image and joints in common
    if step == "noload":
        rows = read_noload(session)
    elif step == "loads":
        rows = read_loads(session)
    elif folder.name == "sweep":
        rows = read_sweep(session)
    else:
        return tuple(_taken(store, image, {}) for image in list_images(folder))
    return tuple(_taken(store, row.image, _row_readings(row)) for row in rows)


def _taken(store: Store, image: Path, readings: Mapping[str, float]) -> Taken:
    read_picture(image)
    file = image.resolve().relative_to(store.root.resolve()).as_posix()
    return Taken(file, image.name, sha256(image), readings)


def _row_readings(row: Any) -> dict[str, float]:
    names = ("pan_rad", "tilt_rad", "moment_Nm", "distance_m", "force_y_N", "force_z_N", "time_s")
    return {name: getattr(row, name) for name in names if getattr(row, name, None) is not None}


def put_strangers_aside(store: Store, desk: Desk) -> None:
    """Pictures in the session's folders that nobody was told of: left by a stop, or put there by hand."""
    for step in ("lens", "plane", "noload", "loads"):
        for path in store.strangers(step):
            place = store.put_aside(path, "found")
            desk.say(f"{path.relative_to(store.root)} is not one that the wizard took; it is now {place}")
