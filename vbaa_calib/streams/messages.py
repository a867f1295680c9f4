"""Messages of a stream: pictures and readings, each with its time."""

from __future__ import annotations

import base64
import binascii
import heapq
import json
import math
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from vbaa_calib.core.arrays import PLAUSIBLE, as_float
from vbaa_calib.core.errors import InputError, clipped, quoted
from vbaa_calib.core.images import read_picture
from vbaa_calib.session import CHANNELS, SILENT


@dataclass(frozen=True)
class _MessageSettings:
    """Plausible times of a stream's messages, limits of their number, and timeouts; what a bag may be like."""

    tick_s: float = 0.02  # between two reports of a source that it has nothing new
    one_clock_s: float = 10.0  # stamps further apart than their messages were logged are of two clocks
    longest_line: int = 64_000_000  # bytes of a line of JSON
    readings: int = 4096  # of one channel that are kept: four seconds at a thousand a second
    pictures: int = 100  # of recorded cameras that wait for those of another one, at most
    instant_s: float = 1e-3  # to which videos round their times: such a gap to the nearest reading is none
    # cameras and sockets
    queued: int = 3  # pictures of a camera that may wait: one slow estimate costs none, if those after it are faster
    # waits before a camera that broke off is opened again: a minute, as for a plug
    retries_s: tuple[float, ...] = (0.5, 1.0, 2.0, 4.0, *[8.0] * 7)
    longest_wait_s: float = 60.0  # that a datagram may have waited
    most_notes: int = 16  # on datagrams that cannot be read
    # bags, and their agreement with the rig
    piece_bytes: int = 50_000_000  # that one chunk may unpack to, whatever its packed size
    piece_factor: int = 10  # further allowed multiple of the packed size: copied four times, it fits a child's memory
    focal_share: float = 0.01  # relative difference of the focal length from which a camera is not the rig's
    straight_px: float = 3.0  # bend of a straight line, somewhere in the picture, below which it is rectified
    patience: int = 30  # unreadable pictures or joints, and no readable one before, that end the reading


MESSAGES = _MessageSettings()


def checked_channel(channel: Any) -> str:
    """The channel, one of `CHANNELS`. Raises InputError for anything else."""
    if not isinstance(channel, str) or channel not in CHANNELS:
        raise InputError(f"a channel is {quoted(channel)}", remedy=f"one of {', '.join(CHANNELS)} is needed")
    return channel


@dataclass(frozen=True, eq=False, slots=True)
class Taken:
    """A picture (H, W) grey or (H, W, 3) blue, green, red, and its time.

    time_s : of the exposure, by the stream's clock. arrived_s : when it came, by the source's clock.
    received_s : when this process had it, `time.perf_counter`. waiting : how many have come since: with any, work that
        can be put off should be. camera : its name, of several.
    """

    time_s: float
    image: np.ndarray
    arrived_s: float
    received_s: float = 0.0
    waiting: int = 0
    camera: str = ""

    def __post_init__(self) -> None:
        image = self.image
        shape = image.shape if isinstance(image, np.ndarray) and image.dtype.kind in "buif" else ()
        if len(shape) != 2 and shape[2:] not in ((3,), (4,)):
            what = f"a picture is {quoted(image)}" if not shape else f"a picture has shape {shape}"
            raise InputError(what, remedy="give an array of numbers, (H, W) grey or (H, W, 3) blue, green, red")
        for time_s in (self.time_s, self.arrived_s, self.received_s):
            as_float(time_s, "the time of a picture", "give seconds")


@dataclass(frozen=True, slots=True)
class Reading:
    """A number read from a channel, and its time."""

    time_s: float
    channel: str
    value: float
    arrived_s: float

    def __post_init__(self) -> None:
        checked_channel(self.channel)
        for number in (self.value, self.time_s, self.arrived_s):
            as_float(number, f"a reading of {self.channel}, or its time,", "give numbers")

    @property
    def possible(self) -> bool:
        """Whether the number is possible for its channel, and the time plausible."""
        most = PLAUSIBLE.moment_Nm if self.channel in SILENT else PLAUSIBLE.angle_rad
        return abs(self.value) <= most and abs(self.time_s) < 1e12


_BEGAN_S = time.time() - time.monotonic()


def now_s() -> float:
    """The time of day, s, by a clock that never jumps: it is set once, when the process begins."""
    return _BEGAN_S + time.monotonic()


Messages = Generator[Taken | Reading | None, None, None]
"""Pictures and readings in the order in which they came; None where nothing is new, so that who waits can look at the
clock."""


