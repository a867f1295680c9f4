"""`vbaa wizard SESSION`: guided, resumable calibration."""

from __future__ import annotations

import argparse
import contextlib
import difflib
import re
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.cli.options import add_lens_file
from vbaa_calib.core.console import say
from vbaa_calib.core.errors import InputError, VbaaError
from vbaa_calib.core.files import read_json, read_yaml, write_json
from vbaa_calib.wizard.questions import (
    BOARD_ANSWERS,
    BY_KEY,
    OF_LENS_FILE,
    PICTURES,
    QUESTIONS,
    SOURCES,
    STEPS,
    TABLES,
    Question,
)

if TYPE_CHECKING:
    from vbaa_calib.calibrate.pipeline import Calibration
    from vbaa_calib.wizard.store import Store
    from vbaa_calib.wizard.ui import Ui

_OPTIONS = (*QUESTIONS, *SOURCES, *TABLES)
_PATHS = {"board", "source"} | {question.key for question in (*SOURCES, *TABLES) if question not in OF_LENS_FILE}


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="the session folder: made if it is new, else continued")
    parser.add_argument("--answers", type=Path, metavar="FILE", help="YAML or JSON with answers by their keys")
    parser.add_argument(
        "--redo", choices=STEPS[:-1], metavar="STEP", help=f"start a step again: {', '.join(STEPS[:-1])}"
    )
    parser.add_argument("--reopen", choices=STEPS[:-1], metavar="STEP", help="continue a closed step")
    parser.add_argument("--batch", action="store_true", help="ask nothing and never wait, as without a terminal")
    parser.add_argument("--no-page", action="store_true", help="no live page beside the terminal")
    parser.add_argument("--port", type=int, default=0, help="of the live page on 127.0.0.1 (default: any that is free)")
    group = parser.add_argument_group(
        "answers",
        "each is asked for in a terminal where it is not given; a value that begins with a minus needs an equals sign, "
        "like --jig-board-y=-y",
    )
    add_lens_file(parser)
    for question in (one for one in _OPTIONS if one not in OF_LENS_FILE):
        unit = f" ({question.unit})" if question.unit else ""
        choices = f": {', '.join(question.choices)}" if question.choices else ""
        words = question.words
        for axis in "xy":
            words = words.replace(f"{{measured_{axis}}}", f"the ruler along {axis}")
            words = words.replace(f" It says {{measure_{axis}_mm:.6g}} mm", "")
        text = (words + choices + unit).replace("%", "%%")
        group.add_argument(question.flag, dest=f"answer_{question.key}", metavar="...", help=text)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> dict[str, Any]:
    """Walk through the steps. Returns the verdict and the paths of all results.

    Raises InputError for whatever is wrong or missing, where nobody is there to be asked; VbaaError for a disk that is
    full or gone.
    """
    from vbaa_calib.calibrate.given_lens import read_lens
    from vbaa_calib.convert.values import Wanted
    from vbaa_calib.wizard.store import Store

    if not 0 <= args.port <= 65535:
        raise InputError(f"there is no port {args.port}", where="--port", remedy="0 for any, or up to 65535")
    answers = _all_answers(args)
    if "camera" in answers:  # before anything is touched
        read_lens(Path(answers["camera"]), Wanted.of(answers))
    try:
        with Store(args.session) as store:
            return _walk(args, store, answers)
    except KeyboardInterrupt:
        say(f"stopped; `vbaa wizard {args.session}` goes on here, with all that it reported as taken")
        raise
    except BrokenPipeError:
        raise
    except OSError as error:
        where, why = error.filename or args.session, error.strerror or error
        remedy = "make room or repair that, and run it again: it goes on with all that it reported as taken"
        raise VbaaError(f"{where}: cannot be read or written ({why}); {remedy}") from error


def _all_answers(args: argparse.Namespace) -> dict[str, Any]:
    """The checked answers of --answers and of flags, which take precedence. Raises InputError."""
    from vbaa_calib.wizard.asking import absolute
    from vbaa_calib.wizard.questions import ReadingsTable

    questions = {question.key: question for question in _OPTIONS}
    found: dict[str, Any] = {}
    for key, value in (read_yaml(args.answers) if args.answers else {}).items():
        if key not in questions:
            close = difflib.get_close_matches(str(key), questions, n=1)
            remedy = f"do you mean {close[0]}?" if close else f"the keys are {', '.join(questions)}"
            raise InputError(f"unknown key {key!r}", where=args.answers, remedy=remedy)
        if questions[key] in TABLES and isinstance(value, list):
            ReadingsTable.written(value, f"{args.answers}: {key}")
            found[key] = value
        else:
            found[key] = questions[key].read(value, args.answers)
        if key in _PATHS and isinstance(found[key], str):
            found[key] = absolute(args.answers.parent, found[key])
    for key, question in questions.items():
        value = getattr(args, key if question in OF_LENS_FILE else f"answer_{key}")
        if value is not None and (value or key != "rectified"):
            found[key] = question.read(value, question.flag)
            if key in _PATHS:
                found[key] = absolute(Path(), found[key])
    return found


