"""Synchronisation: readings interpolated at the times of pictures, never extrapolated far; whatever does not fit is
counted."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from typing import Any

import numpy as np

from vbaa_calib.core.arrays import ANGLE_REMEDY, PLAUSIBLE, as_floats, check_each, validate_arguments
from vbaa_calib.core.errors import InputError, quoted
from vbaa_calib.session import CHANNELS, READINGS, Frame
from vbaa_calib.session.tables import ANGLES

from .messages import MESSAGES, Reading, Taken, checked_channel

_Message = Taken | Reading


@validate_arguments
@dataclass(frozen=True)
class Timing:
    """Tolerances and clock offsets by which readings and pictures are matched.

    offset_s : what is added to a reading's time to have it on the pictures' clock.
    gap_s : a picture gets no reading where the two around it are further apart than this, or where the only one is
        further away.
    wait_s : how long a picture waits for the readings after it, by the source's clock.
    joints_rad : pan and tilt of a rig without readings of its joints, or NaN: they must be read.
    offset_std_s : deviation of the offset. moment_std_Nm : noise of the moments about y and
        z, and of what else `session.READINGS` has, as far as it is known.
    jump_s : a stamp that steps further ahead of arrival, or back, counts only once the next ones confirm it: queues and
        networks delay by less, clocks are set by more.
    agreeing : so many such stamps in a row are a clock that was set, not errors.
    together_s : pictures of several cameras that are so near in time are of one frame.
    estimate_offset : whether a recorded source's offset is estimated by its pictures.
    """

    offset_s: float = 0.0
    gap_s: float = 0.1
    wait_s: float = 0.25
    joints_rad: tuple[float, float] = (0.0, 0.0)
    offset_std_s: float = 0.0
    moment_std_Nm: tuple[float, ...] = (0.0, 0.0)
    jump_s: float = 1.0
    agreeing: int = 3
    together_s: float = 0.01
    estimate_offset: bool = False

    def __post_init__(self) -> None:
        """Raises InputError for impossible times and standard deviations, and for an angle in degrees."""
        if not math.isfinite(self.offset_s):
            raise InputError(f"offset_s is {self.offset_s}", remedy="give seconds")
        pan_tilt = as_floats(self.joints_rad, "joints_rad", ANGLE_REMEDY)
        std_Nm = as_floats(self.moment_std_Nm, "moment_std_Nm", "give N·m")
        for name, several, most in (("joints_rad", pan_tilt, 2), ("moment_std_Nm", std_Nm, len(READINGS))):
            if several.ndim != 1 or not 2 <= len(several) <= most:
                raise InputError(f"{name} is {quoted(getattr(self, name))}", remedy="give two numbers")
        check_each(pan_tilt, PLAUSIBLE.angle_rad, "joints_rad", ANGLE_REMEDY)
        for name in ("gap_s", "wait_s", "offset_std_s", "jump_s", "together_s"):
            if not getattr(self, name) >= 0.0:
                raise InputError(f"{name} is {getattr(self, name)}", remedy="give seconds, 0 or more")
        if not (isinstance(self.agreeing, int) and self.agreeing >= 2):
            raise InputError(f"agreeing is {quoted(self.agreeing)}", remedy="give a whole number, 2 or more")
        if not (std_Nm >= 0.0).all():
            raise InputError(f"moment_std_Nm is {self.moment_std_Nm}", remedy="give deviations in N·m")


@dataclass(frozen=True, eq=False)
class Synchronized:
    """A picture with the readings at its time, as a frame. age_s : largest time between the picture and a reading
    used.

    others : of several cameras the pictures of the same frame.
    """

    frame: Frame
    taken: Taken
    age_s: float
    others: tuple[Taken, ...] = ()

    @property
    def images(self) -> dict[str, np.ndarray]:
        """The pictures by camera name."""
        return {each.camera: each.image for each in (self.taken, *self.others)}


@dataclass(eq=False)
class _Channel:
    """The latest readings of one channel, ordered by time."""

    times: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def at(self, time_s: float, gap_s: float) -> tuple[float, float]:
        """The value interpolated at a time, and the largest distance in time to a reading used; NaN where that
        exceeds `gap_s`."""
        after = bisect_left(self.times, time_s)
        if after < len(self.times) and self.times[after] == time_s:
            return self.values[after], 0.0
        if after in (0, len(self.times)):
            near = min(after, len(self.times) - 1)
            age_s = abs(self.times[near] - time_s) if self.times else np.inf
            return (self.values[near], age_s) if age_s <= MESSAGES.instant_s else (np.nan, np.nan)
        (t0, t1), (v0, v1) = self.times[after - 1 : after + 1], self.values[after - 1 : after + 1]
        if t1 - t0 > gap_s + MESSAGES.instant_s:
            return np.nan, np.nan
        return v0 + (v1 - v0) * ((time_s - t0) / (t1 - t0)), max(time_s - t0, t1 - time_s)

    def add(self, time_s: float, value: float) -> None:
        """Add a reading; stored ones that are not earlier must have a wrong stamp and are dropped."""
        after = bisect_left(self.times, time_s) if self.times and time_s <= self.times[-1] else len(self.times)
        del self.times[after:], self.values[after:]
        self.times.append(time_s)
        self.values.append(value)
        if len(self.times) > 2 * MESSAGES.readings:
            del self.times[: MESSAGES.readings], self.values[: MESSAGES.readings]

    def error(self, time_s: float, timing: Timing, std: float) -> float:
        """Standard deviation of the value at a time due to interpolation and clocks, in addition to the readings'
        noise `std`.

        Between two readings, at a fraction s of the way, the value may be off the straight line by s·(1 − s) times the
        distance of the second reading from the line through the first and the one before. The contribution of noise to
        that distance is subtracted, and so is the noise that interpolation averages out.
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


