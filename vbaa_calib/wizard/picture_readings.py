"""What was read with a picture: looked up where it was written down, else asked for, and doubted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..calibrate.diagnose import typed_load_doubts
from ..diagnosis import Diagnosis
from ..errors import InputError
from ..session import Load, Still, gravity_antenna
from .desk import Desk
from .known import Known, still_of
from .questions import Question
from .readings import Given, asked, complete, in_si, with_last

KEEP = Question("keep", "", "Keep these readings as they are?", kind="yesno", default="no")


def readings_of(known: Known, desk: Desk, step: str, given: Given, name: str) -> dict[str, float]:
    """Readings in SI of the picture `name`, none where the step has none to read.

    Raises InputError for readings that are missing or cannot be where nobody is there to be asked, and for given ones
    that cannot be; Interrupted for a command.
    """
    folder = known.store.folder(step)
    questions = asked(folder)
    if not questions:
        return {}
    row = given.of(name, len(known.taken(step)))
    where = f"{given.where or step} {name}"
    if row is not None:
        return _given(known, step, row, where)
    if not desk.interactive:
        names = ", ".join(question.key for question in questions)
        raise InputError(
            f"nothing says what was read with the picture ({names})",
            where=name,
            remedy=f"give --{step}-readings, a CSV with a column image, or write it in --answers FILE",
        )
    while True:
        desk.say(f"{name}: what was read with it?")
        typed = {question.key: desk.ask(question, {}) for question in _with_defaults(known, step, questions)}
        try:
            readings = _completed(known, folder, typed, where)
        except InputError as error:
            desk.wrong(f"{error.what}; {error.remedy}")
            continue
        doubts = _doubts(known, step, readings)
        for doubt in doubts:
            desk.say(str(doubt))
        if not doubts or desk.ask(KEEP, {}):
            return readings


def _given(known: Known, step: str, row: Mapping[str, Any], where: str) -> dict[str, float]:
    readings = _completed(known, known.store.folder(step), row, where)
    doubts = _doubts(known, step, readings)
    if doubts and doubts[0].grave:
        raise InputError(doubts[0].words, where=where, remedy=doubts[0].remedy)
    return readings


def _completed(known: Known, folder: str, typed: Mapping[str, Any], where: str) -> dict[str, float]:
    session, si = known.session, in_si(typed, where)
    still = Still(None, si.get("pan_rad", 0.0), si.get("tilt_rad", 0.0), 0.0)
    pull = gravity_antenna(session.kinematics, session.gravity_world_m_s2, [still])[0]
    return complete(folder, typed, pull, session.antenna.length_m, where)


def _doubts(known: Known, step: str, readings: Mapping[str, float]) -> list[Diagnosis]:
    """What was typed for a load that cannot be, or hardly, before anything is solved."""
    if step != "loads":
        return []
    load = still_of("loads", None, readings)
    assert isinstance(load, Load)
    return typed_load_doubts([load], known.session.antenna)


def _with_defaults(known: Known, step: str, questions: tuple[Question, ...]) -> list[Question]:
    """Joints stay where they were unless something else is typed."""
    last = known.taken(step)[-1:]
    return [with_last(question, last[0].readings) if last else question for question in questions]
