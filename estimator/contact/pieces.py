"""A recording in pieces, which make bit for bit the rows that it makes as a whole, on whatever machines.

What a frame's row takes from others is handed on from piece to piece: the frames before tell which of two lines is the
antenna (`look`), free frames how the rig has changed (`learn`), neighbours whether the antenna moves (`judge`). The
solver's search (`solve`), which takes the time, begins afresh every `AFRESH` frames, where alone a recording is cut.

    look      look      look            pieces at once
      │         │         │
    learn  →  learn  →  learn           one after the other, quick
      │         │         │
    solve     solve     solve           pieces at once
      │         │         │
    judge  →  judge  →  judge           one after the other, quick
      │    ↗↙   │    ↗↙   │
    rows      rows      rows            pieces at once
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from estimator.table.contacts import ContactRow, Measured
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame, Shutter

from .contacts import InertialShifts, MovingContacts, at_rest, last
from .drift import Batches, LearntRig
from .estimate import AFRESH, CHUNK, STREAM, ContactEstimator, Search
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
    if source.lines is not None:
        measured = [measured_points(estimator.rig, frame, source.lines) for frame in frames]
        return Seen(frames, measured, [None] * len(frames))
    if source.stream is not None and not source.places:
        found = list(detected_taken(estimator, source.stream.taken(), ground))
    elif source.stream is not None:
        found = list(detected_taken(estimator, _pictures(source, piece), ground, _pictures_before(source, piece)))
    else:
        found = list(zip(frames, detected(estimator, source.frames[: piece.stop], ground, piece.start), strict=True))
    reasons = [None if each.line.found else each.line.reason for _, each in found]
    return Seen([frame for frame, _ in found], [each.measured for _, each in found], reasons)


def _pictures(source: Source, piece: slice) -> Iterator[tuple[Frame, np.ndarray]]:
    assert source.stream is not None
    return source.stream.pictures(source.frames[piece], source.places[piece])


def _pictures_before(source: Source, piece: slice) -> Iterator[tuple[Frame, np.ndarray]]:
    """Latest first, each found anew: they are seldom needed."""
    return (next(_pictures(source, slice(at, at + 1))) for at in range(piece.start - 1, -1, -1))


def learn(estimator: ContactEstimator, seen: Seen, before: LearntRig | None) -> list[LearntRig]:
    """The rig as it is for each batch of a piece; before : as it was for the last one of the piece before."""
    batches = Batches(estimator if before is None else estimator.continued(before), AFRESH if before is None else 0)
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


@dataclass(frozen=True, eq=False)
class Judged:
    """What is known of the motion in a recording up to the end of a piece.

    shifts : `InertialShifts` of the frames that waited before the piece, and of its own but for those that wait now.
    check : the state from which the next piece goes on.
    ends : the piece's first and last frame, where the shutter matters.
    """

    shifts: list[float]
    check: InertialShifts
    ends: tuple[FrameContact, FrameContact] | None


def judge(rig: Rig, shutter: Shutter, seen: Seen, found: Sequence[MovingContacts], before: Judged | None) -> Judged:
    """The motion in a piece, from that in the one before it."""
    # the state before is another call's result, which may be asked for again
    check = InertialShifts(Beam.of(rig)) if before is None else deepcopy(before.check)
    shifts = [shift for several in found for shift in check.push(several)]
    if not ShutterCheck(shutter, 1).needed:
        return Judged(shifts, check, None)
    first, last = (FrameContact(seen.frames[at], found[at].contacts[at], seen.measured[at]) for at in (0, -1))
    return Judged(shifts, check, (first, last))


def rows(
    rig: Rig, shutter: Shutter, seen: Seen, found: Sequence[MovingContacts], judged: Sequence[Judged | None]
) -> list[ContactRow]:
    """The rows of a piece; `judged` (3,) : the motion in the piece before it, its own, and in the next."""
    before, own, after = judged
    assert own is not None
    shifts = own.shifts[0 if before is None else len(before.check) :]
    shifts += deepcopy(own.check).finish() if after is None else after.shifts[: len(own.check)]
    contacts = (contact for several in found for contact in several.contacts)
    check = ShutterCheck(shutter, rig.camera.image_size[1])
    ready: list[FrameContact] = []
    if before is not None and before.ends is not None:
        check.push(before.ends[1])
    for frame, measured, reason, one, shift in zip(
        seen.frames, seen.measured, seen.reasons, contacts, shifts, strict=True
    ):
        contact = at_rest(one, shift)
        contact = contact if reason is None else replace(contact, reason=reason)
        ready += check.push(FrameContact(frame, contact, measured))
    ready += check.finish() if after is None or after.ends is None else check.push(after.ends[0])
    # a row of the piece before comes out first, where the shutter matters
    return [ContactRow.of(item.frame, item.contact) for item in ready[-len(seen.frames) :]]
