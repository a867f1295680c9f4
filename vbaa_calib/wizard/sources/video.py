"""The frames of a video file, in order, each of them."""

from __future__ import annotations

import math
from collections.abc import Container
from pathlib import Path

import cv2

from vbaa_calib.core.errors import InputError

from .live import silence_opencv
from .picture import Picture, frame_picture, shown

_AGAIN = "record or copy it again, or turn it into a folder of pictures"
_USUAL_FPS = 30.0
_READABLE_SHARE = 0.95


class VideoSource:
    """Every frame of a video, named by its place in it from 0 on: the same from run to run.

    It is judged by holding still, like a live stream, but no frame is dropped, however slow the reader is.
    """

    live = True

    def __init__(self, path: Path, seen: Container[str] = ()) -> None:
        """Raises InputError when the file holds no video that can be read."""
        silence_opencv()
        self.name = shown(path.name)
        self.ended = False
        self.notes: tuple[str, ...] = ()
        self._seen = seen
        self._time_s = -math.inf
        self._index = 0
        self._capture = cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG)
        # in the sensor's own orientation, as pictures are read
        self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        if not self._capture.isOpened() or not self._capture.grab():
            self._capture.release()
            raise InputError("is not a video that can be read", where=shown(str(path)), remedy=_AGAIN)
        self._frame_count = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        fps = self._capture.get(cv2.CAP_PROP_FPS)
        self._fps = fps if 1 <= fps <= 1000 else _USUAL_FPS

    def next(self, timeout_s: float) -> Picture | None:
        """The next frame; None at the end."""
        while not self.ended:
            index, name = self._index, f"frame {self._index}"
            time_s = self._stamp()
            read, pixels = (False, None) if name in self._seen else self._capture.retrieve()
            self._index += 1
            if not self._capture.grab():
                self._end()
            if read and pixels is not None and pixels.size:
                return frame_picture(f"frame {index}", pixels, time_s)
        return None

    def close(self) -> None:
        """Let go of the file."""
        self.ended = True
        self._capture.release()

    def _stamp(self) -> float:
        """The frame's time since the video began, s; one frame after the last where the file does not hold it."""
        time_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        if not math.isfinite(time_s) or time_s < 0 or time_s <= self._time_s:
            time_s = 0.0 if self._index == 0 else self._time_s + 1 / self._fps
        self._time_s = time_s
        return time_s

    def _end(self) -> None:
        if self._index < _READABLE_SHARE * self._frame_count:
            read = f"{self._index} of its {self._frame_count:.0f} frames can be read"
            self.notes += (f"{self.name} is cut off or damaged: {read}",)
        self.close()
