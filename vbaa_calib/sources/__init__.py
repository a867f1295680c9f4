"""Sources of pictures: a folder that is being filled, a camera, a video, a stream."""

from __future__ import annotations

import stat
from collections.abc import Container
from pathlib import Path
from typing import Protocol

from vbaa_calib.core.errors import InputError, reason_of
from vbaa_calib.core.images import SUFFIXES

from .files import FolderSource, Picture, VideoSource, printable
from .live import LiveSource, open_camera, open_stream, parse_camera


class PictureSource(Protocol):
    """Interface of a source that delivers pictures one after the other.

    name : for the screen, without a URL's secrets. notes : messages so far. live : a stream of frames, of which one is
    accepted when the scene rests; else every picture counts.
    """

    live: bool
    name: str

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the pictures so far."""

    @property
    def ended(self) -> bool:
        """Whether the source has ended."""

    def next(self, timeout_s: float) -> Picture | None:
        """The next picture; None if there is no new one within the timeout. Raises Disconnected."""

    def close(self) -> None:
        """Releases the source; a second call does nothing."""


_KINDS = "name a folder of pictures, a video, a bag, a camera like camera:0, or a stream like rtsp://host/path"


def open_source(text: str, seen: Container[str] = (), wait: bool = False) -> PictureSource:
    """Open a source: "camera:0", "/dev/video0", the path of a folder or video, or a stream's URL. Raises InputError.

    seen : names of pictures to skip. wait : watch a folder for more pictures.
    """
    if not text.strip():
        raise InputError("no source of pictures is named", remedy=_KINDS)
    if len(text) > 4096 or "\0" in text:
        raise InputError("is not a valid path", where=printable(text), remedy=_KINDS)
    if text.startswith("camera:"):
        return open_camera(*parse_camera(text.removeprefix("camera:")), seen)
    if "://" in text:
        return open_stream(text, seen)
    path = Path(text)
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        if text.startswith("/dev/video"):
            open_camera(text)  # raises, with the cameras that are there
        digits = f"for a camera write camera:{text}; or " if text.isdigit() and len(text) < 4 else ""
        raise InputError("no such folder or video", where=printable(text), remedy=f"{digits}{_KINDS}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read ({reason_of(error)})", where=printable(text), remedy=_KINDS) from None
    if stat.S_ISDIR(mode):
        return FolderSource(path, seen, wait)
    if stat.S_ISCHR(mode):
        return open_camera(str(path.absolute()), seen=seen)
    if not stat.S_ISREG(mode):
        raise InputError("is neither folder, video nor camera", where=printable(text), remedy=_KINDS)
    if path.suffix.lower() in SUFFIXES:
        raise InputError("is a single picture", where=printable(text), remedy="name the folder that holds the pictures")
    return VideoSource(path, seen)
