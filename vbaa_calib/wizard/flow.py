"""From the first question to the verdict, step by step, onwards and backwards."""

from __future__ import annotations

from typing import Any

from ..errors import InputError, VbaaError
from .adopting import put_strangers_aside
from .asking import Earlier, answer_all
from .catalogue import BOARD_ANSWERS
from .desk import Command, Desk, Interrupted
from .journal import STEPS
from .known import Known
from .opening import ask_for_source, given_of, opened, source_text
from .questions import Question
from .sources import SourceLost
from .steps import board, lens, loads, noload, plane, sensor, verdict
from .steps.step import Step
from .store import Store
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
                return _concluded(known, desk)
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


def _concluded(known: Known, desk: Desk) -> dict[str, Any]:
    step, store = ALL[STEPS[-1]], known.store
    desk.show(step, step.look(known))
    known.write_files()
    # the calibration reads whole folders: what came into them meanwhile was judged by nobody
    put_strangers_aside(store, desk)
    desk.working("everything in one solve")
    try:
        return verdict.conclude(store.root)
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
        source = opened(known, desk, step)
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
            ask_for_source(known.store, desk, step)


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
