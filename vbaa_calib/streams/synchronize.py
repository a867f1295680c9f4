"""Readings at the instants of pictures: interpolated, never made up; what does not fit is counted."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np

from vbaa_calib.core.arrays import ANGLE_REMEDY, LARGEST_RAD, as_floats, check_each, gate
from vbaa_calib.core.errors import InputError, shown
from vbaa_calib.session import Frame

from .messages import CHANNELS, Reading, Taken

_KEPT = 4096
"""Readings of one channel that are kept: four seconds at a thousand a second."""
_INSTANT_S = 1e-3
"""Before the first reading and after the last, one so near counts, and readings apart by so much more than the gap are
still near enough: videos round their times to that."""
_ANGLES = ("pan_rad", "tilt_rad")


@gate
@dataclass(frozen=True)
class Timing:
    """How readings and pictures belong together.

    offset_s : what is added to a reading's time to have it on the pictures' clock.
    gap_s : a picture between two readings further apart, or beside the only one at such a distance, has none.
    wait_s : how long a picture waits for the readings after it, by the source's clock.
    joints_rad : pan and tilt of a rig whose joints are not read, or NaN: they must be.
    offset_std_s : deviation of the offset. moment_std_Nm : noise of the moment sensors about y and z.
    """

    offset_s: float = 0.0
    gap_s: float = 0.1
    wait_s: float = 0.25
    joints_rad: tuple[float, float] = (0.0, 0.0)
    offset_std_s: float = 0.0
    moment_std_Nm: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Raises InputError for what is no time, no deviation, or an angle in degrees."""
        if not math.isfinite(self.offset_s):
            raise InputError(f"offset_s is {self.offset_s}", remedy="give seconds")
        pan_tilt = as_floats(self.joints_rad, "joints_rad", ANGLE_REMEDY)
        std_Nm = as_floats(self.moment_std_Nm, "moment_std_Nm", "give N·m")
        for name, pair in (("joints_rad", pan_tilt), ("moment_std_Nm", std_Nm)):
            if pair.shape != (2,):
                raise InputError(f"{name} is {shown(getattr(self, name))}", remedy="give two numbers")
        check_each(pan_tilt, LARGEST_RAD, "joints_rad", ANGLE_REMEDY)
        for name in ("gap_s", "wait_s", "offset_std_s"):
            if not getattr(self, name) >= 0.0:
                raise InputError(f"{name} is {getattr(self, name)}", remedy="give seconds, 0 or more")
        if not (std_Nm >= 0.0).all():
            raise InputError(f"moment_std_Nm is {self.moment_std_Nm}", remedy="give deviations in N·m")


@dataclass(frozen=True, eq=False)
class Synchronized:
    """A picture and, as a frame, what was read when it was taken. age_s : of the reading that is furthest from it."""

    frame: Frame
    taken: Taken
    age_s: float


@dataclass(eq=False)
class _Channel:
    """The latest readings of one channel, in order of their times."""

    times: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def at(self, time_s: float, gap_s: float) -> tuple[float, float]:
        """The value at a time, and how far the readings that it comes from are at most; NaN where they are too far."""
        after = bisect_left(self.times, time_s)
        if after < len(self.times) and self.times[after] == time_s:
            return self.values[after], 0.0
        if after in (0, len(self.times)):
            near = min(after, len(self.times) - 1)
            age_s = abs(self.times[near] - time_s) if self.times else np.inf
            return (self.values[near], age_s) if age_s <= _INSTANT_S else (np.nan, np.nan)
        (t0, t1), (v0, v1) = self.times[after - 1 : after + 1], self.values[after - 1 : after + 1]
        if t1 - t0 > gap_s + _INSTANT_S:
            return np.nan, np.nan
        return v0 + (v1 - v0) * ((time_s - t0) / (t1 - t0)), max(time_s - t0, t1 - time_s)

    def error(self, time_s: float, timing: Timing, std: float) -> float:
        """Deviation of the value at a time beside the readings' noise `std`: of interpolation, and of the clocks.

        Between two readings the value may leave the line by as much as its rate changes there, s·(1 − s) of how far the
        second lies off the line through the first and the one before. What noise alone makes of that is taken off, and
        what interpolation takes off the noise.
        """
        value, age_s = self.at(time_s, timing.gap_s)
        if not age_s >= 0.0:
            return 0.0
        times, values = self.times, self.values
        after, variance, step_s = bisect_left(times, time_s), 0.0, np.inf
        if age_s > 0.0 and 0 < after < len(times):
            step_s = times[after] - times[after - 1]
            share = (time_s - times[after - 1]) / step_s
            turn = values[after] - values[after - 1]
            if after > 1:
                turn -= step_s * (values[after - 1] - values[after - 2]) / (times[after - 1] - times[after - 2])
            variance = max(share * (1.0 - share) * (share * (1.0 - share) * turn**2 - 2.0 * std**2), 0.0)
        if timing.offset_std_s > 0.0:
            before, found_s = self.at(time_s - timing.offset_std_s, timing.gap_s)
            if found_s >= 0.0:
                noise = math.sqrt(2.0) * std * min(timing.offset_std_s / step_s, 1.0)
                variance += max((value - before) ** 2 - noise**2, 0.0)
        return math.sqrt(variance)


