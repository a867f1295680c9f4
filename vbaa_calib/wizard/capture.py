"""Pictures for one step: offered, held still, judged, read, kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vbaa_calib.calibrate.faults.typed_loads import typed_load_diagnoses
from vbaa_calib.core.errors import Diagnosis, InputError
from vbaa_calib.session import Load, Still, gravity_antenna
from vbaa_calib.wizard.state.progress import Judged, Progress
from vbaa_calib.wizard.state.questions import Question
from vbaa_calib.wizard.state.readings import Given, asked, complete, in_si, with_last
from vbaa_calib.wizard.state.session_state import Known, still_of
from vbaa_calib.wizard.steps.step import Step
from vbaa_calib.wizard.ui.interface import Command, Desk, Interrupted, Live

from .sources import Offered, Source
from .still import ON_A_STAND, StillGate

KEEP = Question("keep", "", "Keep these readings as they are?", kind="yesno", default="no")


def _readings_of(known: Known, desk: Desk, step: str, given: Given, name: str) -> dict[str, float]:
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
    return typed_load_diagnoses([load], known.session.antenna)


def _with_defaults(known: Known, step: str, questions: tuple[Question, ...]) -> list[Question]:
    """Joints stay where they were unless something else is typed."""
    last = known.taken(step)[-1:]
    return [with_last(question, last[0].readings) if last else question for question in questions]


WAIT_S = 0.2
GO_ON = Question(
    "go_on", "", "Go on with the next step?", "no: more pictures may be taken", kind="yesno", default="yes"
)


class NoMore(InputError):
    """The source has ended, and what it gave is not enough to go on."""


@dataclass
class Taking:
    """A step's pictures being taken. `run` comes back with how it ended: closed, or a command that leaves the step."""

    known: Known
    desk: Desk
    step: Step
    source: Source
    given: Given
    declined: bool = False

    def __post_init__(self) -> None:
        self.store = self.known.store
        # a board is in a hand, the antenna on a stand
        self.gate = StillGate(None if self.step.name in ("lens", "plane") else ON_A_STAND)
        # a jig is taken several times as it stands, all else in another pose
        self.as_it_stands = self.store.folder(self.step.name) == "plane"
        self.progress: Progress | None = None
        self.pending: Offered | None = None
        self.by_hand, self.noted = False, 0
        self.doubts: frozenset[str] | None = None
        record = self.store.journal.of(self.step.name)
        self.taken_before = {one.source for one in record.taken}
        self.left_before = {one.source for one in record.left}

    @property
    def watched(self) -> bool:
        """Whether progress is of use while pictures come: somebody is there, or the next picture hangs on it."""
        return self.desk.interactive or (self.source.live and not self.source.ended)

    def run(self) -> Command:
        """Until the step is closed, or a command leaves it."""
        while True:
            try:
                ended = self._once()
            except Interrupted as interrupt:
                ended = self._obeyed(interrupt.command)
            if ended is not None:
                return ended

    def _once(self) -> Command | None:
        """What came meanwhile, and one picture. Raises Interrupted for a command where something was asked."""
        self._pass_notes()
        if self.progress is None and self.watched:
            self._look()
            if self._is_enough():
                return self._closed("enough")
        for command in self.desk.commands():
            ended = self._obeyed(command)
            if ended is not None:
                return ended
        offered = self.pending or self.source.next(WAIT_S)
        if offered is not None:
            self._offered(offered)
        elif self.source.ended:
            self._pass_notes()
            return self._all_seen()
        return None

    def _pass_notes(self) -> None:
        for note in self.source.notes[self.noted :]:
            self.desk.say(note)
        self.noted = len(self.source.notes)

    def _look(self) -> None:
        self.desk.working("what the pictures are worth, and which one to take next")
        self.progress = self.step.look(self.known)
        self.desk.show(self.step, self.progress)

    def _is_enough(self) -> bool:
        assert self.progress is not None
        if not self.progress.enough or self.declined:
            return False
        if not self.desk.interactive:
            return True
        try:
            self.declined = not self.desk.ask(GO_ON, {})
        except Interrupted as interrupt:
            if interrupt.command.kind != "enough":
                raise
        if self.declined:
            self.desk.say("more pictures, then; enough goes on when you are done")
        return not self.declined

    def _obeyed(self, command: Command) -> Command | None:
        """Do what is wanted. Returns the command where it leaves the step."""
        if command.kind == "enough":
            progress = self.step.look(self.known)
            if progress.usable:
                return self._closed("by hand")
            self.desk.say(f"not yet: {'; '.join(progress.missing) or 'nothing was taken'}")
            return None
        if command.kind == "drop" and self.pending is not None:
            self._left(self.pending, "not wanted")
            return None
        if command.kind == "drop":
            taken = self.known.taken(self.step.name)
            if taken:
                self.desk.say(f"{taken[-1].file} is put aside: {self.store.drop(self.step.name, taken[-1])}")
                self.progress = None
            else:
                self.desk.say("nothing to take back")
            return None
        if command.kind == "take":
            self.by_hand = True
            return None
        return command

    def _offered(self, offered: Offered) -> None:
        if not self.source.live or offered is self.pending:
            self._decide(offered)
            return
        height, width = offered.image.shape
        if (width, height) != self.known.live_size:
            # what is to be shown next is told for pictures of this size
            self.known.live_size, self.progress = (width, height), None
        judged = self._judged(offered, None)
        assert offered.time_s is not None
        held = self.gate.feed(offered.image, offered.time_s, judged.corners_px, judged.ids)
        self.desk.live(self.step, Live(offered.image, judged, held.share, held.words))
        by_hand, self.by_hand = self.by_hand, False
        if not held.take and not by_hand:
            return
        # a video that is seen again holds still where it did before
        if offered.name in self.left_before:
            self.gate.rearm()
        elif offered.name not in self.taken_before:
            if judged.refusal and not by_hand:
                self._doubted(offered, frozenset(hint.name for hint in judged.hints if hint.grave))
            else:
                self._decide(offered)
        if self.as_it_stands:
            self.gate.rearm()

    def _doubted(self, offered: Offered, why: frozenset[str]) -> None:
        """A frame that is held still, but is not good: said once, not kept in mind, for others like it follow.

        why : the preview's reasons. The slow search for more is made when they are others than before.
        """
        if why != self.doubts:
            self.doubts = why
            self.desk.say(f"not taken: {self._judged(offered, {}).refusal or 'try again'}")
        self.gate.rearm()

    def _judged(self, offered: Offered, readings: Mapping[str, float] | None) -> Judged:
        assert self.step.judge is not None
        return self.step.judge(self.known, offered, readings)

    def _decide(self, offered: Offered) -> None:
        """Take a picture or leave it: on the disk when this returns, pending till then."""
        name, self.pending = self.step.name, offered
        twin = next((one for one in self.known.taken(name) if one.sha256 == offered.sha256), None)
        if twin is None:
            readings = _readings_of(self.known, self.desk, name, self.given, offered.name)
            judged = self._judged(offered, readings)
        else:
            readings, judged = {}, Judged(f"is the same picture as {twin.file}")
        if judged.refusal:
            self._left(offered, judged.refusal)
            return
        taken = self.store.take(name, offered, readings)
        self.pending = None
        self.taken_before.add(offered.name)
        self.known.write_files()
        self.desk.say(f"took      {offered.name} as {taken.file}{f', {judged.words}' if judged.words else ''}")
        self.progress = None

    def _left(self, offered: Offered, why: str) -> None:
        self.store.leave(self.step.name, offered, why)
        self.pending = None
        self.left_before.add(offered.name)
        self.desk.say(f"left      {offered.name}: {why}")
        self.gate.rearm()

    def _closed(self, how: str) -> Command:
        self.store.close(self.step.name, how)
        return Command("closed")

    def _all_seen(self) -> Command:
        """The source has no more."""
        progress = self.step.look(self.known)
        self.desk.show(self.step, progress)
        if not progress.usable:
            raise NoMore(
                f"{self.step.title}: {'; '.join(progress.missing) or 'no picture'}",
                where=self.source.name,
                remedy=f"add pictures there and run it again: {progress.next}",
            )
        return self._closed("all pictures seen")