def _walk(args: argparse.Namespace, store: Store, answers: dict[str, Any]) -> dict[str, Any]:
    from vbaa_calib.calibrate.given_lens import read_lens
    from vbaa_calib.convert.values import Wanted
    from vbaa_calib.wizard.asking import adopt, archive_unlisted, check_together
    from vbaa_calib.wizard.flow import redo, walk
    from vbaa_calib.wizard.session_state import SessionState
    from vbaa_calib.wizard.steps import REPORT
    from vbaa_calib.wizard.ui import Interrupted, Ui
    from viz.report import check as report

    state, ui, url = SessionState(store), Ui(), ""
    made: dict[str, Calibration] = {}
    # a stream is None where it was closed
    if not args.batch and all(stream is not None and stream.isatty() for stream in (sys.stdin, sys.stderr)):
        from vbaa_calib.wizard.page import Page
        from vbaa_calib.wizard.terminal import Terminal

        page = None if args.no_page else Page(state, args.port)
        url = "" if page is None else page.url
        ui = Ui(Terminal(), *([page] if page else []), interactive=True)
    try:
        ui.greet(_greeting(store, args.session, url))
        adopt(store, ui)
        # first: a picture that was changed is unlisted from then on
        if lost := store.forget_lost():
            names = ", ".join(one.file for one in lost[:5]) + (" ..." if len(lost) > 5 else "")
            ui.say(f"{len(lost)} pictures are gone or have changed, and are not used: {names}")
        archive_unlisted(store, ui)
        before = store.journal.answers
        keys = ("board", "paper") if answers.get("board", before.get("board")) == "new" else ("board",)
        changed = {key for key, value in answers.items() if before.get(key) != value}
        other_board = "measure_x_mm" in before and (not changed.isdisjoint(keys) or _board_edited(store))
        stale = BOARD_ANSWERS if other_board else ()
        known = {key: value for key, value in before.items() if key not in stale} | answers
        check_together(known)
        _cameras_named(known)
        if changed & {one.key for one in OF_LENS_FILE}:
            read_lens(Path(known["camera"]), Wanted.of(known))
        # before the answers: they are meant for the step as it starts again
        again = ["plane"] if "plane_way" in changed and store.journal.of("plane").taken else []
        for step in [*again, *(["board"] if other_board else []), *([args.redo] if args.redo else [])]:
            redo(store, ui, step, by_flag=step == args.redo)
        store.answer(answers)
        if args.reopen:
            store.close(args.reopen, "")
        try:
            document = walk(state, ui, report.page, partial(_advised, made, "camera"))
        except Interrupted:
            ui.say(f"stopped; `vbaa wizard {args.session}` goes on here")
            return _result(store, None)
        ui.done(document, str(store.root / REPORT))
        complete = _further_cameras(store, ui, made)
        if url:  # the page stays until it was read
            with contextlib.suppress(Interrupted):
                ui.ask(Question("read", "", "Press Enter when you have read the report", kind="text", default="done"))
        return _result(store, document) | ({} if complete else {"complete": False})
    finally:
        ui.close()


def _board_edited(store: Store) -> bool:
    """Whether the board's own file describes another board than when it was named. Raises InputError as it is read."""
    from vbaa_calib.detect.board.board_file import load_board
    from vbaa_calib.wizard.session_state import BOARD

    named = Path(str(store.journal.answers.get("board", "")))
    if store.journal.answers.get("board_given") or not named.is_file():
        return False
    return load_board(named) != load_board(store.root / BOARD)


def _advised(made: dict[str, Calibration], name: str, calibration: Calibration) -> Mapping[str, Any]:
    """What to observe next after a camera's calibration, which is kept in `made` by the camera's name."""
    from estimator.budget.budget import next_observations

    made[name] = calibration
    return next_observations(calibration)


