"""Consequences of a recording's diagnoses: rows that must not be used, findings in words, an exit code."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

from estimator.table.contacts import LOCATED, Contact, Measured
from vbaa_calib.core.errors import Diagnosis, Verdict
from vbaa_calib.rig import Rig

from .settings import RecordingSettings
from .watch import RecordingVerdict, RecordingWatch


def changed_row(verdict: RecordingVerdict, row: int, status: str, reason: str) -> tuple[str, str]:
    """Status and reason of a row under a recording's verdict: contradicted, with the cause, where that concerns the
    row and it has numbers or no contact."""
    if status not in (*LOCATED, "no_contact", "low_signal") or not verdict.concerns(row):
        return status, reason
    remedy = next((one.remedy for one in verdict.verdict.findings if one.grave), "")
    return "contradicted", f"{verdict.verdict.causes} (remedy: {remedy})"


def with_unused(found: RecordingVerdict, counts: Mapping[str, int], frames: int) -> RecordingVerdict:
    """A recording's verdict with the measurements that are not used in many of its frames, unless a known mistake
    may explain that.

    counts : `Overview.unused`.
    """
    if found.verdict.severity == "wrong":
        return found
    more = _unused_witnesses(counts, frames)
    return replace(found, verdict=Verdict.of([*found.verdict.findings, *more])) if more else found


def _unused_witnesses(counts: Mapping[str, int], frames: int) -> list[Diagnosis]:
    """Findings on measurements that contradict the rest of their frame, and are not used, in too many frames."""
    settings, found = RecordingSettings, list[Diagnosis]()
    for unused, whole, what, remedy in (
        (
            counts["ends_unused"],
            counts["ends_seen"],
            "the antenna's visible end lies off its place and is not used",
            "look at the end with --overlay, and check that the antenna has not slid in its clamp",
        ),
        (
            counts["outside_frames"],
            frames,
            "centreline points lie outside the picture and are left out",
            "check the tracker, and that the pictures have the size of the calibration",
        ),
        (
            counts["friction_beyond"],
            counts["friction_known"],
            "friction angles are beyond twice what --friction allows for, which makes distances worse than stated,",
            "give a larger --friction: 0.3 for dry metal, 0.5 for rubber",
        ),
    ):
        if whole >= settings.fewest_used and unused > settings.unused_share * whole:
            words = f"{what} in {unused} of {whole} frames"
            found.append(Diagnosis("witness_set_aside", words, remedy, "doubt"))
    return found


@dataclass(eq=False)
class RunningVerdict:
    """The verdict on a recording from its frames as they come, computed in a thread of its own.

    waits : whether frames wait for that, as those of a recording that lies on the disk may: the rows are then the same
        whenever it is done.
    """

    rig: Rig
    waits: bool = False
    now: RecordingVerdict = field(default_factory=RecordingVerdict)

    def __post_init__(self) -> None:
        self._watch, self._next = RecordingWatch(self.rig), RecordingSettings.judged
        self._thread: ThreadPoolExecutor | None = None
        self._coming: Future[RecordingVerdict] | None = None

    def push(self, measured: Measured, contact: Contact) -> None:
        """Add the next frame; `now` becomes the verdict on the earlier frames once that is computed."""
        self._watch.push(measured, contact)
        if self._coming is None and self._watch.count >= self._next:
            self._next = 2 * self._watch.count
            self._begin()
        if self._coming is not None and (self.waits or self._coming.done()):
            self._take()

    def finish(self) -> RecordingVerdict:
        """The verdict on all frames."""
        self._take()
        self._begin()
        self._take()
        if self._thread is not None:
            self._thread.shutdown()
        return self.now

    @property
    def count(self) -> int:
        """Number of frames so far."""
        return self._watch.count

    def _begin(self) -> None:
        self._thread = self._thread or ThreadPoolExecutor(1, "vbaa-verdict")
        self._coming = self._thread.submit(self._watch.snapshot().verdict)

    def _take(self) -> None:
        if self._coming is not None:
            self.now, self._coming = self._coming.result(), None
