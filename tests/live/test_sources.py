"""Sources that fill while they are read: lines on standard input, a folder, readings by UDP."""

from __future__ import annotations

import base64
import hmac
import json
import os
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.streams import Reading, Taken, now_s
from vbaa_calib.streams.devices import _datagrams, udp_socket, with_datagrams
from vbaa_calib.streams.recorded import _open_folder, _open_lines

from ..small_scene import small_rig
from .recordings import frames


def lines_of(data: bytes, root: Path) -> tuple[list[Any], list[str]]:
    with tempfile.TemporaryFile() as stream:  # a pipe holds no picture
        stream.write(data)
        stream.seek(0)
        source = _open_lines(stream, 5.0, root)
        return [each for each in source.messages() if each is not None], source.notes


def test_lines_on_standard_input() -> None:
    """Paths and base64, readings in any line; rubbish between them is left out and told."""
    (first, *_), root = frames(), small_rig()
    assert first.image is not None
    packed = base64.b64encode(first.image.read_bytes()).decode()
    text = [
        json.dumps({"time_s": 1.0, "moment_Nm": 1e-3, "pan_rad": 0.1}),
        "rubbish",
        json.dumps({"time_s": 1.0, "image": str(first.image.relative_to(root))}),
        json.dumps({"time_s": "late"}),
        json.dumps([1]),
        json.dumps({"time_s": 1.1, "tilt_rad": 0.2, "image": packed}),
        json.dumps({"time_s": 1.2, "image": "bm8="}),
        json.dumps({"time_s": 1.2, "moment_Nm": True}),
    ]
    several, notes = lines_of("\n".join(text).encode(), root)
    assert [type(each) for each in several] == [Reading, Reading, Taken, Reading, Taken]
    np.testing.assert_array_equal(several[2].image, several[4].image)
    assert "rubbish" in notes[0]
    assert notes[1] == "5 lines were left out"


def test_a_stall_ends_in_a_sentence() -> None:
    end, begin = os.pipe()
    with os.fdopen(end, "rb") as stream:
        source = _open_lines(stream, 0.1)
        assert [each for each in source.messages() if each is not None] == []
    os.close(begin)
    assert source.notes == ["standard input gave nothing for 0.1 s"]


def test_a_folder_that_fills(tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()

    def fill() -> None:
        for number, frame in enumerate(frames()):
            assert frame.image is not None
            (folder / f"{number}.png").write_bytes(frame.image.read_bytes())
            time.sleep(0.15)

    thread = threading.Thread(target=fill)
    thread.start()
    source = _open_folder(folder, 1.5)
    several = [each for each in source.messages() if isinstance(each, Taken)]
    thread.join()
    assert len(several) == len(frames())
    assert np.diff([each.time_s for each in several]).min() > 0.0
    assert "gave nothing new" in source.notes[-1]


def listening_at() -> tuple[socket.socket, int]:
    """A socket and its port. Linux notes when datagrams come from a moment after a socket asked for it first."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    listening, notes = udp_socket(str(port)), list[str]()
    for _ in range(100 if sys.platform == "linux" else 0):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b'{"pan_rad": 0}', ("127.0.0.1", port))
        sent_s = now_s()
        time.sleep(0.02)
        first = next(_datagrams(listening, notes))
        if first is not None and first.time_s < sent_s + 0.01:
            break
    return listening, port


def test_readings_by_udp() -> None:
    listening, port = listening_at()
    begun_s = now_s()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in (b'{"time_s": 1.5, "moment_Nm": 0.25}', b"rubbish", b'{"pan_rad": 1}\n{"tilt_rad": 2}'):
            sender.sendto(data, ("127.0.0.1", port))
    sent_s = now_s()
    time.sleep(0.1)

    def nothing() -> Iterator[None]:
        yield None

    end, begin = os.pipe()
    os.close(begin)
    with os.fdopen(end, "rb") as stream:
        silent = replace(_open_lines(stream, 1.0), messages=nothing)
        source = with_datagrams(silent, listening)
        several = [each for each in source.messages() if isinstance(each, Reading)]
    values = {each.channel: each.value for each in several}
    assert values == {"moment_Nm": 0.25, "pan_rad": 1.0, "tilt_rad": 2.0}
    assert several[0].time_s == 1.5
    # timed by when they came, not by when they were asked for
    assert all(begun_s - 1e-3 < each.time_s < sent_s + 1e-3 for each in several[1:]) or sys.platform != "linux"
    assert source.notes[0] == "readings come from 127.0.0.1"
    assert "rubbish" in source.notes[1]


def sent_and_taken(several: list[bytes], key: bytes | None) -> tuple[list[float], list[str]]:
    """The values of datagrams that are taken, and what is reported."""
    listening, port = listening_at()
    notes = list[str]()
    with listening, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in several:
            sender.sendto(data, ("127.0.0.1", port))
        time.sleep(0.05)
        return [each.value for each in iter(partial(next, _datagrams(listening, notes, key)), None)], notes


def signed(key: bytes, number: int, line: bytes) -> bytes:
    """A datagram, as docs/live.md has it."""
    rest = b"%d %s" % (number, line)
    return hmac.new(key, rest, "sha256").hexdigest().encode() + b" " + rest


def test_readings_that_are_signed() -> None:
    """Those without the key, with another one's, changed on their way or sent once more are left out, and said."""
    key, lines = b"0123456789abcdef", [b'{"pan_rad": %d}' % number for number in range(6)]
    wrong = [lines[1], signed(b"fedcba9876543210", 2, lines[2]), signed(key, 3, lines[3]).replace(b"3}", b"2}")]
    valid = [signed(key, 7, lines[0]), *wrong, signed(key, 7, lines[4]), b"", b"  ", signed(key, 8, lines[5])]
    values, notes = sent_and_taken(valid, key)
    assert values == [0.0, 5.0]
    assert [note.partition(":")[0] for note in notes] == ["readings come from 127.0.0.1", "warning"]
    assert sent_and_taken(lines, None)[0] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