def _further_cameras(store: Store, ui: Ui, made: dict[str, Calibration]) -> bool:
    """Calibrate the further named cameras, each in a session of its own in cameras/NAME of this one, and solve all of
    them together for rig.json. Returns whether all were calibrated. made : calibrations by camera, the first one's
    for a start.

    Raises InputError for a name that is none, and for another antenna.
    """
    from vbaa_calib.calibrate.check.finding import FAILS
    from vbaa_calib.calibrate.pipeline import Calibration
    from vbaa_calib.calibrate.report import rig_document
    from vbaa_calib.rig import Rig
    from vbaa_calib.wizard.flow import walk
    from vbaa_calib.wizard.session_state import SessionState
    from vbaa_calib.wizard.steps import RIG
    from vbaa_calib.wizard.store import Store
    from vbaa_calib.wizard.ui import Interrupted
    from viz.report import check as report

    question, name = BY_KEY["another_camera"], ""
    names = _cameras_named(store.journal.answers)
    while True:
        try:
            if not names:
                answer = str(ui.ask(question)) if ui.interactive else "none"
                if answer == "none":
                    break
                named = {question.key: ",".join([*list(made)[1:], answer])}
                names = _cameras_named(named)[-1:]
                store.answer(named)
            name = names.pop(0)
            with Store(store.root / "cameras" / name) as own:
                if own.is_new:
                    own.answer(_of_all_cameras(store))
                ui.say(f"camera {name}: {own.root} continues")
                document = walk(SessionState(own), ui, report.page, partial(_advised, made, name))
            if document["verdict"] == FAILS:
                raise InputError(f"camera {name} is not taken into the rig: {document['words']}", where=own.root)
        except Interrupted:
            ui.say(f"stopped; the same command goes on with camera {name}")
            return False
    if len(made) > 1:
        ui.working("all cameras in one solve")
        guide = read_json(store.root / RIG)["quality"]["guide"]
        several = Calibration.together(made)
        write_json(store.root / RIG, rig_document(several, ["vbaa", "wizard"], guide), True, readable_as=Rig.from_dict)
        ui.say(f"{store.root / RIG} has the cameras {', '.join(made)}")
    return True


def _cameras_named(answers: Mapping[str, Any]) -> list[str]:
    """The names of the further cameras. Raises InputError for one that is none, or that comes twice."""
    found = ["camera"]
    for name in filter(None, str(answers.get("another_camera", "")).split(",")):
        if not re.fullmatch(r"[A-Za-z0-9_-]{1,32}", name.strip()) or name.strip() in found:
            remedy = "give each camera its own name of letters and digits, such as right"
            raise InputError(f"another_camera is {name.strip()!r}", remedy=remedy)
        found.append(name.strip())
    return found[1:]


def _of_all_cameras(store: Store) -> dict[str, Any]:
    """The answers of a session that apply to a further camera, too: board, jig, antenna and loads."""
    from vbaa_calib.wizard.session_state import BOARD

    of_one = {"source", "paper", "measure_x_mm", "measure_y_mm", "camera_distance_mm", "camera_inclination_deg"}
    of_one |= {"another_camera", "camera"} | {question.key for question in (*SOURCES, *TABLES, *OF_LENS_FILE)}
    kept = {key: value for key, value in store.journal.answers.items() if key not in of_one}
    return kept | {"board": str((store.root / BOARD).resolve())}


def _greeting(store: Store, session: Path, url: str) -> list[str]:
    """Paragraphs printed at the start. url : of the live page, "" for none."""
    from vbaa_calib.wizard.steps import STEP_BY_NAME

    titles = {name: step.title for name, step in STEP_BY_NAME.items()}
    lines = [
        "This calibrates a rig. You need: the camera, fixed and focused, its autofocus off; the antenna, with its "
        "moment sensor if it has one; a printer, a caliper or ruler, and something flat to glue the board on; three "
        "small known weights; about half an hour.",
        f"There are seven steps; each says what to do next. Everything that is taken is saved in {session}: you can "
        "stop at any time, and the same command continues.",
    ]
    if not store.is_new:
        record = {name: store.journal.of(name) for name in STEPS}
        done = [titles[name] for name in STEPS if record[name].closed]
        following = next((titles[name] for name in STEPS if not record[name].closed), titles[STEPS[-1]])
        counts = [f"{len(record[name].taken)} {words}" for name, words in PICTURES.items() if record[name].taken]
        parts = [f"{session} continues with: {following}."]
        parts += [f"Done: {', '.join(done)}."] if done else []
        parts += [f"Pictures: {', '.join(counts)}."] if counts else []
        lines = [" ".join(parts)]
    if url:
        lines.append(f"The same with the live picture, in a browser on this machine: {url}")
    return [*lines, "Type an answer, or press Enter for the one that is named; help lists the commands, quit stops."]


def _result(store: Store, document: Mapping[str, Any] | None) -> dict[str, Any]:
    from vbaa_calib.calibrate.check.finding import FAILS
    from vbaa_calib.wizard.steps import REPORT, RIG

    steps = {
        name: {"pictures": len(record.taken), "left": len(record.left), "closed": record.closed}
        for name, record in store.journal.steps.items()
    }
    result: dict[str, Any] = {"session": str(store.root), "complete": document is not None, "steps": steps}
    if document is None:
        return result
    return result | {
        "rig": str(store.root / RIG),
        "report": str(store.root / REPORT),
        "verdict": document["verdict"],
        "words": document["words"],
        "findings": [*document["session_findings"], *document["findings"]],
        "numbers": document["numbers"],
        "exit_code": int(document["verdict"] == FAILS),
    }
