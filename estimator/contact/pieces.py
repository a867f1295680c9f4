"""A recording in pieces, which make bit for bit the rows that it makes as a whole, on whatever machines.

What a frame's row takes from others is handed on from piece to piece: the frames before tell which of two lines is the
antenna (`look`), free frames how the rig has changed (`learn`), neighbours whether the antenna moves (`RowMaker`). The
solver's search (`solve`), which takes the time, begins afresh every `AFRESH` frames, where alone a recording is cut.

    look      look      look            pieces at once
      │         │         │
    learn  →  learn  →  learn           one after the other, quick
      │         │         │
    solve     solve     solve           pieces at once
      │         │         │
    rows   →  rows   →  rows            one after the other, quick
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.table.contacts import Contact, ContactRow, Measured
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame, Shutter

from .contacts import MotionCheck, MovingContacts, last
from .drift import LearntRig
from .estimate import AFRESH, CHUNK, STREAM, Batches, ContactEstimator, Search
from .motion import Beam
from .recording import FrameContact, Ground, detected, detected_taken, measured_points
from .shutter import ShutterCheck
from .source import Source


def cuts(count: int, most: int) -> list[slice]:
    """A recording of so many frames in pieces of so many at most. Raises InputError where they cannot be so short."""
    if most < AFRESH:
        raise InputError(f"pieces of {most} frames are too short", remedy=f"give {AFRESH} frames or more")
    step = most - most % AFRESH
    return [slice(begin, min(begin + step, count)) for begin in range(0, count, step)]


@dataclass(frozen=True, eq=False)
class Seen:
    """What successive frames offer to a fit; `reasons` says of each why nothing was seen, None where something was."""

    frames: Sequence[Frame]
    measured: Sequence[Measured]
    reasons: Sequence[str | None]


def look(estimator: ContactEstimator, source: Source, piece: slice, ground: Ground | None = None) -> Seen:
    """What a piece of a recording shows. Raises InputError for a picture that cannot be read."""
    frames = source.frames[piece]
    if source.taken is not None:
        whole = list(detected_taken(estimator, source.taken(), ground))
        reasons = [None if each.line.found else each.line.reason for _, each in whole]
        return Seen([frame for frame, _ in whole], [each.measured for _, each in whole], reasons)
    if source.lines is not None:
        measured = [measured_points(estimator.rig, frame, source.lines) for frame in frames]
        return Seen(frames, measured, [None] * len(frames))
    found = list(detected(estimator, source.frames[: piece.stop], ground, piece.start))
    reasons = [None if each.line.found else each.line.reason for each in found]
    return Seen(frames, [each.measured for each in found], reasons)


def learn(estimator: ContactEstimator, seen: Seen, before: LearntRig | None) -> list[LearntRig]:
    """The rig as it is for each batch of a piece; before : as it was for the last one of the piece before."""
    batches = Batches(estimator if before is None else estimator.continued(before), patient=before is None)
    ready = [each for several in _batches(seen.measured) for each in batches.push(several)] + batches.finish()
    return [now.drift for now, _ in ready]


def _batches(measured: Sequence[Measured]) -> list[list[Measured]]:
    return [list(measured[begin : begin + STREAM]) for begin in range(0, len(measured), STREAM)]


def solve(estimator: ContactEstimator, seen: Seen, learnt: Sequence[LearntRig]) -> list[MovingContacts]:
    """The contacts of a piece by batches, not yet tested for motion."""
    made: dict[int, ContactEstimator] = {}
    for each in learnt:
        if id(each) not in made:
            made[id(each)] = estimator.continued(each)
    search, batches = Search(estimator.rig), zip(learnt, _batches(seen.measured), strict=True)
    return [last(search.solve(made[id(each)], several, CHUNK)) for each, several in batches]


_NOTHING = Measured(np.empty((0, 2)), np.empty(0), np.nan, np.nan, np.nan)


class RowMaker:
    """Pieces in order in, the rows of contacts.csv in order out, some only with the next piece or at the end."""

    def __init__(self, rig: Rig, shutter: Shutter) -> None:
        self._motion = MotionCheck(Beam.of(rig))
        self._shutter = ShutterCheck(shutter, rig.camera.image_size[1])
        self._waiting: deque[tuple[Frame, str | None, Measured]] = deque()

    def push(self, seen: Seen, found: Sequence[MovingContacts]) -> list[ContactRow]:
        """The rows that are ready once this piece is known."""
        measured = seen.measured if self._shutter.needed else [_NOTHING] * len(seen.frames)
        self._waiting.extend(zip(seen.frames, seen.reasons, measured, strict=True))
        return [row for several in found for contact in self._motion.push(several) for row in self._rows(contact)]

    def finish(self) -> list[ContactRow]:
        """The rows that still wait."""
        last = [row for contact in self._motion.finish() for row in self._rows(contact)]
        return last + [ContactRow.of(item.frame, item.contact) for item in self._shutter.finish()]

    def _rows(self, contact: Contact) -> list[ContactRow]:
        frame, reason, measured = self._waiting.popleft()
        item = FrameContact(frame, contact if reason is None else replace(contact, reason=reason), measured)
        return [ContactRow.of(ready.frame, ready.contact) for ready in self._shutter.push(item)]
