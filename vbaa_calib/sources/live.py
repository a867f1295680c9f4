"""The latest frames of a local camera or a network stream (rtsp, http, udp and others)."""

from __future__ import annotations

import os
import re
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from urllib.parse import parse_qsl, urlsplit

import cv2
import numpy as np

from vbaa_calib.core.errors import Disconnected, InputError

from .files import Picture, frame_picture, printable, silence_opencv

_Fault = Literal["closed", "blank", "broken", "hung"]
"""Cannot be opened; opened but without any frame; its frames stopped; does not respond."""


@dataclass(frozen=True)
class _StreamSettings:
    """Timeouts of a device, and the number of failures after which it is abandoned."""

    open_s: float = 10.0  # timeout of the first frame
    silence_s: float = 5.0  # timeout of the next frame
    failures: int = 20  # failed reads in a row that end it
    retries_s: tuple[float, ...] = ()  # waits before it is opened again
    pause_s: float = 0.05  # after a failed read
    leave_s: float = 0.5  # that its thread has to end
    oldest_stamp_s: float = 1.0  # a driver's stamp that is older is of another clock
    listed_breaks: int = 10  # that are reported one by one; all are counted


class LiveSource:
    """The latest frames of a device, read by a thread; frames that are not fetched in time are dropped.

    Names count from 0 and skip those in `seen`. start_s : time of opening by `time.monotonic`, the zero of frame times.
    dropped : number of dropped frames. queued : how many of the newest frames may wait; more than one: all are decoded.
    reopened : how often it broke off and was reached again.
    retries_s : waits before it is opened again, from the first anew whenever it was reached.
    stamped : the driver's stamps say when frames were taken (V4L2's are of `time.monotonic`).
    """

    live = True
    ended = False

    def __init__(
        self,
        name: str,
        opener: Callable[[], cv2.VideoCapture],
        patience: _StreamSettings,
        faults: Mapping[_Fault, tuple[str, str]],
        seen: Container[str] = (),
        settings: Sequence[str] = (),
    ) -> None:
        """Open the device and wait for its first frame. Raises InputError if none comes.

        faults : words and remedy of each fault. seen : names of pictures to skip. settings : the device's settings in
        words, which `opener` may update.
        """
        self.name = name
        self._opener, self._patience, self._faults = opener, patience, faults
        self._seen, self.settings = seen, settings
        self._number = self._breaks = self.reopened = 0
        self._away, self.retries_s = False, patience.retries_s
        self._changed, self._stop = threading.Condition(), threading.Event()
        self.start_s = time.monotonic()
        self.dropped = 0
        self.queued, self.stamped = 1, False
        self._due_s = self.start_s + patience.open_s
        self._frames = deque[tuple[np.ndarray, float]]()
        self._wanted, self._had_frames = True, False
        self._fault: _Fault | None = None
        self._thread = threading.Thread(target=self._run, name="frames", daemon=True)
        self._thread.start()
        try:
            # a little longer than the thread waits, so that the thread finds the fault
            self._first = self._newest(patience.open_s + 1)
        except BaseException:
            self.close()
            raise
        if self._first is None:
            # closing gives a slow device time to report its fault
            self.close()
            raise self._error(InputError, self._fault_now() or "hung")

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the device's settings, then on interruptions as they happen."""
        broke_off = f"{self.name} broke off; it is opened again as soon as it can be"
        return (*self.settings, *[broke_off] * min(self._breaks, self._patience.listed_breaks))

    def frame(self, timeout_s: float) -> tuple[np.ndarray, float] | None:
        """The latest frame, after waiting for one if necessary: pixels, and its time since `start_s`; None if none
        comes.

        Raises Disconnected if the device is gone.
        """
        frame, self._first = self._first or self._newest(timeout_s), None
        if frame is None and (fault := self._fault_now()) is not None:
            self.close()
            raise self._error(Disconnected, fault)
        return frame

    def next(self, timeout_s: float) -> Picture | None:
        """The latest frame as a picture; None if none comes."""
        frame = self.frame(timeout_s)
        if frame is None:
            return None
        while (name := f"frame {self._number}") in self._seen:
            self._number += 1
        self._number += 1
        return frame_picture(name, *frame)

    @property
    def waiting(self) -> int:
        """Number of frames that can be fetched at once."""
        return len(self._frames)

    def forget(self) -> None:
        """Discard the frames so far."""
        with self._changed:
            self._first, self.dropped = None, 0
            self._frames.clear()

    def close(self) -> None:
        self._stop.set()
        self._thread.join(self._patience.leave_s)

    def _error(self, kind: type[InputError], fault: _Fault) -> InputError:
        what, remedy = self._faults[fault]
        return kind(what, where=self.name, remedy=remedy)

    def _fault_now(self) -> _Fault | None:
        """The reason why no more frames come; None while they may."""
        with self._changed:
            return "hung" if self._fault is None and time.monotonic() > self._due_s else self._fault

    def _newest(self, timeout_s: float) -> tuple[np.ndarray, float] | None:
        """A new frame and its time; None if none comes in time, or after a fault."""
        until_s = time.monotonic() + timeout_s
        with self._changed:
            self._wanted = True
            while not self._frames:
                left_s = min(until_s, self._due_s) - time.monotonic()
                if self._fault or left_s <= 0:
                    return None
                self._changed.wait(left_s)
            self._wanted = False
            return self._frames.popleft()

    def _run(self) -> None:
        retries = iter(self.retries_s)
        while not self._stop.is_set():
            fault, frames = self._read_until_it_breaks()
            if frames:
                retries = iter(self.retries_s)
            wait_s = next(retries, None) if self._had_frames else None
            if wait_s is None:
                with self._changed:
                    self._fault = "broken" if self._had_frames else fault
                    self._changed.notify_all()
                return
            self._breaks += not (self._away or self._stop.is_set())
            self._away = True
            self._expect_frame(wait_s + self._patience.open_s)
            self._stop.wait(wait_s)

    def _read_until_it_breaks(self) -> tuple[_Fault, int]:
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
                taken_s = self._taken_s(capture)
                if pixels is None:
                    failures += 1
                    self._stop.wait(self._patience.pause_s)
                    continue
                self.reopened += self._away
                self._away = False
                failures, frames, self._had_frames = 0, frames + 1, True
                self._expect_frame(self._patience.silence_s)
                with self._changed:
                    if not pixels.size:
                        self.dropped += 1
                        continue
                    if len(self._frames) >= self.queued:
                        self._frames.popleft()
                        self.dropped += 1
                    self._frames.append((pixels, taken_s - self.start_s))
                    self._changed.notify_all()
        finally:
            capture.release()
        return "broken" if frames else "blank", frames

    def _grab(self, capture: cv2.VideoCapture) -> np.ndarray | None:
        """The next frame's pixels, empty for a frame that is not wanted; None without a frame."""
        try:
            if not capture.grab():
                return None
            if not self._wanted and self.queued == 1:
                return np.zeros(0, np.uint8)
            read, pixels = capture.retrieve()
        except cv2.error:
            return None
        usable = read and pixels is not None and pixels.dtype == np.uint8 and pixels.size > 0
        if not usable or pixels.ndim not in (2, 3) or pixels.shape[2:] not in ((), (1,), (3,)):
            return None
        return pixels[..., 0] if pixels.shape[2:] == (1,) else pixels

    def _taken_s(self, capture: cv2.VideoCapture) -> float:
        """Time of the last frame's capture by `time.monotonic`: the V4L2 driver's stamp, else the present time."""
        now_s = time.monotonic()
        try:
            stamp_s = 1e-3 * capture.get(cv2.CAP_PROP_POS_MSEC) if self.stamped else -1.0
        except cv2.error:
            stamp_s = -1.0
        return stamp_s if 0.0 <= now_s - stamp_s < self._patience.oldest_stamp_s else now_s

    def _expect_frame(self, within_s: float) -> None:
        with self._changed:
            self._due_s = time.monotonic() + within_s