class Synchronizer:
    """Pictures and readings in, in the order in which they came; frames out, in the order of the pictures.

    A picture waits until every channel has a reading after it, or for `Timing.wait_s`. Between the readings on either
    side its own are interpolated; where they are missing, or too far apart, the frame has none. Pictures and readings
    that come twice or out of order are left out.

    counts : of what came and of what was left out, by name.
    """

    @gate
    def __init__(self, timing: Timing, channels: Iterable[str] = (), image_size: tuple[int, int] | None = None) -> None:
        """channels : of `CHANNELS`, those that are waited for.

        image_size : (width, height) of the rig's camera: pictures of another size are left out.
        """
        self._image_size = image_size
        self.counts: Counter[str] = Counter()
        self._timing = timing
        self._channels = {_known(name): _Channel() for name in channels}
        self._waiting: deque[Taken] = deque()
        self._last_s = self._given_s = -np.inf
        self._number = 0

    def push(self, message: Taken | Reading) -> Iterator[Synchronized]:
        """The frames that are complete with it. Raises InputError when the first picture has not the rig's size."""
        if isinstance(message, Reading):
            self._read(message)
        elif not isinstance(message, Taken):
            raise InputError(f"a message is {shown(message)}", remedy="give a Taken or a Reading")
        elif self._image_size not in (None, message.image.shape[1::-1]):
            self._refuse(message.image.shape[1::-1])
        elif not np.isfinite(message.time_s) or message.time_s <= self._last_s:
            self.counts["pictures doubled" if message.time_s == self._last_s else "pictures out of order"] += 1
        else:
            self.counts["pictures"] += 1
            self._last_s = message.time_s
            self._waiting.append(message)
        return self.ready(message.arrived_s)

    @gate
    def ready(self, now_s: float) -> Iterator[Synchronized]:
        """The frames that are complete, or have waited long enough by the source's clock."""
        while self._waiting:
            taken = self._waiting[0]
            complete = all(each.times and each.times[-1] >= taken.time_s for each in self._channels.values())
            if not complete and now_s - taken.arrived_s < self._timing.wait_s:
                return
            yield self._frame(self._waiting.popleft())

    def finish(self) -> Iterator[Synchronized]:
        """Those that still wait; nothing comes after them."""
        while self._waiting:
            yield self._frame(self._waiting.popleft())

    def left_out(self) -> list[str]:
        """What was left out, in words."""
        usual = ("pictures", "readings")
        said = [f"{count} {what}" for what, count in sorted(self.counts.items()) if what not in usual and count]
        gap = f": their readings are further apart than --gap ({self._timing.gap_s:g} s), or on one side only"
        return [f"{words}{gap}" if "pictures without" in words else words for words in said]

    def _refuse(self, size: Sequence[int]) -> None:
        assert self._image_size is not None
        if not self.counts["pictures"]:
            given, rig = ("x".join(map(str, each)) for each in (size, self._image_size))
            remedy = "use the resolution of the calibration"
            raise InputError(f"the pictures are {given} px, the rig's camera {rig}", remedy=remedy)
        self.counts["pictures of another size"] += 1

    def _read(self, reading: Reading) -> None:
        if not reading.possible:
            self.counts["readings that cannot be"] += 1
            return
        channel, time_s = self._channels.setdefault(reading.channel, _Channel()), reading.time_s + self._timing.offset_s
        if channel.times and time_s <= channel.times[-1]:
            self.counts["readings doubled" if time_s == channel.times[-1] else "readings out of order"] += 1
            return
        self.counts["readings"] += 1
        # a picture that it would have served is gone
        self.counts["readings late"] += time_s <= self._given_s
        channel.times.append(time_s)
        channel.values.append(reading.value)
        if len(channel.times) > 2 * _KEPT:
            del channel.times[:_KEPT], channel.values[:_KEPT]

    def _frame(self, taken: Taken) -> Synchronized:
        read = {name: channel.at(taken.time_s, self._timing.gap_s) for name, channel in self._channels.items()}
        values: dict[str, Any] = {name: read[name][0] if name in read else np.nan for name in CHANNELS}
        for name, joint in zip(_ANGLES, self._timing.joints_rad, strict=True):
            if name not in read:
                values[name] = joint
        self.counts["pictures without a moment"] += "moment_Nm" in read and math.isnan(values["moment_Nm"])
        self.counts["pictures without joint angles"] += any(math.isnan(values[name]) for name in _ANGLES)
        self._given_s, self._number = taken.time_s, self._number + 1
        ages = [age for _, age in read.values()]
        # joint angles count as free of noise
        errors = [
            self._channels[name].error(taken.time_s, self._timing, std) if name in self._channels else 0.0
            for name, std in zip(CHANNELS, (*self._timing.moment_std_Nm, 0.0, 0.0), strict=True)
        ]
        values["moment_errors_Nm"], values["joint_errors_rad"] = (errors[0], errors[1]), (errors[2], errors[3])
        frame = Frame(image=None, frame=self._number - 1, time_s=taken.time_s, **values)
        return Synchronized(frame, taken, max(ages, default=np.nan))


def _known(channel: Any) -> str:
    if not isinstance(channel, str) or channel not in CHANNELS:
        raise InputError(f"a channel is {shown(channel)}", remedy=f"one of {', '.join(CHANNELS)} is needed")
    return channel


def taken_frames(
    messages: Iterable[Taken | Reading | None], synchronizer: Synchronizer
) -> Iterator[tuple[Frame, np.ndarray]]:
    """The frames of a recorded source's messages, and their pictures."""
    pushed = (each for message in messages if message is not None for each in synchronizer.push(message))
    return ((each.frame, each.taken.image) for each in chain(pushed, synchronizer.finish()))
