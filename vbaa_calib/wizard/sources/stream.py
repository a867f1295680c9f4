"""A stream from the net: rtsp, http or https (MJPEG), udp, rtp, rtmp, tcp, srt."""

from __future__ import annotations

import re
from collections.abc import Container
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
    name, stored = shown(url), False
    _check(url, name)
    # shorter than the thread's own patience, so that FFmpeg ends by itself rather than being left behind
    waits = {
        cv2.CAP_PROP_OPEN_TIMEOUT_MSEC: 0.8 * patience.open_s,
        cv2.CAP_PROP_READ_TIMEOUT_MSEC: 0.8 * patience.silence_s,
    }
    settings = [value for key, wait_s in waits.items() for value in (key, int(1000 * wait_s))]

    def opened() -> cv2.VideoCapture:
        nonlocal stored
        silence_opencv()
        capture = cv2.VideoCapture(url, cv2.CAP_FFMPEG, settings)
        # a picture on its own is one "frame" long: that is a camera's snapshot, which is opened anew for each
        if capture.isOpened() and capture.get(cv2.CAP_PROP_FRAME_COUNT) > 1:
            stored = True
            capture.release()
        return capture

    try:
        return LiveSource(name, opened, patience, _FAULTS, seen)
    except InputError:
        if not stored:
            raise
        what = "is a stored video, not a live stream"
        raise InputError(what, where=name, remedy="save it and name the file") from None


def _check(url: str, name: str) -> None:
    like = "write it like rtsp://host:554/path"
    try:
        parts = urlsplit(url)
        scheme, host, port = parts.scheme.lower(), parts.hostname, parts.port
    except ValueError:
        raise InputError("is not a valid URL", where=name, remedy=like) from None
    kinds = ", ".join(f"{each}://" for each in _SCHEMES)
    faults = (
        (scheme == "file", "is a URL of a file", "name the file's path itself"),
        (scheme not in _SCHEMES, f"{shown(parts.scheme)}:// is not read", f"these are: {kinds}"),
        (re.search(r"\s", url) or not url.isprintable(), "holds blanks or control characters", "write a blank as %20"),
        (not host and not (port and scheme in _NO_HOST), "names no host", like),
    )
    for wrong, what, remedy in faults:
        if wrong:
            raise InputError(what, where=name, remedy=remedy)