_PLUG = "check cable and plug, close other programs that use the camera, then run this again: it goes on where it was"
_CAMERA_FAULTS: dict[_Fault, tuple[str, str]] = {
    "closed": ("the camera cannot be opened", "close other programs that use it, or name another camera"),
    "blank": (
        "the camera opens but gives no picture",
        "close other programs that use it, try another size or fourcc=MJPG, or name another camera",
    ),
    "broken": ("the camera gives no more pictures", _PLUG),
    "hung": ("the camera does not answer", _PLUG),
}


def parse_camera(text: str) -> tuple[int | str, dict[str, Any]]:
    """The device (OpenCV's index or a file) and its settings, from the text after "camera:". Raises InputError."""
    device, _, query = text.partition("?")
    where, settings = f"camera:{printable(text)}", dict[str, Any]()
    like = "write it like camera:0 or camera:0?width=1920&height=1080&fourcc=MJPG"
    most = {"width": 65535, "height": 65535, "fps": 1000}
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key == "fourcc" and re.fullmatch(r"[\x20-\x7e]{4}", value):
            settings[key] = value
        elif key in most and re.fullmatch(r"[0-9]{1,5}", value) and 1 <= int(value) <= most[key]:
            settings[key] = int(value)
        else:
            known = key in most or key == "fourcc"
            what = (
                f"{printable(key)} cannot be {printable(value)!r}"
                if known
                else f"{printable(key)!r} is not known of a camera"
            )
            remedy = f"width, height, fps and fourcc can be asked for; {like}"
            raise InputError(what, where=where, remedy=remedy)
    number = re.fullmatch(r"[0-9]{1,3}", device)
    if not number and not device.startswith("/"):
        raise InputError("is neither a camera's number nor its device", where=where, remedy=like)
    return int(device) if number else device, settings


