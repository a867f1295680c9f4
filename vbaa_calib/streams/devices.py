"""Live cameras and network streams, with readings that arrive by UDP."""

from __future__ import annotations

import hmac
import socket
import struct
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter

from vbaa_calib.core.errors import Disconnected, InputError, clipped
from vbaa_calib.sources.live import LiveSource

from .messages import MESSAGES, Messages, MessageSource, Reading, Taken, line_messages, now_s

_TIMESTAMP = 35 if sys.platform == "linux" else None
"""SO_TIMESTAMPNS: the system notes when a datagram came, which is before it is asked for. Not named by `socket`."""
_TIMESPEC = struct.Struct("@qq")


def udp_address(address: str, flag: str) -> tuple[str, int]:
    """Host and port of HOST:PORT, or of PORT on this machine. Raises InputError."""
    host, _, port = address.rpartition(":")
    if not (port.isdecimal() and 0 < int(port) < 65536):
        raise InputError(f"{address!r} is no address", where=flag, remedy="write it like 5005 or 0.0.0.0:5005")
    return host or "127.0.0.1", int(port)


def udp_socket(address: str) -> socket.socket:
    """A socket that receives datagrams at HOST:PORT, or at PORT from this machine alone. Raises InputError."""
    place = udp_address(address, "--udp")
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    taken.setblocking(False)
    if _TIMESTAMP is not None:
        taken.setsockopt(socket.SOL_SOCKET, _TIMESTAMP, 1)
    try:
        taken.bind(place)
    except OSError as error:
        taken.close()
        what = f"{address} cannot be listened to ({error.strerror})"
        raise InputError(what, where="--udp", remedy="take another port, or an address of this machine") from None
    return taken


def _datagrams(listening: socket.socket, notes: list[str], key: bytes | None = None) -> Iterator[Reading | None]:
    """Yields the readings that have arrived, in JSON lines, one or more a datagram; None when there is none at
    present.

    key : datagrams without its HMAC, or with a number that is not larger than the one before, are left out.
    notes : receives a message for each of the first senders of datagrams that are left out, with an example.
    """
    number, noted = -1, set[tuple[str, bool]]()

    def note(sender: str, taken: bool, words: str) -> None:
        if len(noted) < MESSAGES.most_notes and (sender, taken) not in noted:
            noted.add((sender, taken))
            notes.append(words)

    while True:
        # a flood of them delays pictures, but does not stop them
        for _ in range(1000):
            try:
                data, ancillary, _, place = listening.recvmsg(65536, socket.CMSG_SPACE(_TIMESPEC.size))
            except (BlockingIOError, InterruptedError):
                break
            arrived_s, sender = _arrived_s(ancillary), "?" if place is None else place[0]
            try:
                if key is not None:
                    number, data = _signed(data, key, number)
                lines = filter(None, data.splitlines())
                several = [each for line in lines for each in line_messages(line, None, arrived_s)]
            except InputError as error:
                note(sender, False, f"warning: a datagram of {sender} is left out: {error}")
                continue
            note(sender, True, f"readings come from {sender}")
            yield from (each for each in several if isinstance(each, Reading))
        yield None


def _signed(data: bytes, key: bytes, before: int) -> tuple[int, bytes]:
    """Number and lines of a datagram `HMAC number lines`. Raises InputError for another key's, and for a repeated or
    old one."""
    code, _, rest = data.partition(b" ")
    number, _, lines = rest.partition(b" ")
    remedy = "send `HMAC number lines`: SHA-256's HMAC in hexadecimal, of all that follows the first space"
    if not hmac.compare_digest(hmac.new(key, rest, "sha256").hexdigest().encode(), code):
        raise InputError("is not signed with the key of --udp-key", remedy=remedy)
    if not (number.isdigit() and len(number) <= 20 and int(number) > before):
        what = f"its number is {clipped(repr(number))} after {before}"
        raise InputError(what, remedy="number datagrams upwards, as by time.time_ns()")
    return int(number), lines


def _arrived_s(ancillary: list[tuple[int, int, bytes]]) -> float:
    """Arrival time of a datagram by `now_s`: the system's stamp, or the present time where it has none or its clock
    was changed."""
    latest_s = now_s()
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _TIMESTAMP) and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            # from the system's clock, which is slewed; a pause between the two readings would make the difference less
            arrived_s = seconds + 1e-9 * nanoseconds + max(now_s() - time.time() for _ in range(5))
            return arrived_s if latest_s - MESSAGES.longest_wait_s < arrived_s <= latest_s else latest_s
    return latest_s


def with_datagrams(source: MessageSource, listening: socket.socket | None, key: bytes | None = None) -> MessageSource:
    """A live source together with the readings that arrive by UDP; with a key, only those signed with it."""
    if listening is None:
        return source

    def messages() -> Messages:
        with listening:
            received = _datagrams(listening, source.notes, key)
            for message in source.messages():
                # those of the picture's own instant are here by now
                yield from iter(lambda: next(received), None)
                yield message

    return replace(source, messages=messages)


def open_device(camera: LiveSource) -> MessageSource:
    """The latest pictures of a running camera, with arrival times by this machine's clock."""
    notes: list[str] = []
    camera.queued, camera.retries_s = MESSAGES.queued, MESSAGES.retries_s
    start_s = now_s() - time.monotonic() + camera.start_s
    begin_s = perf_counter() - time.monotonic() + camera.start_s

    def messages() -> Messages:
        camera.forget()
        reported = 0
        try:
            while True:
                frame = camera.frame(MESSAGES.tick_s / 10)
                news = camera.notes[reported:]
                notes.extend(news)
                reported += len(news)
                if frame is None:
                    yield None
                    continue
                pixels, taken_s = frame
                at_s = start_s + taken_s
                yield Taken(at_s, pixels, now_s(), begin_s + taken_s, waiting=camera.waiting)
        except Disconnected as error:
            notes.append(str(error))
        finally:
            notes.extend(camera.notes[reported:])
            if camera.reopened:
                notes.append(f"{camera.name} broke off and was reached again, {camera.reopened} times in all")
            camera.close()

    return MessageSource(
        camera.name, messages, live=True, dropped=lambda: camera.dropped, reopened=lambda: camera.reopened, notes=notes
    )
