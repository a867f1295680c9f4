"""Opens the source that a command line names: live, or recorded.

A recording is a CSV of readings, a video, a folder of pictures that may grow, a bag, or JSON lines.
"""

from __future__ import annotations

import heapq
import math
import os
import select
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from time import perf_counter
from typing import BinaryIO

import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.core.csv_rows import csv_rows, header_of, number
from vbaa_calib.core.errors import Disconnected, InputError
from vbaa_calib.core.files import is_bag, require_file
from vbaa_calib.core.images import read_picture
from vbaa_calib.session import CHANNELS
from vbaa_calib.session.tables import IN_DEGREES
from vbaa_calib.sources import open_source
from vbaa_calib.sources.files import FolderSettings, FolderSource, VideoSource
from vbaa_calib.sources.live import LiveSource

from .bags import Topics, open_bag
from .devices import open_device
from .messages import MESSAGES, Messages, MessageSource, Reading, Taken, line_messages, now_s
from .synchronize import Timing


def open_recorded(
    path: Path,
    camera: Camera | Mapping[str, Camera],
    table: Path | None,
    offset_s: float | None = 0.0,
    topics: Topics | None = None,
    views: Mapping[str, tuple[str, float]] | None = None,
) -> MessageSource:
    """A bag, a video or a table of pictures, with the readings of another table, if any.

    camera : the rig's, or several by name; `views` has by name another source in which one was recorded, "" for this
        one, and an offset added to its times. offset_s : added to the readings' times; None: to be estimated. Raises
    InputError, also for a bag of another camera.
    """

    def opened(path: Path, camera: Camera | Mapping[str, Camera]) -> MessageSource:
        if is_bag(path):
            return open_bag(path, topics or Topics(), camera, offset_s)
        return open_pictures(path, list(camera) if isinstance(camera, Mapping) else ())

    if isinstance(camera, Mapping):
        own, others = _of_views(camera, views or {}, str(path))
        source = opened(path, {name: camera[name] for name in own})
        for name, shift_s in own.items():
            source = source.of_camera(name, shift_s)
        further = [
            opened(Path(text), camera[name]).of_camera(name, shift_s, shift_s)
            for name, (text, shift_s) in others.items()
        ]
        source = source.with_pictures_of(further) if further else source
    else:
        source = opened(path, camera)
    return _with_readings(source, table, offset_s or 0.0)


def _of_views(
    cameras: Iterable[str], views: Mapping[str, tuple[str, float]], where: str
) -> tuple[dict[str, float], dict[str, tuple[str, float]]]:
    """Time offsets of the cameras in a source, and the other cameras' own sources. Raises InputError where no camera
    is left for the source."""
    every = {name: views.get(name, ("", 0.0)) for name in cameras}
    own = {name: shift_s for name, (text, shift_s) in every.items() if not text}
    if not own and where != "-":
        remedy = "leave one --source out: this is its source"
        raise InputError(f"each camera, {', '.join(every)}, has another source", where=where, remedy=remedy)
    return own, {name: each for name, each in every.items() if each[0]}


def open_pictures(path: Path, cameras: Sequence[str] = ()) -> MessageSource:
    """A video, or a table of pictures, with columns by name for several cameras. Raises InputError."""
    require_file(path)
    return _open_table(path, cameras) if path.suffix.lower() == ".csv" else _open_video(path)


def open_running(
    text: str, idle_s: float, cameras: Sequence[str] = (), views: Mapping[str, tuple[str, float]] | None = None
) -> MessageSource:
    """A live source: "-", camera:0, a device, a stream's URL, or a folder that is being filled; for several cameras
    a folder of such folders by their names, and what `views` names as in `open_recorded`. Raises InputError."""
    if not cameras:
        return _opened(text, idle_s)
    every = {name: (views or {}).get(name, ("", 0.0)) for name in cameras}
    inside = {name: os.path.join(text, name) for name, each in every.items() if not each[0]}
    folders = bool(inside) and all(map(os.path.isdir, inside.values()))
    every |= {name: (path, every[name][1]) for name, path in inside.items()} if folders else {}
    own, others = _of_views(cameras, every, "-" if folders else text)
    further = [_opened(each, idle_s).of_camera(name, shift_s) for name, (each, shift_s) in others.items()]
    if folders:
        return further[0].with_pictures_of(further[1:])
    source = _opened(text, idle_s)
    for name, shift_s in own.items():
        source = source.of_camera(name, shift_s)
    return source.with_pictures_of(further) if further else source