def open_camera(
    device: int | str,
    asked: Mapping[str, Any] | None = None,
    seen: Container[str] = (),
    patience: _StreamSettings | None = None,
) -> LiveSource:
    """A running camera. Raises InputError if it is missing or gives no picture."""
    name, notes = f"camera:{device}", list[str]()
    _check_device(device, name)

    def opened() -> cv2.VideoCapture:
        silence_opencv()
        backend = cv2.CAP_V4L2 if sys.platform.startswith("linux") else cv2.CAP_ANY
        capture = cv2.VideoCapture(device, backend)
        if capture.isOpened():
            notes[:] = [*_set_up(capture, asked or {}), "the camera's automatic exposure is left as it is"]
        return capture

    source = LiveSource(name, opened, patience or _StreamSettings(), _CAMERA_FAULTS, seen, notes)
    source.stamped = sys.platform.startswith("linux")
    return source


def _check_device(device: int | str, name: str) -> None:
    """Raises InputError for a missing or forbidden device file (Linux only)."""
    if not sys.platform.startswith("linux"):
        return
    path = Path(f"/dev/video{device}" if isinstance(device, int) else device)
    if not path.exists():
        there = []
        for each in sorted(Path("/dev").glob("video*"), key=lambda path: (len(path.name), path.name)):
            try:
                title = (Path("/sys/class/video4linux") / each.name / "name").read_text(errors="replace").strip()
            except OSError:
                title = ""
            there.append(f"{each} ({title})" if title else str(each))
        remedy = f"there are {', '.join(there)}" if there else "this computer shows no camera: plug one in"
        raise InputError(f"there is no {printable(str(path))}", where=name, remedy=remedy)
    if not os.access(path, os.R_OK | os.W_OK):
        remedy = "let the user use cameras, usually `sudo usermod -aG video $USER`, then log in again"
        raise InputError(f"{path} may not be used", where=name, remedy=remedy)


