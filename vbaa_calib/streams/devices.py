"""Cameras and streams from the net, and readings that come by UDP while they run."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter

from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.sources.files import SourceLost
from vbaa_calib.wizard.sources.live import LiveSource

from .messages import Messages, Reading, Source, Taken, now_s
from .recorded import TICK_S, line_messages

_LARGEST_DATAGRAM = 65536


def udp_address(address: str, flag: str) -> tuple[str, int]:
    """Host and port of HOST:PORT, or of PORT at this machine. Raises InputError."""
    host, _, port = address.rpartition(":")
    if not (port.isdecimal() and 0 < int(port) < 65536):
        raise InputError(f"{address!r} is no address", where=flag, remedy="write it like 5005 or 0.0.0.0:5005")
    return host or "127.0.0.1", int(port)


def udp_socket(address: str) -> socket.socket:
    """A socket that takes datagrams at HOST:PORT or PORT (of this machine alone). Raises InputError."""
    place = udp_address(address, "--udp")
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    taken.setblocking(False)
    try:
        taken.bind(place)
    except OSError as error:
        taken.close()
        what = f"{address} cannot be listened to ({error.strerror})"
        raise InputError(what, where="--udp", remedy="take another port, or an address of this machine") from None
    return taken


def datagrams(listening: socket.socket, notes: list[str]) -> Iterator[Reading]:
    """The readings that have come since: a JSON line each, or several lines in one datagram."""
    while True:
        try:
            data = listening.recv(_LARGEST_DATAGRAM)
        except (BlockingIOError, InterruptedError):
            return
        for line in filter(None, data.splitlines()):
            try:
                yield from (each for each in line_messages(line, None) if isinstance(each, Reading))
            except InputError as error:
                if not any(note.startswith("a datagram") for note in notes):
                    notes.append(f"a datagram is left out: {error}")


def with_datagrams(source: Source, listening: socket.socket | None) -> Source:
    """A source that runs, with the readings that come by UDP meanwhile."""
    if listening is None:
        return source

    def messages(skim: bool = False) -> Messages:
        with listening:
            for message in source.messages():
                # those of the picture's own instant are here by now
                yield from datagrams(listening, source.notes)
                yield message

    return replace(source, messages=messages)


def open_device(camera: LiveSource) -> Source:
    """The newest pictures of a camera that runs, timed by this machine's clock when they were there."""
    notes: list[str] = []
    camera.eager = True
    start_s = now_s() - time.monotonic() + camera.start_s
    begin_s = perf_counter() - time.monotonic() + camera.start_s

    def messages(skim: bool = False) -> Messages:
        try:
            while True:
                picture = camera.next(TICK_S / 10)
                if picture is None:
                    yield None
                    continue
                assert picture.time_s is not None
                time_s = start_s + picture.time_s
                yield Taken(time_s, picture.content, time_s, begin_s + picture.time_s)  # type: ignore[arg-type]
        except SourceLost as error:
            notes.append(str(error))
        finally:
            notes.extend(camera.notes)
            camera.close()

    return Source(camera.name, messages, live=True, dropped=lambda: camera.dropped, notes=notes)