def _opened(text: str, idle_s: float) -> MessageSource:
    """A live source by its name: JSON lines on stdin (-), a folder, a camera or a stream. Raises InputError."""
    if text == "-":
        return _open_lines(sys.stdin.buffer, idle_s)
    if os.path.isdir(text):
        return _open_folder(Path(text), idle_s)
    found = open_source(f"camera:{text}" if text.isdigit() else text)
    if not isinstance(found, LiveSource):
        raise InputError("is no source", where=text, remedy="name a camera, a stream, a folder, a bag or a video, or -")
    return open_device(found)


def _in_turn(rows: Iterable[Mapping[str, str]], path: Path) -> Iterator[tuple[Mapping[str, str], float, float]]:
    """Rows with their times and arrival times, in the order of the file even where a time is out of order."""
    came_s, before = -math.inf, None
    for row in chain(rows, [None]):
        time_s = math.inf if row is None else number(row, "time_s", path)
        if before is not None:
            came_s = max(came_s, min(before[1], time_s))
            yield *before, came_s
        before = None if row is None else (row, time_s)


def _csv_readings(path: Path) -> tuple[frozenset[str], Iterator[Reading]]:
    """The channels in a table, and its readings: time_s and any of moment_Nm, moment_z_Nm, pan_rad, tilt_rad.

    pan_deg and tilt_deg are taken, too; an empty cell is no reading. Raises InputError with file, line and remedy.
    """
    rows = csv_rows(path, ("time_s",), (*CHANNELS, *IN_DEGREES.values()))
    first = next(rows)
    names = {name: name for name in CHANNELS if name in first}
    names |= {name: other for name, other in IN_DEGREES.items() if name not in first and other in first}
    if not names:
        raise InputError("has no column of readings", where=path, remedy=f"time_s and any of {','.join(CHANNELS)}")

    def read() -> Iterator[Reading]:
        for row, time_s, came_s in _in_turn(chain([first], rows), path):
            for channel, name in names.items():
                if row[name]:
                    value = number(row, name, path)
                    yield Reading(time_s, channel, math.radians(value) if name != channel else value, came_s)

    return frozenset(names), read()


def _with_readings(source: MessageSource, path: Path | None, offset_s: float) -> MessageSource:
    """A recorded source merged with the readings of a table, each before the first picture that is not earlier."""
    if path is None:
        return source
    channels, readings = _csv_readings(path)

    def messages() -> Messages:
        # as it is on the source's clock, so that a picture waits by that
        stamped = (replace(each, arrived_s=each.arrived_s + offset_s) for each in readings)
        ahead, later_s = _first_pictures(several := source.messages())

        def arrived_s(message: Taken | Reading | None) -> float:
            """Arrival time in the clock of the stamps, which may differ from that of arrival; a single wrong stamp
            does not count."""
            assert message is not None
            if isinstance(message, Reading):
                return message.arrived_s
            return message.arrived_s + later_s

        yield from heapq.merge(stamped, chain(ahead, several), key=arrived_s)

    return replace(source, messages=messages, channels=source.channels | channels)


def _first_pictures(messages: Messages) -> tuple[list[Taken | Reading | None], float]:
    """The messages up to the fifth picture, and by how much pictures are stamped later than they arrive: that of the
    first picture, or the median of all if the first differs from it by more than a jump."""
    ahead, later_s = list[Taken | Reading | None](), list[float]()
    for message in messages:
        ahead.append(message)
        if isinstance(message, Taken):
            later_s.append(message.time_s - message.arrived_s)
            if len(later_s) == 5:
                break
    usual_s = float(np.median(later_s or [0.0]))
    return ahead, later_s[0] if later_s and abs(later_s[0] - usual_s) <= Timing.jump_s else usual_s