def _set_up(capture: cv2.VideoCapture, wanted: Mapping[str, Any]) -> tuple[str, str]:
    """Apply the settings and switch autofocus off. Returns notes on the result."""
    # the pixel format first: it decides which sizes there are
    if "fourcc" in wanted:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*wanted["fourcc"]))
    sides = {cv2.CAP_PROP_FRAME_WIDTH: wanted.get("width"), cv2.CAP_PROP_FRAME_HEIGHT: wanted.get("height")}
    for key, value in {**sides, cv2.CAP_PROP_FPS: wanted.get("fps")}.items():
        if value:
            capture.set(key, value)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    has = [int(capture.get(key)) for key in sides]
    size = f"the camera gives {has[0]}x{has[1]} px"
    if any(asked not in (None, settings) for asked, settings in zip(sides.values(), has, strict=True)):
        size = f"{'x'.join(str(value or 'any') for value in sides.values())} px were asked for, but {size}"
    if capture.set(cv2.CAP_PROP_AUTOFOCUS, 0) and capture.get(cv2.CAP_PROP_AUTOFOCUS) == 0:
        return size, "autofocus is switched off"
    return size, (
        "autofocus could not be switched off; if the camera has one, switch it off in its own program, "
        "since a lens that focuses anew is another lens"
    )


# FFmpeg has tried on its own before a read fails
_STREAM_PATIENCE = _StreamSettings(failures=1, retries_s=(0.5, 1.0, 2.0, 4.0))


def open_stream(url: str, seen: Container[str] = (), patience: _StreamSettings = _STREAM_PATIENCE) -> LiveSource:
    """A running stream, reopened a few times if it breaks off. Raises InputError, without the URL's secrets."""
    name, stored = printable(url), False
    _check_url(url, name)
    # shorter than the thread's patience, so that FFmpeg ends by itself
    waits = {
        cv2.CAP_PROP_OPEN_TIMEOUT_MSEC: 0.8 * patience.open_s,
        cv2.CAP_PROP_READ_TIMEOUT_MSEC: 0.8 * patience.silence_s,
    }
    settings = [value for key, wait_s in waits.items() for value in (key, int(1000 * wait_s))]

    def opened() -> cv2.VideoCapture:
        nonlocal stored
        silence_opencv()
        capture = cv2.VideoCapture(url, cv2.CAP_FFMPEG, settings)
        # one frame: a camera's snapshot, which is opened anew for each picture
        if capture.isOpened() and capture.get(cv2.CAP_PROP_FRAME_COUNT) > 1:
            stored = True
            capture.release()
        return capture

    try:
        reach = "check that camera and network are up, then run this again: it goes on where it was"
        faults: dict[_Fault, tuple[str, str]] = {
            "closed": ("the stream cannot be opened", "try the address, user and password in a video player"),
            "blank": ("the stream opens but gives no picture", "try the address in a video player"),
            "broken": ("the stream broke off and cannot be reached again", reach),
            "hung": ("the stream does not answer", reach),
        }
        return LiveSource(name, opened, patience, faults, seen)
    except InputError:
        if not stored:
            raise
        what = "is a stored video, not a live stream"
        raise InputError(what, where=name, remedy="save it and name the file") from None


def _check_url(url: str, name: str) -> None:
    like = "write it like rtsp://host:554/path"
    try:
        parts = urlsplit(url)
        scheme, host, port = parts.scheme.lower(), parts.hostname, parts.port
    except ValueError:
        raise InputError("is not a valid URL", where=name, remedy=like) from None
    schemes = ("rtsp", "rtsps", "http", "https", "udp", "rtp", "rtmp", "tcp", "srt")
    kinds = ", ".join(f"{each}://" for each in schemes)
    faults = (
        (scheme == "file", "is a URL of a file", "name the file's path itself"),
        (scheme not in schemes, f"{printable(parts.scheme)}:// is not read", f"these are: {kinds}"),
        (re.search(r"\s", url) or not url.isprintable(), "holds blanks or control characters", "write a blank as %20"),
        (not host and not (port and scheme in ("udp", "rtp")), "names no host", like),
    )
    for wrong, what, remedy in faults:
        if wrong:
            raise InputError(what, where=name, remedy=remedy)
