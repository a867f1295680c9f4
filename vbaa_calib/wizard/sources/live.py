"""Frames of a camera or stream as pictures that are offered."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError

from .offered import Offered, SourceLost, frame_offered

Fault = Literal["closed", "blank", "broken", "hung"]
"""Could not be opened; opened but never gave a frame; its frames stopped; it does not answer."""

_PAUSE_S = 0.05
_LEAVE_S = 0.5


@dataclass(frozen=True)
class Patience:
    """How long a device is waited for.

    Attributes
    ----------
    open_s : until it is open and has given a first frame.
    silence_s : without a frame, once there were some.
    failures : reads that may fail one after the other.
    retries_s : waits before each try to open it again, once there were frames; empty: it is not tried.
    """

    open_s: float = 10.0
    silence_s: float = 5.0
    failures: int = 20
    retries_s: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Frame:
    """(H, W) or (H, W, 3) uint8 pixels, and the time since the source was opened."""

    pixels: np.ndarray
    time_s: float


def silence_opencv() -> None:
    """Keep OpenCV's and FFmpeg's own lines off the terminal: what matters is said by the sources."""
    # FFmpeg's level is read once, when the first capture is opened; -8 is its "quiet"
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


class Grabber:
    """The newest frame of a capture. Older ones are dropped; only those asked for are decoded."""

    def __init__(self, opener: Callable[[], cv2.VideoCapture], patience: Patience) -> None:
        self._opener, self._patience = opener, patience
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._start_s = time.monotonic()
        self._due_s = self._start_s + patience.open_s
        self._frame: Frame | None = None
        self._wanted = True
        self._had_frames = False
        self._fault: Fault | None = None
        self.reopened = 0
        self._thread = threading.Thread(target=self._run, name="frames", daemon=True)
        self._thread.start()

    @property
    def fault(self) -> Fault | None:
        """Why there are no more frames; None while there may be some."""
        with self._changed:
            if self._fault is None and time.monotonic() > self._due_s:
                return "hung"
            return self._fault

    def newest(self, timeout_s: float) -> Frame | None:
        """A frame that was not given before; None when none came in time, or when there is a `fault`."""
        until_s = time.monotonic() + timeout_s
        with self._changed:
            self._wanted = True
            while self._frame is None:
                left_s = min(until_s, self._due_s) - time.monotonic()
                if self._fault or left_s <= 0:
                    return None
                self._changed.wait(left_s)
            frame, self._frame, self._wanted = self._frame, None, False
            return frame

    def close(self) -> None:
        """Let the thread release the capture; one that hangs is left behind, it ends with the process."""
        self._stop.set()
        self._thread.join(_LEAVE_S)

    def _run(self) -> None:
        retries = iter(self._patience.retries_s)
        while not self._stop.is_set():
            fault, frames = self._session()
            if frames:
                retries = iter(self._patience.retries_s)
            wait_s = next(retries, None) if self._had_frames else None
            if wait_s is None:
                self._tell(fault if not self._had_frames else "broken")
                return
            self._expect(wait_s + self._patience.open_s)
            self._stop.wait(wait_s)

    def _session(self) -> tuple[Fault, int]:
        """Open, read until it breaks, release; what happened, and how many frames came."""
        try:
            capture = self._opener()
        except cv2.error:
            return "closed", 0
        try:
            if not capture.isOpened():
                return "closed", 0
            return self._read(capture)
        finally:
            capture.release()

    def _read(self, capture: cv2.VideoCapture) -> tuple[Fault, int]:
        failures = frames = 0
        while not self._stop.is_set() and failures < self._patience.failures:
            pixels = self._grab(capture)
            if pixels is None:
                failures += 1
                self._stop.wait(_PAUSE_S)
                continue
            if frames == 0 and self._had_frames:
                self.reopened += 1
            failures, frames, self._had_frames = 0, frames + 1, True
            self._expect(self._patience.silence_s)
            if pixels.size:
                self._give(pixels)
        return "broken" if frames else "blank", frames

    def _grab(self, capture: cv2.VideoCapture) -> np.ndarray | None:
        """The next frame's pixels, empty if nobody wants them; None where there is no frame."""
        try:
            if not capture.grab():
                return None
            if not self._wanted:
                return np.zeros(0, np.uint8)
            read, pixels = capture.retrieve()
        except cv2.error:
            return None
        usable = read and pixels is not None and pixels.dtype == np.uint8 and pixels.size > 0
        if not usable or pixels.ndim not in (2, 3) or pixels.shape[2:] not in ((), (1,), (3,)):
            return None
        return pixels[..., 0] if pixels.shape[2:] == (1,) else pixels

    def _give(self, pixels: np.ndarray) -> None:
        with self._changed:
            self._frame = Frame(pixels, time.monotonic() - self._start_s)
            self._changed.notify_all()

    def _expect(self, within_s: float) -> None:
        with self._changed:
            self._due_s = time.monotonic() + within_s

    def _tell(self, fault: Fault) -> None:
        with self._changed:
            self._fault = fault
            self._changed.notify_all()


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
