"""A stream from the net: rtsp, http or https (MJPEG), udp, rtp, rtmp, tcp, srt."""

from __future__ import annotations

from collections.abc import Callable, Container
from urllib.parse import urlsplit

import cv2

from vbaa_calib.core.errors import InputError

from .live import Fault, LiveSource, Patience, silence_opencv
from .picture import shown

_SCHEMES = ("rtsp", "rtsps", "http", "https", "udp", "rtp", "rtmp", "tcp", "srt")
_NO_HOST = ("udp", "rtp")
_REACH = "check that camera and network are up, then run this again: it goes on where it was"
_FAULTS: dict[Fault, tuple[str, str]] = {
    "closed": ("the stream cannot be opened", "try the address, user and password in a video player"),
    "blank": ("the stream opens but gives no picture", "try the address in a video player"),
    "broken": ("the stream broke off and cannot be reached again", _REACH),
    "hung": ("the stream does not answer", _REACH),
}
# FFmpeg has tried on its own before a read fails
_STREAM_PATIENCE = Patience(failures=1, retries_s=(0.5, 1.0, 2.0, 4.0))


def open_stream(url: str, seen: Container[str] = (), patience: Patience = _STREAM_PATIENCE) -> LiveSource:
    """A stream, running; when it breaks off it is opened again, a few times. Raises InputError.

    User, password and tokens in the URL are never shown.
    """
    name = shown(url)
    _check(url, name)
    kept: list[bool] = []
    try:
        return LiveSource(name, _opener(url, patience, kept), patience, _FAULTS, seen)
    except InputError:
        if kept:
            what = "is a stored video, not a live stream"
            raise InputError(what, where=name, remedy="save it and name the file") from None
        raise


def _check(url: str, name: str) -> None:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise InputError("is not a valid URL", where=name, remedy="write it like rtsp://host:554/path") from None
    if parts.scheme.lower() == "file":
        raise InputError("is a URL of a file", where=name, remedy="name the file's path itself")
    if parts.scheme.lower() not in _SCHEMES:
        kinds = ", ".join(f"{scheme}://" for scheme in _SCHEMES)
        raise InputError(f"{shown(parts.scheme)}:// is not read", where=name, remedy=f"these are: {kinds}")
    if any(sign.isspace() or not sign.isprintable() for sign in url):
        raise InputError("holds blanks or control characters", where=name, remedy="write a blank as %20")
    if not host and not (port and parts.scheme.lower() in _NO_HOST):
        raise InputError("names no host", where=name, remedy="write it like rtsp://host:554/path")


def _opener(url: str, patience: Patience, kept: list[bool]) -> Callable[[], cv2.VideoCapture]:
    # shorter than the thread's own patience, so that FFmpeg ends by itself rather than being left behind
    waits = {
        cv2.CAP_PROP_OPEN_TIMEOUT_MSEC: 0.8 * patience.open_s,
        cv2.CAP_PROP_READ_TIMEOUT_MSEC: 0.8 * patience.silence_s,
    }
    settings = [value for key, wait_s in waits.items() for value in (key, int(1000 * wait_s))]

    def opened() -> cv2.VideoCapture:
        silence_opencv()
        capture = cv2.VideoCapture(url, cv2.CAP_FFMPEG, settings)
        # a picture on its own is one "frame" long: that is a camera's snapshot, which is opened anew for each
        if capture.isOpened() and capture.get(cv2.CAP_PROP_FRAME_COUNT) > 1:
            kept.append(True)
            capture.release()
        return capture

    return opened
