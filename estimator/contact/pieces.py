"""A recording in pieces, which make bit for bit the rows that it makes as a whole, on whatever machines.

What a frame's row takes from others: the frames before tell which of two lines is the antenna (`look`), free frames how
the rig has changed (`learn`), neighbours whether the antenna moves. The solver's search (`solve`), which takes the
time, begins afresh every `AFRESH` frames, where alone a recording is cut. A piece makes the rows of its frames but for
those at its edges (`made`), which wait until both pieces are there (`seam`).

    look      look      look         pieces at once
      │         │         │
    learn  →  learn  →  learn        one after the other, quick; only where the rig may have changed
      │         │         │
    solve     solve     solve        pieces at once
    made      made      made
        ↘    ↙    ↘    ↙
         seam      seam              about a hundred frames each
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

from estimator.table.contacts import ContactRow, Measured
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig
from vbaa_calib.session import Centrelines, Frame, Shutter

from .contacts import InertialShifts, MovingContacts, at_rest, last
from .drift import Batches, LearntRig
from .estimate import AFRESH, CHUNK, STREAM, ContactEstimator, Search
from .motion import Beam
from .recording import FrameContact, Ground, detected, detected_taken, measured_points
from .shutter import ShutterCheck
from .source import Source

_HEAD = 2
"""Batches: what judges the motion in later ones of a piece remembers nothing of the piece before. It remembers `STREAM`
frames beside those that wait, which are no more after the first batch of a piece than this has."""


def cuts(count: int, most: int) -> list[slice]:
    """A recording of so many frames in pieces of so many at most. Raises InputError where they cannot be so short."""
    if most < AFRESH:
        raise InputError(f"pieces of {most} frames are too short", remedy=f"give {AFRESH} frames or more")
    step = most - most % AFRESH
    return [slice(begin, min(begin + step, count)) for begin in range(0, count, step)]


@dataclass(frozen=True, eq=False)
class Lines(Sequence[Measured]):
    """What successive frames offer whose centrelines are there: read when it is asked for."""

    rig: Rig
    frames: Sequence[Frame]
    lines: Centrelines

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [measured_points(self.rig, frame, self.lines) for frame in self.frames[index]]
        return measured_points(self.rig, self.frames[index], self.lines)


@dataclass(frozen=True, eq=False)
class Seen:
    """What successive frames offer to a fit; `reasons` says of each why nothing was seen, None where something was."""

    frames: Sequence[Frame]
    measured: Sequence[Measured]
    reasons: Sequence[str | None]


def look(estimator: ContactEstimator, source: Source, ground: Ground | None = None) -> Seen:
    """What a recording, or a piece of it (`Source.cut`), shows. Raises InputError for a picture that cannot be read."""
    frames, places = source.own()
    if source.lines is not None:
        return Seen(frames, Lines(estimator.rig, frames, source.lines), [None] * len(frames))
    if source.stream is None:
        earlier = (frame for frame, _ in source.earlier())
        found = list(zip(frames, detected(estimator, frames, ground, earlier), strict=True))
    elif not places:
        found = list(detected_taken(estimator, source.stream.taken(), ground))
    else:
        # each found anew: they are seldom needed
        before = (next(source.stream.pictures([frame], [place])) for frame, place in source.earlier())
        found = list(detected_taken(estimator, source.stream.pictures(frames, places), ground, before))
    reasons = [None if each.line.found else each.line.reason for _, each in found]
    return Seen([frame for frame, _ in found], [each.measured for _, each in found], reasons)


def learn(estimator: ContactEstimator, seen: Seen, before: LearntRig | None) -> list[LearntRig]:
    """The rig as it is for each batch of a piece; before : as it was for the last one of the piece before."""
    now = estimator if before is None else estimator.continued(before)
    batches = Batches(now, AFRESH // STREAM if before is None else 0)
    ready = []
    for each in _batches(len(seen.frames)):
        due = batches.now.drift.due(max(frame.time_s for frame in seen.frames[each]))
        ready += batches.push(list(seen.measured[each])) if due else batches.push([], batches.now)
    return [now.drift for now, _ in ready + batches.finish()]


def _batches(count: int) -> list[slice]:
    return [slice(begin, begin + STREAM) for begin in range(0, count, STREAM)]


def solve(estimator: ContactEstimator, seen: Seen, learnt: Sequence[LearntRig]) -> list[MovingContacts]:
    """The contacts of a piece by batches, not yet tested for motion."""
    made: dict[int, ContactEstimator] = {}
    for each in learnt:
        if id(each) not in made:
            made[id(each)] = estimator.continued(each)
    search, batches = Search(estimator.rig), zip(learnt, _batches(len(seen.frames)), strict=True)
    return [last(search.solve(made[id(each)], list(seen.measured[batch]), CHUNK)) for each, batch in batches]


@dataclass(frozen=True, eq=False)
class _Edge:
    """Frames at one end of a piece whose rows need the piece beside it, and the next one, whose row does not."""

    items: list[FrameContact]
    inner: list[FrameContact]


@dataclass(frozen=True, eq=False)
class Made:
    """The rows of a piece without those at its edges, and what is needed to make these.

    head : its first batches, without their contacts. closing : whether they are all of the recording that is left.
    check : the judge of motion as it is after the piece.
    """

    rows: list[ContactRow]
    begin: _Edge
    end: _Edge
    head: list[MovingContacts]
    closing: bool
    check: InertialShifts


def made(
    rig: Rig, shutter: Shutter, seen: Seen, found: Sequence[MovingContacts], *, first: bool = True, final: bool = True
) -> Made:
    """The rows of a piece, which may be the first or the final one."""
    contacts = chain.from_iterable(several.contacts for several in found)
    items = [
        FrameContact(frame, contact if reason is None else replace(contact, reason=reason), measured)
        for frame, measured, reason, contact in zip(seen.frames, seen.measured, seen.reasons, contacts, strict=True)
    ]
    check = InertialShifts(Beam.of(rig))
    known = [check.push(several) for several in found]
    shifts = list(chain.from_iterable(known))
    closing = final and not first and len(found) <= _HEAD
    begin = 0 if first else len(items) if closing else sum(map(len, known[:_HEAD]))
    if final:
        shifts += deepcopy(check).finish()
    end = len(shifts)
    return Made(
        rows=_rows(rig, shutter, items[begin:end], shifts[begin:], (items[:begin][-1:], items[end:][:1])),
        begin=_Edge(items[:begin], items[begin:][:1]),
        end=_Edge(items[end:], items[:end][-1:]),
        head=[] if first else [replace(several, contacts=()) for several in found[:_HEAD]],
        closing=closing,
        check=check,
    )


def seam(rig: Rig, shutter: Shutter, one: Made, other: Made) -> list[ContactRow]:
    """The rows between those of a piece and of the next one."""
    check = deepcopy(one.check)  # another call's result, which may be asked for again
    shifts = [shift for several in other.head for shift in check.push(several)]
    shifts += check.finish() if other.closing else []
    items = [*one.end.items, *other.begin.items]
    return _rows(rig, shutter, items, shifts, (one.end.inner, other.begin.inner))


def _rows(
    rig: Rig,
    shutter: Shutter,
    items: Sequence[FrameContact],
    shifts: Sequence[float],
    beside: tuple[Sequence[FrameContact], Sequence[FrameContact]],
) -> list[ContactRow]:
    """The rows of successive frames; beside : the frame before them and the one after, where there is one."""
    check = ShutterCheck(shutter, rig.camera.image_size[1])
    judged = [replace(item, contact=at_rest(item.contact, shift)) for item, shift in zip(items, shifts, strict=True)]
    before, after = beside if check.needed else ((), ())
    ready = [each for item in (*before, *judged, *after) for each in check.push(item)]
    ready += () if after else check.finish()
    return [ContactRow.of(item.frame, item.contact) for item in ready[len(ready) - len(items) :]]
