"""A picture of a source, and what every source can do."""

from __future__ import annotations

import hashlib
import os
import re
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError

_LONGEST = 100
_USER = re.compile(r"://.*@", re.DOTALL)
_SECRET = re.compile(r"([?&;][^=&;]*(?:pass|pwd|user|usr|token|key|auth|secret|sig)[^=&;]*=)[^&;#]*", re.IGNORECASE)


def without_secrets(text: str) -> str:
    """A URL without user, password and tokens.

    All up to the last @ goes, since a password may hold one, or a slash.
    """
    return _SECRET.sub(r"\1***", _USER.sub("://***@", text))


def shown(text: str) -> str:
    """A text for a message: one line, at most 100 characters, without secrets."""
    line = "".join(sign if sign.isprintable() else "?" for sign in without_secrets(text))
    return line if len(line) <= _LONGEST else f"{line[:_LONGEST]}…"


_TO_GRAY = np.array([[3737 / 2**15, 19234 / 2**15, 9797 / 2**15, 2**-16 - 0.5]])
"""libpng's grey of blue, green and red, which truncates; half a level less makes OpenCV's rounding do that."""


class SourceLost(InputError):
    """A source that was there gives no more pictures: unplugged, broken off, taken away."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of a source, by a name that is unique within it: a file's, or "frame 12".

    image : (H, W) uint8 grey, as `vbaa_calib.core.images.read_gray` gives it of `data`, which is stored as `suffix`.
    content : a file's own bytes, or a live frame's pixels, (H, W) grey or (H, W, 3) blue, green, red, uint8.
    time_s : of a frame, since the source was opened or the video began; None for files.
    """

    name: str
    image: np.ndarray
    suffix: str
    content: bytes | np.ndarray = field(repr=False)
    time_s: float | None = None

    @cached_property
    def data(self) -> bytes:
        """What is stored when the picture is accepted: the file's own bytes, or a live frame as PNG, in colour."""
        if isinstance(self.content, bytes):
            return self.content
        done, png = cv2.imencode(".png", self.content, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not done:
            raise InputError("cannot be stored as PNG", where=self.name, remedy="take the picture again")
        return png.tobytes()

    @cached_property
    def sha256(self) -> str:
        return hashlib.sha256(self.data).hexdigest()


def silence_opencv() -> None:
    """Keep OpenCV's and FFmpeg's own lines off the terminal: the sources report what matters."""
    # FFmpeg's level is read once, when the first capture is opened; -8 is its "quiet"
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def frame_picture(name: str, pixels: np.ndarray, time_s: float) -> Picture:
    """A live frame: (H, W) grey or (H, W, 3) blue, green, red, uint8."""
    gray = pixels if pixels.ndim == 2 else cv2.transform(pixels, _TO_GRAY)
    return Picture(name, gray, ".png", pixels, time_s)