@dataclass(eq=False)
class _Stamps:
    """Plausibility of one stream's stamps relative to arrival; its clock may have any constant offset.

    live : arrival is by a clock of its own. last : the latest message that counts.
    step_s : by how much it is later than the one before; 0 for the first.
    doubted : messages with stamps that jump, all to one side, each later than the one before.
    """

    timing: Timing
    live: bool
    last: _Message | None = None
    step_s: float = 0.0
    doubted: list[_Message] = field(default_factory=list)

    def judged(self, message: _Message, now_s: float) -> tuple[list[_Message], list[_Message]]:
        """The accepted and the rejected messages, now that this one has arrived. now_s : latest arrival in any
        stream."""
        if self.last is None:
            return self._counted([message]), []
        step_s, since_s = message.time_s - self.last.time_s, message.arrived_s - self.last.arrived_s
        if -self.timing.jump_s <= step_s <= 0.0:
            return [], [message]
        # in what was recorded, arrival that is the stamp once more, to what floats of a time of day can tell, bounds
        # nothing
        passed_s = max(since_s if self.live or abs(since_s - step_s) > 1e-5 else 0.0, now_s - self.last.arrived_s, 0.0)
        # even steps are no jumps: stamps in ms, pictures of every minute that are read at once
        if 0.0 < step_s <= passed_s + max(self.timing.jump_s, 2.0 * self.step_s):
            between = [each for each in self.doubted if self.last.time_s < each.time_s < message.time_s]
            wrong = [each for each in self._dropped() if each not in between]
            return self._counted([*between, message]), wrong
        before = self.doubted[-1] if self.doubted else self.last
        alike = not self.doubted or (before.time_s > self.last.time_s) == (step_s > 0.0)
        wrong = [] if not self.doubted or (alike and message.time_s > before.time_s) else self._dropped()
        self.doubted.append(message)
        return (self._counted(self._dropped()) if len(self.doubted) >= self.timing.agreeing else []), wrong

    def overdue(self, now_s: float) -> list[_Message]:
        """Doubtful messages that are accepted because the first of them has waited as long as a picture may."""
        late = self.live and bool(self.doubted) and now_s - self.doubted[0].arrived_s >= self.timing.wait_s
        return self._counted(self._dropped()) if late else []

    def finish(self) -> tuple[list[_Message], list[_Message]]:
        """Messages that are doubtful at the end and accepted, since no later ones contradict them."""
        ahead = self.last is not None and bool(self.doubted) and self.doubted[0].time_s > self.last.time_s
        return (self._counted(self._dropped()), []) if ahead else ([], self._dropped())

    def _counted(self, several: list[_Message]) -> list[_Message]:
        before = several[-2] if len(several) > 1 else self.last
        self.step_s = 0.0 if before is None else abs(several[-1].time_s - before.time_s)
        self.last = several[-1]
        return several

    def _dropped(self) -> list[_Message]:
        dropped, self.doubted = self.doubted, []
        return dropped