@dataclass(frozen=True, eq=False)
class MessageSource:
    """A source of pictures and readings.

    Attributes
    ----------
    name : for the screen.
    messages : a function that yields the messages; called once.
    channels : the channels that are known beforehand; others may follow.
    live : the pictures are taken while they are read; else they were taken before.
    dropped : how many pictures were left out, since newer ones had come.
    reopened : how often it broke off and was reached again.
    notes : remarks for the user, so far.
    """

    name: str
    messages: Callable[[], Messages]
    channels: frozenset[str] = frozenset()
    live: bool = False
    dropped: Callable[[], int] = lambda: 0
    reopened: Callable[[], int] = lambda: 0
    notes: list[str] = field(default_factory=list)

    def readings_ahead_s(self) -> float:
        """How much earlier readings are stamped than pictures, s, relative to their arrival; 0 where that is
        unknown.

        The median of the first messages; of a live source these are then lost.
        """
        lags_s: dict[bool, list[float]] = {True: [], False: []}
        messages = self.messages()
        for each in messages:
            if each is not None:
                lags_s[isinstance(each, Taken)].append(each.time_s - each.arrived_s)
            if min(map(len, lags_s.values())) >= 5:
                break
        messages.close()
        if not all(lags_s.values()):
            return 0.0
        return float(np.median(lags_s[True]) - np.median(lags_s[False]))

    def begun(self) -> MessageSource:
        """The source, read up to its first picture. Raises InputError where a recording has none that can be read."""
        several, ahead = self.messages(), list[Taken | Reading | None]()
        for each in several:
            ahead.append(each)
            if isinstance(each, Taken):
                break

        def messages() -> Messages:
            with closing(several):
                yield from ahead
                yield from several

        return replace(self, messages=messages)

    def of_camera(self, name: str, offset_s: float = 0.0, arrived_s: float = 0.0) -> MessageSource:
        """The source with its unnamed pictures attributed to a camera; `offset_s` is added to its times, `arrived_s`
        to its arrival times."""

        def messages() -> Messages:
            for each in self.messages():
                if isinstance(each, Taken) and each.camera in ("", name):
                    at_s, came_s = each.time_s + offset_s, each.arrived_s + arrived_s
                    yield replace(each, camera=name, time_s=at_s, arrived_s=came_s)
                else:
                    yield each

        return replace(self, messages=messages)

    def with_pictures_of(self, others: Sequence[MessageSource]) -> MessageSource:
        """The source merged with further sources, all live or all recorded; recorded ones are merged by arrival. A
        live one that fails or ends leaves the others running.

        Raises InputError where some are live and some are not.
        """
        every = [self, *others]
        if len({each.live for each in every}) > 1:
            remedy = "give only cameras, streams and folders, or only what was recorded"
            raise InputError("some of the cameras are live, others were recorded", where="--source", remedy=remedy)
        notes, reported = list[str](), [0] * len(every)

        def news() -> None:
            for index, each in enumerate(every):
                notes.extend(each.notes[reported[index] :])
                reported[index] = len(each.notes)

        def in_turn(running: list[Messages]) -> Messages:
            """The messages of live sources, each of which waits only a moment, so that none delays the others for
            long."""
            while running:
                found = False
                for each in tuple(running):
                    try:
                        message = next(each)
                    except StopIteration:
                        running.remove(each)
                        continue
                    if message is not None:
                        found = True
                        yield message
                if not found:
                    yield None

        def messages() -> Messages:
            with ExitStack() as stack:
                running = [stack.enter_context(closing(each.messages())) for each in every]
                recorded = heapq.merge(*running, key=lambda each: math.inf if each is None else each.arrived_s)
                for message in in_turn(running) if self.live else recorded:
                    news()
                    yield message
            news()

        news()

        return replace(
            self,
            name=", ".join(each.name for each in every),
            messages=messages,
            channels=frozenset().union(*(each.channels for each in every)),
            dropped=lambda: sum(each.dropped() for each in every),
            reopened=lambda: sum(each.reopened() for each in every),
            notes=notes,
        )

    def without_moments(self) -> MessageSource:
        """The source without the moment sensor's readings, for estimates from pictures alone."""

        def messages() -> Messages:
            for each in self.messages():
                if not (isinstance(each, Reading) and each.channel in SILENT):
                    yield each

        return replace(self, messages=messages, channels=self.channels - {*SILENT})


def line_messages(line: bytes, root: Path | None, arrived_s: float | None = None) -> Iterator[Taken | Reading]:
    """The messages in one JSON line, readings first; without `root` pictures are not accepted. Raises InputError.

    arrived_s : when it came, by `now_s`; just now by default.
    """
    try:
        entry = json.loads(line)
        assert isinstance(entry, dict)
    except (ValueError, AssertionError, RecursionError):
        remedy = '{"time_s": 1.5, "moment_Nm": 0.004}'
        raise InputError(f"{line[:40]!r} is no JSON object", remedy=f"write lines like {remedy}") from None
    known = CHANNELS if root is None else ("image", *CHANNELS)
    if entry.keys().isdisjoint(known):
        raise InputError(f"{line[:40]!r} has nothing to read", remedy=f"name one of {', '.join(known)}")
    arrived_s, received_s = now_s() if arrived_s is None else arrived_s, perf_counter()
    time_s = _number(entry, "time_s", arrived_s)
    for channel in CHANNELS:
        if entry.get(channel) is not None:
            yield Reading(time_s, channel, _number(entry, channel), arrived_s)
    if root is not None and entry.get("image") is not None:
        image = entry["image"]
        for camera, text in image.items() if isinstance(image, dict) else [("", image)]:
            if not isinstance(text, str):
                remedy = "give a path, or a picture's bytes in base64; of several cameras an object of such, by name"
                raise InputError("image is no text", remedy=remedy)
            yield Taken(time_s, _picture(text, root), arrived_s, received_s, camera=camera)


def _number(entry: Mapping[str, Any], name: str, default: float = math.nan) -> float:
    value = entry.get(name, default)
    # a whole number may be larger than any float
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
        raise InputError(f"{name} is {clipped(repr(value))}", remedy="give a finite number in SI units")
    return float(value)


def _picture(text: str, root: Path) -> Any:
    if len(text) < 1024 and (root / text).suffix:
        return read_picture(root / text)
    try:
        data = base64.b64decode(text.removeprefix("data:").rpartition("base64,")[2], validate=True)
    except (binascii.Error, ValueError):
        raise InputError("image is neither a path nor base64", remedy="give one of them") from None
    return read_picture(Path("picture"), data)
