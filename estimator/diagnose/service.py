"""Monitoring of a rig in use: frames as they come, an alarm once they indicate a change since the calibration."""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from operator import itemgetter

from estimator.table.contacts import LOCATED, Contact, Measured
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.rig import Rig

from .changes import CHANGES
from .hypotheses import ERRORS
from .watch import RecordingVerdict, RecordingWatch


@dataclass(frozen=True)
class WatchSettings:
    """Which frames are judged together, how often, and from which odds there is an alarm."""

    without_contact: int = 40  # last frames without a contact
    with_contact: int = 20  # last frames with one
    every: int = 6  # frames after which they are judged again
    confirmed: int = 2  # successive judgements that name the same part before it is an alarm
    least_log_odds: float = 16.0  # of a change over "as calibrated": 1e-7 where that is right
    share: float = 0.1  # of one core's time that judging may take, where frames do not wait for it


@dataclass(eq=False)
class RigWatch:
    """Judges the frames of a rig in use in a thread of its own: a camera that was knocked or refocused, a clamp that
    gave way, a bent or exchanged antenna, a sensor with another zero or gain, or a dead one.

    The last frames are judged together by the hypotheses that a recording's verdict compares (`RecordingWatch`), each
    camera's by themselves. A part of the rig (`Change.part`) is named once, until a later judgement is
    without it.

    Attributes
    ----------
    alarm : called with the frame's number, from 0, and what has changed; in the caller's thread.
    waits : whether frames wait for the judgement, as those of a recording may: alarms then come at the same frames
        whenever it is run.
    alarms : all so far.
    """

    rig: Rig
    alarm: Callable[[int, Diagnosis], None] | None = None
    waits: bool = False
    alarms: list[tuple[int, Diagnosis]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.count = 0
        self._kept = [
            deque[tuple[int, Measured, Contact]](maxlen=most)
            for most in (WatchSettings.without_contact, WatchSettings.with_contact)
        ]
        self._next, self._rests_until_s, self._named = WatchSettings.every, 0.0, ""
        self._part, self._times = "", 0  # part named by the last judgements, and the number of these in a row
        self._thread: ThreadPoolExecutor | None = None
        self._coming: Future[tuple[RecordingVerdict, str, float]] | None = None

    def push(self, measured: Measured, contact: Contact) -> list[Diagnosis]:
        """Add the next frame. Returns the changes found in the frames so far and not reported before."""
        self._kept[contact.status in LOCATED].append((self.count, measured, contact))
        self.count += 1
        if self._coming is None and self.count >= self._next and time.monotonic() >= self._rests_until_s:
            self._next = self.count + WatchSettings.every
            self._thread = self._thread or ThreadPoolExecutor(1, "vbaa-watch")
            frames = sorted([*self._kept[0], *self._kept[1]], key=itemgetter(0))
            self._coming = self._thread.submit(self._judged, frames)
        if self._coming is None or not (self.waits or self._coming.done()):
            return []
        (found, camera, took_s), self._coming = self._coming.result(), None
        if not self.waits:
            self._rests_until_s = time.monotonic() + took_s * (1.0 / WatchSettings.share - 1.0)
        return self._news(found, camera)

    def close(self) -> None:
        """Wait for the judgement in progress."""
        if self._thread is not None:
            self._thread.shutdown()

    def _judged(self, frames: list[tuple[int, Measured, Contact]]) -> tuple[RecordingVerdict, str, float]:
        """The surest camera's verdict on some frames, its name where there are several, and the time it took, s."""
        begin_s, judged = time.monotonic(), list[tuple[RecordingVerdict, str]]()
        for name, one in self.rig.cameras.items():
            watch = RecordingWatch(one, series=False)
            for _, measured, contact in frames:
                watch.push(measured.of_camera(name) if name in self.rig.others else measured, contact)
            judged.append((watch.verdict(), name if self.rig.others else ""))
        found, camera = max(judged, key=lambda each: each[0].log_odds)
        prefix = f"{camera}: " if camera else ""
        # of the stream's frames, not of those that are judged
        named = [
            replace(
                one,
                words=prefix
                + re.sub(r"from row (\d+) on", lambda row: f"from frame {frames[int(row[1])][0]} on", one.words),
            )
            for one in found.verdict.findings
        ]
        verdict = replace(found.verdict, findings=tuple(named))
        return replace(found, verdict=verdict), camera, time.monotonic() - begin_s

    def _news(self, found: RecordingVerdict, camera: str) -> list[Diagnosis]:
        """The cause to report: sure, of one part of the rig several times in a row, and not reported yet; else none."""
        sure = found.log_odds >= WatchSettings.least_log_odds
        # that something of the camera has changed shows before which of its parameters
        parts = {row.name: row.part for row in (*CHANGES, *ERRORS) if row.part}
        parts |= dict.fromkeys(("moment_dead", "moment_stuck", "moment_unexplained"), "sensor")
        cause = next((one for one in found.verdict.findings if sure and one.grave and one.name in parts), None)
        part = "" if cause is None else parts[cause.name]
        part = f"{part} {camera}".strip() if part == "camera" else part
        self._times = self._times + 1 if part == self._part else 1
        self._part = part
        if cause is None or self._times < WatchSettings.confirmed or part == self._named:
            self._named = self._named if part else ""
            return []
        self._named = part
        self.alarms.append((self.count - 1, cause))
        if self.alarm is not None:
            self.alarm(self.count - 1, cause)
        return [cause]
