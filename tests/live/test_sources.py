"""Sources that fill while they are read, cameras that break off, bags and videos where folders of pictures were."""

from __future__ import annotations

import base64
import hmac
import json
import socket
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.table.files import read_contacts
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from vbaa_calib.streams import Reading, Taken, now_s
from vbaa_calib.streams.bags import BagWriter, Logged
from vbaa_calib.streams.devices import _datagrams, udp_socket
from vbaa_calib.streams.pictures import BagPictures, thinned
from vbaa_calib.streams.recorded import _open_lines
from viz.batch.recordings import BatchRecording
from viz.batch.results import Results
from viz.batch.work import BatchSettings, do

from ..small_scene import small_rig
from .recordings import frames, write


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


def picture() -> np.ndarray:
    return cv2.imread(str(frames()[0].image))


COUNT = 20
"""Pictures in a bag."""

PNG = "sensor_msgs/msg/CompressedImage"


def pattern(number: int, blur: float = 0.0) -> np.ndarray:
    """One of several pictures with detail."""
    rng = np.random.default_rng(number)
    coarse = cv2.resize(rng.uniform(0, 255, (9, 12)).astype(np.uint8), (240, 180), interpolation=cv2.INTER_NEAREST)
    return coarse if blur == 0.0 else np.asarray(cv2.GaussianBlur(coarse, (0, 0), blur))


def test_the_sharp_one_of_each_view_is_kept() -> None:
    shown = [(view, blur) for view in range(6) for blur in (3.0, 0.0, 2.0, 4.0)]
    kept = thinned(((each, pattern(*each)) for each in shown), 24)
    assert [each for each, _ in kept] == [(view, 0.0) for view in range(6)]


def as_bag(path: Path, pictures: list[np.ndarray], topics: tuple[str, ...] = ("/image",)) -> Path:
    writer = BagWriter(path)
    for number, picture in enumerate(pictures):
        data = np.frombuffer(cv2.imencode(".png", picture)[1].tobytes(), np.uint8)
        for topic in topics:
            writer.write(Logged(topic, PNG, {"format": "png", "data": data}, 10**9 + number * 10**8))
    writer.close()
    return path


def test_the_wizard_takes_a_bag(tmp_path: Path) -> None:
    several = [pattern(n) for n in range(4)]
    source = BagPictures(str(as_bag(tmp_path / "a.mcap", several)))
    found = [source.next(0.0) for _ in range(4)]
    assert [each.name for each in found if each] == [f"frame {n}" for n in range(4)]
    assert [each.time_s for each in found if each] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    np.testing.assert_array_equal(found[2].image, several[2])  # type: ignore[union-attr]
    assert source.next(0.0) is None
    assert source.ended
    source.close()
    two = as_bag(tmp_path / "two.mcap", several, ("/left", "/right"))
    with pytest.raises(InputError, match="#TOPIC"):
        BagPictures(str(two))
    assert BagPictures(f"{two}#/right").next(0.0) is not None


def test_a_batch_takes_a_bag(tmp_path: Path) -> None:
    """Its rows are those of `vbaa estimate`; and it is not done again until it changes."""
    bag, rig, out = write(tmp_path / "demo.mcap", count=COUNT), small_rig() / "rig.json", tmp_path / "one.csv"
    assert main(["estimate", str(bag), "--rig", str(rig), "-o", str(out), "--no-report"]) == 0
    results = Results(tmp_path / "results")
    results.prepare(["vbaa", "batch"])
    recording = BatchRecording("demo", bag, rig)
    outcome = do(recording, BatchSettings(background=Path("auto")), results)
    assert (outcome.state, outcome.row["frames"]) == ("done", COUNT)
    one, other = read_contacts(out), read_contacts(results.contacts("demo"))
    assert one.status.tolist() == other.status.tolist()
    np.testing.assert_allclose(other.distance_m, one.distance_m, rtol=1e-8)
    assert do(recording, BatchSettings(background=Path("auto")), results).state == "unchanged"
    bag.write_bytes(bag.read_bytes()[:-200])
    assert do(recording, BatchSettings(background=Path("auto")), results).state == "failed"