class Synchronizer:
    """Takes pictures and readings in order of arrival; returns frames in the order of the pictures.

    A picture waits until every channel has a reading after it, or for `Timing.wait_s`. Between the readings on either
    side its own are interpolated; where they are missing, or too far apart, the frame has none. Pictures and readings
    that come twice or out of order are left out, and so are those with stamps that jump, unless `Timing.agreeing` do so
    in a row, or, live, nothing contradicts them for `Timing.wait_s`: then the clock was set, and the new time counts.
    Where that is earlier, the frames' times go on rising.

    Of several cameras, pictures within `Timing.together_s` are one frame. A picture waits for the other cameras' as it
    does for readings, but not for a camera that has been silent for long; without them it is a frame of its own.

    counts : of what came and of what was left out, by name.
    """

    @validate_arguments
    def __init__(
        self,
        timing: Timing,
        channels: Iterable[str] = (),
        image_size: tuple[int, int] | Mapping[str, tuple[int, int]] | None = None,
        notes: list[str] | None = None,
        live: bool = True,
    ) -> None:
        """channels : of `CHANNELS`, those that a frame must have.

        image_size : (width, height) of the rig's camera: pictures of another size are left out. Of several cameras by
            name, the first one's pictures being those without a name.
        notes : where stamps that jump are reported as it happens.
        live : messages arrive by a clock; of what was recorded, arrival may be the stamp, and the first picture waits
            for the second, which may show its stamp to be wrong.
        """
        self._sizes = dict(image_size) if isinstance(image_size, Mapping) else {"": image_size}
        self._first = next(iter(self._sizes))
        self._streams = {name: f"pictures of {name}" if name else "pictures" for name in self._sizes}
        self.counts: Counter[str] = Counter()
        self._notes = [] if notes is None else notes
        self._noted: set[tuple[str, str]] = set()
        self._timing, self.live = timing, live
        self._channels = {checked_channel(name): _Channel() for name in channels}
        self._stamps: dict[str, _Stamps] = {}
        self._waiting: deque[Taken] = deque()
        self._now_s = self._given_s = self._begin_s = self._last_s = -np.inf
        self._set_back_s = dict.fromkeys(self._sizes, 0.0)
        self._apart_s = {name: deque[float](maxlen=1000) for name in self._sizes}
        self._number = 0
        self._spans: dict[str, tuple[float, float]] = {}

    def push(self, message: Taken | Reading) -> Iterator[Synchronized]:
        """The frames that a message completes. Raises InputError when the first picture has another size than the
        rig's."""
        if not isinstance(message, Taken | Reading):
            raise InputError(f"a message is {quoted(message)}", remedy="give a Taken or a Reading")
        early: list[Synchronized] = []
        if isinstance(message, Taken) and message.camera != self._first and message.camera not in self._sizes:
            if message.camera:
                self.counts["pictures of a camera that the rig does not have"] += 1
                return iter(early)
            message = replace(message, camera=self._first)
        if isinstance(message, Taken) and self._sizes[message.camera] not in (None, message.image.shape[1::-1]):
            self._refuse(message)
        elif isinstance(message, Reading) and not message.possible:
            self.counts["readings that cannot be"] += 1
        elif not np.isfinite(message.time_s):
            self.counts["pictures out of order"] += 1
        else:
            stream = message.channel if isinstance(message, Reading) else self._streams[message.camera]
            stamps = self._stamps.setdefault(stream, _Stamps(self._timing, self.live))
            last, first = stamps.last, stamps.step_s == 0.0
            counted, wrong = stamps.judged(message, self._now_s)
            early = self._judged(stream, last, counted, wrong, jumped=len(counted) > 1, first=first)
            if stamps.doubted and not self.live:
                return iter(early)
        self._now_s = message.arrived_s
        return chain(early, self.ready(message.arrived_s))

    @validate_arguments
    def ready(self, now_s: float) -> Iterator[Synchronized]:
        """The frames that are complete, or have waited long enough by the source's clock."""
        for stream, stamps in list(self._stamps.items()):
            last, first = stamps.last, stamps.step_s == 0.0
            if counted := stamps.overdue(now_s):
                yield from self._judged(stream, last, counted, jumped=True, first=first)
        while self._waiting:
            taken = self._waiting[0]
            # where nobody waits for it, and its readings are kept meanwhile
            several = self.live or self._stamps[self._streams[taken.camera]].step_s > 0.0
            several |= len(self._sizes) > 1 and now_s - taken.arrived_s > 2.0 * self._timing.jump_s
            if not (several or any(len(each.times) > MESSAGES.readings for each in self._channels.values())):
                return
            complete = all(each.times and each.times[-1] >= taken.time_s for each in self._channels.values())
            overdue = now_s - taken.arrived_s >= self._timing.wait_s
            # of what was recorded nobody waits for the frame, and a camera's stamps may lag behind its arrival
            cameras = () if overdue and self.live else self._sizes.keys() - {taken.camera}
            if not (complete or overdue) or any(self._awaited(taken, name, now_s) for name in cameras):
                return
            yield self._frame(self._waiting.popleft())

    def _onward_s(self, taken: Taken) -> float:
        """The message's time, continued monotonically where its clock was set back."""
        return taken.time_s + self._set_back_s[taken.camera]

    def _partner(self, taken: Taken, name: str) -> tuple[Taken | None, float]:
        """The waiting picture of another camera that belongs to the same frame, if any, and the time to the nearest
        one."""
        at_s = self._onward_s(taken)
        gaps = [(abs(self._onward_s(each) - at_s), each) for each in self._waiting if each.camera == name]
        gap_s, nearest = min(gaps, key=lambda one: one[0], default=(math.inf, None))
        if nearest is None or gap_s > self._timing.together_s:
            return None, gap_s
        there_s, own = self._onward_s(nearest), (each for each in self._waiting if each.camera == taken.camera)
        return (nearest if all(abs(self._onward_s(each) - there_s) >= gap_s for each in own) else None), gap_s

    def _awaited(self, taken: Taken, name: str, now_s: float) -> bool:
        """Whether another camera's picture of the same frame may yet come."""
        if self._partner(taken, name)[0] is not None:
            return False
        stamps = self._stamps.get(self._streams[name])
        last = None if stamps is None else stamps.last
        if not isinstance(last, Taken) or stamps is None:
            return now_s - self._begin_s <= self._timing.jump_s
        if self._onward_s(last) >= self._onward_s(taken) + self._timing.together_s:
            return False
        if len(self._waiting) > MESSAGES.pictures:
            return False
        # of one picture nobody knows how often they come
        return now_s - last.arrived_s <= max(self._timing.wait_s, 2.0 * stamps.step_s or self._timing.jump_s)

    def finish(self) -> Iterator[Synchronized]:
        """The frames that wait at the end of the stream.

        Raises InputError for a recording without an instant that pictures and readings share.
        """
        for stream, stamps in self._stamps.items():
            last = stamps.last
            counted, wrong = stamps.finish()
            yield from self._judged(stream, last, counted, wrong, jumped=len(counted) > 1)
        yield from self._flushed()
        for channel in () if self.live else [*self._channels, *list(self._streams.values())[1:]]:
            self._refuse_two_clocks(channel)

    def _refuse_two_clocks(self, channel: str) -> None:
        """Raises InputError for a channel, or a further camera, that begins after the first camera's last picture or
        ends before its first."""
        pictures = self._streams[self._first]
        if channel not in self._spans or pictures not in self._spans:
            return
        (first_s, last_s), (begin_s, end_s) = self._spans[channel], self._spans[pictures]
        if max(first_s - end_s, begin_s - last_s) <= self._timing.gap_s + MESSAGES.instant_s:
            return
        what = f"{channel} was read from {first_s:.10g} to {last_s:.10g} s, the {pictures} are of {begin_s:.10g} to "
        offset_s = self._timing.offset_s + begin_s - first_s
        remedy = f"give --clock-offset, which is added to the readings' times: {offset_s:.10g} lets both begin together"
        if channel not in self._channels:
            what = f"the {channel} are of {first_s:.10g} to {last_s:.10g} s, the {pictures} of {begin_s:.10g} to "
            remedy = f"give --camera-offset {channel.removeprefix('pictures of ')}={begin_s - first_s:.10g}, which is "
            remedy += "added to its times and lets both begin together, or the true one"
        raise InputError(f"{what}{end_s:.10g} s: two clocks", remedy=remedy)

    def left_out(self) -> list[str]:
        """Numbers of messages and pictures that were left out, in words."""
        usual = ("pictures", "readings")
        lines = [f"{count} {what}" for what, count in sorted(self.counts.items()) if what not in usual and count]
        gap = f": their readings are further apart than --gap ({self._timing.gap_s:g} s), or on one side only"
        lines = [f"{words}{gap}" if "pictures without" in words else words for words in lines]
        for name, gaps in self._apart_s.items():
            if count := self.counts[f"frames without {name}"]:
                near = f": none within --together ({self._timing.together_s:g} s)"
                near += f"; the nearest are {1e3 * np.median(gaps):.3g} ms away" if gaps else ""
                lines = [f"{words}{near}" if words == f"{count} frames without {name}" else words for words in lines]
        return lines

    def _refuse(self, taken: Taken) -> None:
        size = self._sizes[taken.camera]
        assert size is not None
        if self._streams[taken.camera] not in self._spans:
            measured, rig = ("x".join(map(str, each)) for each in (taken.image.shape[1::-1], size))
            remedy, named = "use the resolution of the calibration", f" {taken.camera}" * bool(taken.camera)
            pictures = self._streams[taken.camera]
            raise InputError(f"the {pictures} are {measured} px, the rig's camera{named} {rig}", remedy=remedy)
        self.counts["pictures of another size"] += 1

    def _judged(
        self,
        stream: str,
        last: _Message | None,
        counted: Sequence[_Message],
        wrong: Sequence[_Message] = (),
        *,
        jumped: bool = False,
        first: bool = False,
    ) -> list[Synchronized]:
        """Accept or reject messages of a stream, counting the rejected ones; returns the frames that cannot wait any
        longer.

        last : of the stream, before them. jumped : those that count were doubted. first : `last` was the first.
        """
        pictures = stream in self._streams.values()
        kind, frames = ("pictures" if pictures else "readings"), list[Synchronized]()
        for message in wrong:
            assert last is not None
            off_s = message.time_s - last.time_s
            if -self._timing.jump_s <= off_s <= 0.0:
                self.counts[f"{kind} doubled" if off_s == 0.0 else f"{kind} out of order"] += 1
                continue
            side = "ahead" if off_s > 0.0 else "behind"
            self._note(f"{kind} stamped {side}", stream, f"one is stamped {abs(off_s):.6g} s {side}, and left out")
        if jumped and last is not None:
            by_s, arrival_s = counted[0].time_s - last.time_s, counted[0].arrived_s - last.arrived_s
            free = isinstance(last, Reading) or any(each is last for each in self._waiting)
            if by_s < 0.0 and first and len(counted) > 1 and free:
                # all others speak against the one that came first
                self._note(f"{kind} stamped ahead", stream, f"the first is stamped {-by_s:.6g} s ahead, and left out")
                self.counts[kind] -= 1
                self._waiting = deque(each for each in self._waiting if each is not last)
            else:
                if not 0.0 < by_s < arrival_s + self._timing.jump_s:
                    self._note("jumps of a clock", stream, f"the clock was set by {by_s:+.6g} s, and is followed")
                if by_s < 0.0:
                    # what waits for readings by the clock as it was would wait in vain
                    frames, self._given_s = list(self._flushed()), -np.inf
                    # the frames' times run on, and only these
                    onward_s = max(
                        arrival_s, MESSAGES.instant_s, *(b.time_s - a.time_s for a, b in pairwise(counted[:2]))
                    )
                    if isinstance(last, Taken):
                        self._set_back_s[last.camera] += onward_s - by_s
        for message in counted:
            self.counts[kind] += 1
            at_s = message.time_s + (0.0 if isinstance(message, Taken) else self._timing.offset_s)
            least_s, most_s = self._spans.get(stream, (at_s, at_s))
            self._spans[stream] = min(least_s, at_s), max(most_s, at_s)
            if isinstance(message, Taken):
                self._taken(message)
                continue
            time_s = message.time_s + self._timing.offset_s
            # a picture that it would have served is gone
            self.counts["readings late"] += time_s <= self._given_s
            self._channels.setdefault(stream, _Channel()).add(time_s, message.value)
        return frames

    def _taken(self, message: Taken) -> None:
        """Add a picture to those that wait, ordered by time where there are several cameras."""
        self._begin_s = message.arrived_s if self._begin_s == -np.inf else self._begin_s
        at_s = self._onward_s(message)
        if len(self._sizes) == 1:
            self._waiting.append(message)
        elif at_s > self._last_s:
            self._waiting.insert(bisect_right(self._waiting, at_s, key=self._onward_s), message)
        else:
            self.counts[f"{self._streams[message.camera]} too late for their frames"] += 1

    def _flushed(self) -> Iterator[Synchronized]:
        while self._waiting:
            yield self._frame(self._waiting.popleft())

    def _note(self, what: str, stream: str, words: str) -> None:
        """Count an event, and report the first one of each stream."""
        self.counts[what] += 1
        if (what, stream) not in self._noted:
            self._noted.add((what, stream))
            self._notes.append(f"warning: {stream}: {words}")

    def _frame(self, taken: Taken) -> Synchronized:
        others = list[Taken]()
        for name in self._sizes if len(self._sizes) > 1 else ():
            partner, gap_s = (taken, 0.0) if name == taken.camera else self._partner(taken, name)
            if partner is None:
                self.counts[f"frames without {name}"] += 1
                self._apart_s[name].extend([gap_s] if math.isfinite(gap_s) else [])
            elif partner is not taken:
                others.append(partner)
                self._waiting.remove(partner)
        self._last_s = self._onward_s(taken)
        read = {name: channel.at(taken.time_s, self._timing.gap_s) for name, channel in self._channels.items()}
        values: dict[str, Any] = {name: read[name][0] if name in read else np.nan for name in CHANNELS}
        for name, joint in zip(ANGLES, self._timing.joints_rad, strict=True):
            if name not in read:
                values[name] = joint
        self.counts["pictures without a moment"] += "moment_Nm" in read and math.isnan(values["moment_Nm"])
        self.counts["pictures without joint angles"] += any(math.isnan(values[name]) for name in ANGLES)
        self._given_s, self._number = taken.time_s, self._number + 1
        ages = [age for _, age in read.values()]
        # joint angles count as free of noise
        stds = dict(zip(CHANNELS, self._timing.moment_std_Nm, strict=False))
        errors = [
            self._channels[name].error(taken.time_s, self._timing, stds.get(name, 0.0))
            if name in self._channels
            else 0.0
            for name in CHANNELS
        ]
        values["moment_errors_Nm"], values["joint_errors_rad"] = tuple(errors[:-2]), tuple(errors[-2:])
        values["joints_read"] = tuple(name in read for name in ANGLES)
        frame = Frame(image=None, frame=self._number - 1, time_s=self._onward_s(taken), **values)
        return Synchronized(frame, taken, max(ages, default=np.nan), tuple(others))


def taken_frames(
    messages: Iterable[Taken | Reading | None], synchronizer: Synchronizer
) -> Iterator[tuple[Frame, np.ndarray | Mapping[str, np.ndarray]]]:
    """The frames of a recorded source, with their pictures; by camera name where there are several."""
    pushed = (each for message in messages if message is not None for each in synchronizer.push(message))
    every = chain(pushed, synchronizer.finish())
    return ((each.frame, each.images if each.taken.camera else each.taken.image) for each in every)
