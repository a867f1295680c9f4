"""`vbaa wizard SESSION`: guided, resumable calibration."""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vbaa_calib.wizard.state.catalogue import BOARD_ANSWERS, QUESTIONS, SOURCES, TABLES
from vbaa_calib.wizard.state.journal import PICTURES, STEPS, Journal

if TYPE_CHECKING:
    from vbaa_calib.wizard.state.session_state import Known
    from vbaa_calib.wizard.state.store import Store
    from vbaa_calib.wizard.ui.interface import Desk


def _greeting(store: Store, session: Path, page: str, titles: Mapping[str, str]) -> list[str]:
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


_OPTIONS = (*QUESTIONS, *SOURCES, *TABLES)
_PATHS = {"board", "source"} | {question.key for question in (*SOURCES, *TABLES)}
_LAST_PORT = 65535


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `vbaa wizard`: one for every question."""
    parser.add_argument("session", type=Path, help="the session folder: made if it is new, gone on with if it is not")
    parser.add_argument("--answers", type=Path, metavar="FILE", help="YAML or JSON with answers by their keys")
    parser.add_argument(
        "--redo", choices=STEPS[:-1], metavar="STEP", help=f"start a step again: {', '.join(STEPS[:-1])}"
    )
    parser.add_argument("--reopen", choices=STEPS[:-1], metavar="STEP", help="go on with a step that was closed")
    parser.add_argument("--batch", action="store_true", help="ask nothing and never wait, as without a terminal")
    parser.add_argument("--no-page", action="store_true", help="no live page beside the terminal")
    parser.add_argument("--port", type=int, default=0, help="of the live page on 127.0.0.1 (default: any that is free)")
    group = parser.add_argument_group(
        "answers",
        "each is asked for in a terminal where it is not given; a value that begins with a minus needs an equals sign, "
        "like --jig-board-y=-y",
    )
    for question in _OPTIONS:
        unit = f" ({question.unit})" if question.unit else ""
        choices = f": {', '.join(question.choices)}" if question.choices else ""
        words = question.words.replace("{measure_x_mm:.6g} mm", "so much").replace("{measure_y_mm:.6g} mm", "so much")
        words = words.replace("{measured_x}", "the ruler along x").replace("{measured_y}", "the ruler along y")
        told = (words + choices + unit).replace("%", "%%")
        group.add_argument(question.flag, dest=f"answer_{question.key}", metavar="...", help=told)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Walk through the steps. Returns the verdict and where everything is.

    Raises InputError for whatever is wrong or missing, where nobody is there to be asked; VbaaError for a disk that is
    full or gone.
    """
    from vbaa_calib.core.console import say
    from vbaa_calib.core.errors import InputError, VbaaError
    from vbaa_calib.wizard.state.session_state import Known
    from vbaa_calib.wizard.state.store import Store

    if not 0 <= args.port <= _LAST_PORT:
        raise InputError(f"there is no port {args.port}", where="--port", remedy=f"0 for any, or up to {_LAST_PORT}")
    given = _answers_given(args)
    try:
        with Store(args.session) as store:
            return _run(args, store, Known(store), given)
    except KeyboardInterrupt:
        say(f"stopped; `vbaa wizard {args.session}` goes on here, with all that it said it took")
        raise
    except BrokenPipeError:
        raise
    except OSError as error:
        where, why = error.filename or args.session, error.strerror or error
        remedy = "make room or mend that, and run it again: it goes on with all that it said it took"
        raise VbaaError(f"{where}: cannot be read or written ({why}); {remedy}") from error


def _answers_given(args: argparse.Namespace) -> dict[str, Any]:
    """Answers of --answers and of flags, which win; checked. Raises InputError."""
    from vbaa_calib.core.errors import InputError
    from vbaa_calib.core.files import read_yaml
    from vbaa_calib.wizard.asking import absolute
    from vbaa_calib.wizard.state.readings import from_list

    known = {question.key: question for question in _OPTIONS}
    found: dict[str, Any] = {}
    for key, value in (read_yaml(args.answers) if args.answers else {}).items():
        if key not in known:
            close = difflib.get_close_matches(str(key), known, n=1)
            remedy = f"do you mean {close[0]}?" if close else f"the keys are {', '.join(known)}"
            raise InputError(f"unknown key {key!r}", where=args.answers, remedy=remedy)
        if key in {question.key for question in TABLES} and isinstance(value, list):
            from_list(value, f"{args.answers}: {key}")
            found[key] = value
        else:
            found[key] = known[key].read(value, args.answers)
        if key in _PATHS and isinstance(found[key], str):
            found[key] = absolute(args.answers.parent, found[key])
    for key, question in known.items():
        value = getattr(args, f"answer_{key}")
        if value is not None:
            found[key] = question.read(value, question.flag)
            if key in _PATHS:
                found[key] = absolute(Path(), found[key])
    return found