def _open_video(path: Path) -> MessageSource:
    """Every frame of a video, timed from its beginning. Raises InputError when it cannot be read."""
    video, notes = VideoSource(path), list[str]()

    def messages() -> Messages:
        try:
            while (picture := video.next(0.0)) is not None:
                assert picture.time_s is not None
                yield Taken(picture.time_s, np.asarray(picture.content), picture.time_s, perf_counter())
            notes.extend(video.notes)
        finally:
            video.close()

    return MessageSource(path.name, messages, notes=notes)


def _open_table(path: Path, cameras: Sequence[str] = ()) -> MessageSource:
    """The pictures in a table like recording.csv, at its times; for several cameras in columns like image_left.
    Raises InputError."""
    header = header_of(path)
    columns = {f"image_{name}": name for name in cameras if f"image_{name}" in header} or {"image": ""}
    rows = csv_rows(path, ("time_s", *columns))
    first = next(rows)
    notes: list[str] = []

    def messages() -> Messages:
        for row, time_s, came_s in _in_turn(chain([first], rows), path):
            for column, name in columns.items():
                if name and not row[column]:
                    continue
                try:
                    image = read_picture(path.parent / row[column])
                    yield Taken(time_s, image, came_s, perf_counter(), camera=name)
                except InputError as error:
                    notes.append(f"{error}; left out")

    return MessageSource(path.name, messages, notes=notes)


def _open_folder(path: Path, idle_s: float) -> MessageSource:
    """A folder that is being filled: pictures by name, then as they come, timed by their modification times.

    It ends when nothing has come for `idle_s`. Raises InputError when it cannot be read.
    """
    folder = FolderSource(path, wait=True, pace=FolderSettings(scan_s=0.05, steady_s=0.1))
    notes: list[str] = []

    def messages() -> Messages:
        until_s = time.monotonic() + idle_s
        try:
            while time.monotonic() < until_s:
                picture = folder.next(MESSAGES.tick_s)
                if picture is None:
                    yield None
                    continue
                until_s = time.monotonic() + idle_s
                written_s = (path / picture.name).stat().st_mtime
                assert isinstance(picture.content, bytes)
                yield Taken(written_s, read_picture(Path(picture.name), picture.content), now_s(), perf_counter())
            notes.append(f"{folder.name} gave nothing new for {idle_s:g} s")
        except (Disconnected, OSError) as error:
            notes.append(str(error))
        notes.extend(folder.notes)

    return MessageSource(folder.name, messages, live=True, notes=notes)


def _open_lines(stream: BinaryIO, idle_s: float, root: Path = Path()) -> MessageSource:
    """JSON lines with time_s, readings by name, and `image`: a path, or a picture's bytes in base64.

    An invalid line is left out and counted. It ends with the stream, or when nothing came for `idle_s`.
    """
    notes: list[str] = []
    wrong = 0

    def messages() -> Messages:
        nonlocal wrong
        for line in _lines(stream, idle_s, notes):
            if line is None:
                yield None
                continue
            try:
                found = list(line_messages(line, root))
            except InputError as error:
                wrong += 1
                if wrong == 1:
                    notes.append(f"a line is left out: {error}")
                continue
            yield from found
        if wrong > 1:
            notes.append(f"{wrong} lines were left out")

    return MessageSource("standard input", messages, live=True, notes=notes)


def _lines(stream: BinaryIO, idle_s: float, notes: list[str]) -> Iterator[bytes | None]:
    """Yields complete lines, and None while there is nothing to read."""
    number_of, rest = stream.fileno(), b""
    until_s = time.monotonic() + idle_s
    while True:
        if not select.select([number_of], [], [], MESSAGES.tick_s)[0]:
            if time.monotonic() > until_s:
                notes.append(f"standard input gave nothing for {idle_s:g} s")
                return
            yield None
            continue
        block = os.read(number_of, 1 << 20)
        until_s = time.monotonic() + idle_s
        *whole, rest = (rest + block).split(b"\n")
        yield from (line for line in whole if line.strip())
        if not block:
            if rest.strip():
                yield rest
            return
        if len(rest) > MESSAGES.longest_line:
            notes.append(
                f"standard input holds a line of over {MESSAGES.longest_line / 1e6:.0f} MB: what comes after it is lost"
            )
            return
