"""The source that is named on a command line."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from vbaa_calib.camera import Camera
from vbaa_calib.convert.child import is_bag
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import require_file
from vbaa_calib.sources import open_source
from vbaa_calib.sources.live import LiveSource

from .bags import Topics, open_bag
from .devices import open_device
from .messages import MessageSource
from .recorded import open_folder, open_lines, open_table, open_video, with_readings


def is_recorded(path: Path) -> bool:
    """Whether a path is meant for a stream that was recorded: a bag, a video, a table of pictures."""
    videos = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg", ".ts")
    return is_bag(path) or path.suffix.lower() in (*videos, ".csv")


def open_recorded(
    path: Path, camera: Camera, table: Path | None, offset_s: float | None = 0.0, topics: Topics | None = None
) -> MessageSource:
    """A bag, a video or a table of pictures, with the readings of a table, if one is given.

    offset_s : added to the readings' times; None: to be estimated. Raises InputError, also for a bag of another camera.
    """
    source = open_bag(path, topics or Topics(), camera, offset_s) if is_bag(path) else open_pictures(path)
    return with_readings(source, table, offset_s or 0.0)


def open_pictures(path: Path) -> MessageSource:
    """A video, or a table of pictures. Raises InputError."""
    require_file(path)
    return open_table(path) if path.suffix.lower() == ".csv" else open_video(path)


def open_running(text: str, idle_s: float) -> MessageSource:
    """ "-", camera:0, a device, a stream's URL, or a folder that fills up. Raises InputError."""
    if text == "-":
        return open_lines(sys.stdin.buffer, idle_s)
    if os.path.isdir(text):
        return open_folder(Path(text), idle_s)
    found = open_source(f"camera:{text}" if text.isdigit() else text)
    if not isinstance(found, LiveSource):
        raise InputError("is no source", where=text, remedy="name a camera, a stream, a folder, a bag or a video, or -")
    return open_device(found)
