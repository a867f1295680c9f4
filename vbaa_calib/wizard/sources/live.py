"""The newest frames of a camera or stream."""

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

from .picture import Picture, SourceLost, frame_picture

Fault = Literal["closed", "blank", "broken", "hung"]
"""Could not be opened; opened but never gave a frame; its frames stopped; it does not answer."""

_PAUSE_S = 0.05
_LEAVE_S = 0.5


@dataclass(frozen=True)
class Patience:
    """How long a device is waited for: for its first frame, and for the next one; and how many reads may fail in turn.

    retries_s : waits before each try to open it again, once there were frames; empty: it is not tried.
    """

    open_s: float = 10.0
    silence_s: float = 5.0
    failures: int = 20
    retries_s: tuple[float, ...] = ()


def silence_opencv() -> None:
    """Keep OpenCV's and FFmpeg's own lines off the terminal: the sources report what matters."""
    # FFmpeg's level is read once, when the first capture is opened; -8 is its "quiet"
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


class LiveSource:
    """The newest frames of a device: those that nobody took in time are dropped, and not decoded.

    Frames count from 0; a number whose name is in `seen` is left out, so that names stay unique when a session goes on.
    A thread reads the device; one that hangs is left behind and ends with the process.
    """

    live = True
    ended = False

    def __init__(
        self,
        name: str,
        opener: Callable[[], cv2.VideoCapture],
        patience: Patience,
        faults: Mapping[Fault, tuple[str, str]],
        seen: Container[str] = (),
    ) -> None:
        """Opens the device and waits for its first frame. faults : what is wrong, and the remedy.

        Raises InputError when no frame comes.
        """
        self.name = name
        self._opener, self._patience, self._faults, self._seen = opener, patience, faults, seen
        self._notes: tuple[str, ...] = ()
        self._number = self._reopened = 0
        self._changed, self._stop = threading.Condition(), threading.Event()
        self._start_s = time.monotonic()
        self._due_s = self._start_s + patience.open_s
        self._frame: tuple[np.ndarray, float] | None = None
        self._wanted, self._had_frames = True, False
        self._fault: Fault | None = None
        self._thread = threading.Thread(target=self._run, name="frames", daemon=True)
        self._thread.start()
        try:
            # a little longer than the thread's own patience, so that the thread finds what is wrong
            self._first = self._newest(patience.open_s + 1)
        except BaseException:
            self.close()
            raise
        if self._first is None:
            self.close()
            raise self._error(InputError, self._fault_now() or "hung")

    @property
    def notes(self) -> tuple[str, ...]:
        """Messages so far."""
        times = range(1, self._reopened + 1)
        return (*self._notes, *(f"{self.name} broke off and was reached again, time {time}" for time in times))

    def add_notes(self, *notes: str) -> None:
        """Add messages, before the first frame is taken."""
        self._notes += notes

    def next(self, timeout_s: float) -> Picture | None:
        """The newest frame, waited for if need be. Raises SourceLost when the device is gone."""
        frame, self._first = self._first or self._newest(timeout_s), None
        if frame is None:
            fault = self._fault_now()
            if fault is not None:
                self.close()
                raise self._error(SourceLost, fault)
            return None
        while (name := f"frame {self._number}") in self._seen:
            self._number += 1
        self._number += 1
        return frame_picture(name, *frame)

    def close(self) -> None:
        """Let go of the device."""
        self._stop.set()
        self._thread.join(_LEAVE_S)

    def _error(self, kind: type[InputError], fault: Fault) -> InputError:
        what, remedy = self._faults[fault]
        return kind(what, where=self.name, remedy=remedy)

    def _fault_now(self) -> Fault | None:
        """Why there are no more frames; None while there may be some."""
        with self._changed:
            if self._fault is None and time.monotonic() > self._due_s:
                return "hung"
            return self._fault

    def _newest(self, timeout_s: float) -> tuple[np.ndarray, float] | None:
        """A frame that was not given before, and its time; None when none came in time, or there is a fault."""
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

    def _run(self) -> None:
        retries = iter(self._patience.retries_s)
        while not self._stop.is_set():
            fault, frames = self._read_until_it_breaks()
            if frames:
                retries = iter(self._patience.retries_s)
            wait_s = next(retries, None) if self._had_frames else None
            if wait_s is None:
                with self._changed:
                    self._fault = "broken" if self._had_frames else fault
                    self._changed.notify_all()
                return
            self._expect_frame(wait_s + self._patience.open_s)
            self._stop.wait(wait_s)

    def _read_until_it_breaks(self) -> tuple[Fault, int]:
        """What happened, and how many frames came."""
        try:
            capture = self._opener()
        except cv2.error:
            return "closed", 0
        failures = frames = 0
        try:
            if not capture.isOpened():
                return "closed", 0
            while not self._stop.is_set() and failures < self._patience.failures:
                pixels = self._grab(capture)
                if pixels is None:
                    failures += 1
                    self._stop.wait(_PAUSE_S)
                    continue
                self._reopened += frames == 0 and self._had_frames
                failures, frames, self._had_frames = 0, frames + 1, True
                self._expect_frame(self._patience.silence_s)
                if pixels.size:
                    with self._changed:
                        self._frame = pixels, time.monotonic() - self._start_s
                        self._changed.notify_all()
        finally:
            capture.release()
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

    def _expect_frame(self, within_s: float) -> None:
        with self._changed:
            self._due_s = time.monotonic() + within_s
