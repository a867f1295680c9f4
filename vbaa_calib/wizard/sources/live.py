"""Frames of a camera or stream as pictures that are offered."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass

import cv2

from ...errors import InputError
from .grabber import Fault, Grabber, Patience
from .offered import Offered, SourceLost, frame_offered


@dataclass(frozen=True)
class Advice:
    """What is wrong and what to do about it, by fault."""

    what: Mapping[Fault, str]
    remedy: Mapping[Fault, str]

    def error(self, kind: type[InputError], fault: Fault, name: str) -> InputError:
        """The error to raise."""
        return kind(self.what[fault], where=name, remedy=self.remedy[fault])


class LiveSource:
    """The newest frames of a device: those that nobody took in time are dropped.

    Frames count from 0; a number whose name is in `seen` is left out, so that names stay unique when a session goes on.
    """

    live = True
    ended = False

    def __init__(
        self,
        name: str,
        opener: Callable[[], cv2.VideoCapture],
        patience: Patience,
        advice: Advice,
        seen: Container[str] = (),
    ) -> None:
        """Opens the device and waits for its first frame. Raises InputError when none comes."""
        self.name = name
        self._advice, self._seen = advice, seen
        self._said: tuple[str, ...] = ()
        self._number = 0
        self._grabber = Grabber(opener, patience)
        try:
            # a little longer than the grabber's own patience, so that it is always the one to say what is wrong
            self._first = self._grabber.newest(patience.open_s + 1)
        except BaseException:
            self.close()
            raise
        if self._first is None:
            fault = self._grabber.fault or "hung"
            self.close()
            raise advice.error(InputError, fault, name)

    @property
    def notes(self) -> tuple[str, ...]:
        """What there was to say so far."""
        times = self._grabber.reopened
        broke = (f"{self.name} broke off and was reached again, time {index + 1}" for index in range(times))
        return (*self._said, *broke)

    def say(self, *notes: str) -> None:
        """Add notes, before the first frame is taken."""
        self._said += notes

    def next(self, timeout_s: float) -> Offered | None:
        """The newest frame, waited for if need be. Raises SourceLost when the device is gone."""
        frame, self._first = self._first or self._grabber.newest(timeout_s), None
        if frame is None:
            fault = self._grabber.fault
            if fault is not None:
                self.close()
                raise self._advice.error(SourceLost, fault, self.name)
            return None
        while (name := f"frame {self._number}") in self._seen:
            self._number += 1
        self._number += 1
        return frame_offered(name, frame.pixels, frame.time_s)

    def close(self) -> None:
        """Let go of the device."""
        self._grabber.close()
