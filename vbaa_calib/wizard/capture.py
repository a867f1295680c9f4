"""The pictures of one step: wait for a scene at rest, check, ask for the readings, store."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from vbaa_calib.core.errors import Diagnosis, Disconnected, InputError
from vbaa_calib.core.images import read_gray
from vbaa_calib.detect.quality.settings import QualitySettings
from vbaa_calib.diagnose.typed_loads import typed_load_diagnoses
from vbaa_calib.session import Load
from vbaa_calib.sources import Picture, PictureSource

from .against_answers import jig_moved
from .asking import show_axes
from .questions import PICTURES, Question, ReadingsTable, asked, in_si, split_line, typed
from .session_state import SessionState, still_of
from .steps import PictureCheck, Progress, Readings, Step
from .stillness import ON_A_STAND, StillnessDetector
from .ui import Interrupted, LivePicture, Ui

GO_ON = Question(
    "go_on", "", "Go on with the next step?", "no: more pictures may be taken", kind="yesno", default="yes"
)


@dataclass
class Capture:
    """Takes a step's pictures. declined : whether the user wants more although there are enough."""

    state: SessionState
    ui: Ui
    step: Step
    source: PictureSource
    table: ReadingsTable = field(default_factory=ReadingsTable)
    declined: bool = False

    def __post_init__(self) -> None:
        self.store = self.state.store
        # a board is in a hand, the antenna on a stand
        self.detector = StillnessDetector(None if self.step.name in ("lens", "plane") else ON_A_STAND)
        # the jig is photographed several times unmoved, all else in another pose
        self.as_it_stands = self.store.folder(self.step.name) == "plane"
        self.progress: Progress | None = None
        self.pending: Picture | None = None
        self.by_hand, self.noted = False, 0
        self.refused_for: frozenset[str] | None = None
        self.answers, self.wanted = self.store.journal.answers, ""
        self.match: str = ""
        self.unused: dict[str, Any] = {}  # typed for a picture that was then left out
        record = self.store.journal.of(self.step.name)
        self.taken_before = {one.source for one in record.taken}
        self.refused_before = {one.source for one in record.left}

    def run(self) -> str:
        """Takes pictures until the step ends: returns "closed", "again" (an answer was changed) or a command that
        leaves it.

        Raises Disconnected, also where the source has ended before the step had enough pictures; InputError.
        """
        self._show_last()
        while True:
            try:
                ended = self._once()
            except Interrupted as interrupt:
                ended = self._obey(interrupt.command)
            if ended is not None:
                return ended

    def _once(self) -> str | None:
        """Handle pending commands, then one picture. Raises Interrupted for a command in reply to a question."""
        self._pass_notes()
        # progress is of use while pictures come: somebody is there, or the next picture depends on it
        if self.progress is None and (self.ui.interactive or (self.source.live and not self.source.ended)):
            self.ui.working("how well the pictures determine the result, and which one to take next")
            self.progress = self._advised(self.step.progress(self.state))
            self.ui.show(self.step, self.progress)
            if self.progress.enough and not self.declined:
                if self.ui.interactive:
                    self.ui.say("enough: on with the next step; back returns to this one")
                return self._close("enough")
        before = self.state.inputs(*PICTURES)
        for command in self.ui.commands():
            if (ended := self._obey(command)) is not None:
                return ended
        if self.store.journal.answers != self.answers:
            return "again"
        if self.state.inputs(*PICTURES) != before:  # readings were corrected
            self.progress = None
            return None
        picture = self.pending or self.source.next(0.2)
        if picture is not None and self.source.live and picture is not self.pending:
            self._watch(picture)
        elif picture is not None:
            self._decide(picture)
        elif self.source.ended:
            self._pass_notes()
            progress = self.step.progress(self.state)
            self.ui.show(self.step, progress)
            if not progress.usable:
                raise self._too_few(progress)
            return self._close("all pictures seen")
        return None

    def _too_few(self, progress: Progress) -> Disconnected:
        """The error of a source that has ended: what is missing, and why most of its pictures were left out."""
        what = f"{self.step.title}: {'; '.join(progress.missing) or 'no picture'}"
        remedy = f"add pictures there and run it again: {progress.next}"
        refused = Counter(one.why for one in self.store.journal.of(self.step.name).left)
        if refused:
            (why, count), *_ = refused.most_common(1)
            what += f"; {refused.total()} left out, {count} of them because: {why}"
            remedy = "mend that, or " + remedy
        for one in progress.diagnoses:
            if one.grave:
                what, remedy = f"{what}; {one.words}", f"{one.remedy}; or {remedy}"
        return Disconnected(what, where=self.source.name, remedy=remedy)

    def _pass_notes(self) -> None:
        for note in self.source.notes[self.noted :]:
            self.ui.say(note)
        self.noted = len(self.source.notes)

    def _show_last(self) -> None:
        """Show the step's last picture unless a stream is on."""
        if self.source.live or not self.ui.interactive or not (taken := self.state.taken(self.step.name)):
            return
        path = self.store.path(taken[-1])
        picture = Picture(path.name, read_gray(path), path.suffix, b"")
        self.ui.live(LivePicture(picture.image, self._check(picture, None), 0.0, taken[-1].source, live=False))

    def _advised(self, progress: Progress) -> Progress:
        """The progress, with the reason added to advice that is repeated."""
        before, self.wanted = self.wanted, progress.next
        if progress.next and progress.next == before and self.match and progress.target is not None:
            return replace(progress, next=f"still the pose suggested before: {self.match}")
        return progress

    def _obey(self, command: str) -> str | None:
        """Execute a command; returns it if it leaves the step."""
        if command == "enough":
            progress = self.step.progress(self.state)
            if progress.usable:
                return self._close("by hand")
            self.ui.say(f"not yet: {'; '.join(progress.missing) or 'nothing was taken'}")
        elif command == "drop" and self.pending is not None:
            self._refuse(self.pending, "not wanted")
        elif command == "drop" and not (taken := self.state.taken(self.step.name)):
            self.ui.say("nothing to take back")
        elif command == "drop":
            self.ui.say(f"{taken[-1].file} is set aside: {self.store.drop(self.step.name, taken[-1])}")
            self.progress = None
        elif command == "take":
            self.by_hand = True
        else:
            return command
        return None

    def _watch(self, picture: Picture) -> None:
        height, width = picture.image.shape
        if (width, height) != self.state.live_size:
            # the pose to show next is suggested for pictures of this size
            self.state.live_size, self.progress = (width, height), None
        check = self._check(picture, None)
        assert picture.time_s is not None
        share, take, words = self.detector.feed(picture.image, picture.time_s, check.corners_px, check.ids)
        self.ui.live(LivePicture(picture.image, check, share, words))
        if take and self._jig_begins(check):
            check = self._check(picture, None)
        by_hand, self.by_hand = self.by_hand, False
        if not take and not by_hand:
            return
        # a video that is seen again holds still where it did before
        if picture.name in self.refused_before:
            self.detector.rearm()
        elif picture.name not in self.taken_before:
            if check.refusal and not by_hand:
                # reported once, with the slow search for more reasons; not stored, for others like it follow
                why = frozenset(hint.name for hint in check.hints if hint.grave)
                if why != self.refused_for:
                    self.refused_for = why
                    self.ui.say(f"not taken: {self._check(picture, {}).refusal or 'try again'}")
                self.detector.rearm()
            else:
                self._decide(picture)
        if self.as_it_stands:
            self.detector.rearm()

    def _jig_begins(self, check: PictureCheck) -> bool:
        """Whether the board has moved since the earlier pictures, so that this is the first one in its jig; the earlier
        ones are archived."""
        if not self.as_it_stands or (self.progress is not None and self.progress.enough):
            return False
        how = (
            jig_moved(self.state, check.corners_px, check.ids)
            if len(check.ids) >= QualitySettings.least_corners
            else ""
        )
        for taken in self.state.taken(self.step.name) if how else ():
            self.ui.say(f"set aside {taken.file}: the board has moved {how} since, so it was not in its jig yet")
            self.store.drop(self.step.name, taken)
            self.progress = None
        return bool(how)

    def _check(self, picture: Picture, readings: Readings | None) -> PictureCheck:
        assert self.step.check is not None
        return self.step.check(self.state, picture, readings)

    def _decide(self, picture: Picture) -> None:
        """Accept or refuse a picture; it is stored when this returns, pending until then."""
        name, self.pending = self.step.name, picture
        taken_anywhere = (one for step in PICTURES for one in self.state.taken(step))
        twin = next((one for one in taken_anywhere if one.sha256 == picture.sha256), None)
        if twin is not None:
            self._refuse(picture, f"is the same picture as {twin.file}")
            return
        readings = self._readings_of(picture)
        check = self._check(picture, readings)
        if not self.source.live:
            words = f"{picture.name}: {check.refusal or check.words}"
            self.ui.live(LivePicture(picture.image, check, 0.0, words, live=False))
        if check.refusal:
            self._refuse(picture, check.refusal)
            return
        taken = self.store.take(name, picture, readings)
        self.pending, self.unused = None, {}
        self.taken_before.add(picture.name)
        self.state.write_files()
        self.ui.say(f"took      {picture.name} as {taken.file}{f', {check.words}' if check.words else ''}")
        share = 100 * (check.closeness or 0.0)
        self.match = check.closer and f"the last picture was {share:.0f} % like it; next time {check.closer}"
        if self.as_it_stands:
            show_axes(self.state, self.ui, picture)
        self.progress = None

    def _readings_of(self, picture: Picture) -> dict[str, float]:
        """A picture's readings in SI units, from the table or by asking; empty if the step has none.

        Nothing is asked about a picture that cannot be taken; a line typed for one that was left out is offered again.

        Raises InputError for a wrong row, and for missing readings where nobody answers; Interrupted for a command.
        """
        step, ui, taken = self.step.name, self.ui, self.state.taken(self.step.name)
        questions = asked(self.store.folder(step), [one.readings for one in taken], self.state.session.columns)
        if not questions:
            return {}
        where = f"{self.table.where or step} {picture.name}"
        row = self.table.of(picture.name, len(taken))
        if row is not None:
            readings, doubts = self._judged(row, where)
            if doubts and doubts[0].grave:
                raise InputError(doubts[0].words, where=where, remedy=doubts[0].remedy)
            return readings
        if not ui.interactive:
            what = f"the readings of the picture are missing ({', '.join(question.key for question in questions)})"
            remedy = f"give --{step}-readings, a CSV with a column image, or write it in --answers FILE"
            raise InputError(what, where=picture.name, remedy=remedy)
        if self._check(picture, None).refusal:
            return {}
        question = _line_of(questions, picture.name)
        if self.unused:
            question = replace(question, default=[self.unused[one.key] for one in questions])
        # lines of readings asked for before a picture is left out: a weight on a tilted antenna has none
        for tries in reversed(range(5)):
            line = ui.ask(question)
            try:
                typed = split_line(questions, line)
                readings, doubts = self._judged(typed, where)
            except InputError as error:
                then = "type it again, or `drop` to leave this picture out" if tries else "this picture is left out"
                ui.wrong(f"{error.what}; {error.remedy}; {then}")
                continue
            if not doubts or ui.keeps(doubts):
                self.unused = typed
                return readings
        raise Interrupted("drop")

    def _judged(self, typed: Mapping[str, Any], where: str) -> tuple[dict[str, float], list[Diagnosis]]:
        """Readings in the form of the session's tables, and doubts about a load."""
        readings = self.state.readings(self.step.name, typed, where)
        load = still_of(self.step.name, None, readings) if self.step.name == "loads" else None
        if not isinstance(load, Load):
            return readings, []
        antenna = self.state.session.antenna
        # material and diameter before units: another antenna bends otherwise under every load
        first = f"is the antenna of {antenna.material or f'{1e-9 * antenna.youngs_modulus_Pa:g} GPa'}"
        first += f" and {1e3 * antenna.diameter_m:g} mm thick? If so: "
        doubts = [replace(one, remedy=first + one.remedy) for one in typed_load_diagnoses([load], antenna)]
        return readings, [*doubts, *self._of_weights(typed)]

    def _of_weights(self, line: Mapping[str, Any]) -> list[Diagnosis]:
        """Whether a mass is one of the available weights, or a sum of several."""
        mass_g = 1e3 * in_si(line, None).get("mass_kg", 0.0)
        weights = self.store.journal.answers.get("weights_g") or []
        sums = {0.0}
        for weight in weights[:10]:
            sums |= {each + weight for each in sums}
        if not mass_g or any(abs(each - mass_g) <= 0.05 * mass_g for each in sums):
            return []
        words = f"{mass_g:g} g is none of the weights ({typed(weights)} g)"
        remedy = "type it in grams, or with its unit, like 0.05 kg; or is material or diameter another than typed?"
        return [Diagnosis("load_not_of_weights", words, remedy)]

    def _refuse(self, picture: Picture, why: str) -> None:
        self.store.refuse(self.step.name, picture, why)
        self.pending = None
        self.refused_before.add(picture.name)
        self.ui.say(f"left      {picture.name}: {why}")
        self.detector.rearm()

    def _close(self, how: str) -> str:
        self.store.close(self.step.name, how)
        return "closed"


def _line_of(questions: Sequence[Question], picture: str) -> Question:
    """A single question for all readings of a picture, to be answered in one line."""
    names = ", ".join(f"{question.words.lower()} ({question.unit})" for question in questions)
    kept = [question for question in questions if question.default is not None]
    default = [question.default for question in questions] if len(kept) == len(questions) else None
    angles = ", ".join(f"{question.key.removesuffix('_deg')} {question.default:g}°" for question in kept)
    why = f"in one line, blanks between the numbers; without the angles they are {angles}" if kept else ""
    return Question("readings", "", f"{picture}: {names}?", why, kind="numbers", default=default)