def _run(args: argparse.Namespace, store: Store, known: Known, given: Mapping[str, Any]) -> dict[str, Any]:
    from vbaa_calib.wizard.adopting import adopt, put_strangers_aside
    from vbaa_calib.wizard.asking import check_together
    from vbaa_calib.wizard.flow import ALL, Quit, redo, walk
    from vbaa_calib.wizard.steps.verdict import REPORT
    from vbaa_calib.wizard.ui.interface import Nobody
    from vbaa_calib.wizard.ui.page import Page
    from vbaa_calib.wizard.ui.terminal import Terminal
    from viz.report import check as check_page

    # without one of them where they were closed
    attended = not args.batch and all(stream is not None and stream.isatty() for stream in (sys.stdin, sys.stderr))
    page, titles = None, {name: step.title for name, step in ALL.items()}
    if attended and not args.no_page:
        page = Page(store, titles, known.lens_corners, args.port)
    desk: Desk = Terminal(page) if attended else Nobody()
    try:
        desk.greet(_greeting(store, args.session, "" if page is None else page.url, titles))
        adopt(store, desk)
        # first: a picture that was changed is a stranger from then on
        _forget_lost(store, desk)
        put_strangers_aside(store, desk)
        check_together(_merged(store.journal.answers, given))
        _reopen(store, desk, given)
        # first: what is given now is meant for the step as it starts again
        if args.redo:
            redo(store, desk, args.redo)
        store.answer(given)
        if args.reopen:
            store.open(args.reopen)
        try:
            document = walk(known, desk, check_page.page)
        except Quit:
            desk.say(f"stopped; `vbaa wizard {args.session}` goes on here")
            return _told(store, None)
        desk.done(document, str(store.root / REPORT))
        if attended and page is not None:
            _linger(desk)
        return _told(store, document)
    finally:
        desk.close()


def _reopen(store: Store, desk: Desk, given: Mapping[str, Any]) -> None:
    """Another board, or another way to plane C, starts that step again."""
    from vbaa_calib.wizard.flow import redo

    before = store.journal.answers
    if given.get("plane_way", before.get("plane_way")) != before.get("plane_way") and store.journal.of("plane").taken:
        redo(store, desk, "plane")
    if _is_another_board(before, given):
        redo(store, desk, "board")


def _is_another_board(before: Mapping[str, Any], given: Mapping[str, Any]) -> bool:
    keys = ("board", "paper") if given.get("board", before.get("board")) == "new" else ("board",)
    return "measure_x_mm" in before and any(key in given and given[key] != before.get(key) for key in keys)


def _merged(before: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """All answers as they will be; what was measured on another board is none of them."""
    stale = BOARD_ANSWERS if _is_another_board(before, given) else ()
    return {key: value for key, value in before.items() if key not in stale} | dict(given)


def _forget_lost(store: Store, desk: Desk) -> None:
    lost = store.missing()
    if lost:
        store.forget(lost)
        names = ", ".join(one.file for one in lost[:5]) + (" ..." if len(lost) > 5 else "")
        desk.say(f"{len(lost)} pictures are gone or have changed, the wizard goes on without them: {names}")


def _linger(desk: Desk) -> None:
    """Keep the page up until it was read."""
    from vbaa_calib.wizard.state.questions import Question
    from vbaa_calib.wizard.ui.interface import Interrupted

    try:
        desk.ask(Question("read", "", "Press Enter when you have read the report", kind="text", default="done"), {})
    except Interrupted:
        return


def _told(store: Store, document: Mapping[str, Any] | None) -> dict[str, Any]:
    """For --json."""
    from vbaa_calib.wizard.steps.verdict import REPORT, RIG

    steps = {
        name: {"pictures": len(record.taken), "left": len(record.left), "closed": record.closed}
        for name, record in store.journal.steps.items()
    }
    told: dict[str, Any] = {"session": str(store.root), "complete": document is not None, "steps": steps}
    if document is None:
        return told
    return told | {
        "rig": str(store.root / RIG),
        "report": str(store.root / REPORT),
        "verdict": document["verdict"],
        "words": document["words"],
        "findings": [*document["session_findings"], *document["findings"]],
        "numbers": document["numbers"],
    }
