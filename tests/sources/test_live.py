"""Cameras that hang, break and come back, streams from a server of our own, and what users may type instead."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vbaa_calib.core.errors import Disconnected, InputError
from vbaa_calib.sources import PictureSource, live
from vbaa_calib.sources.files import _without_secrets
from vbaa_calib.sources.live import _StreamSettings, open_camera, open_stream

QUICK = _StreamSettings(open_s=0.6, silence_s=0.4, failures=3)


class FakeCamera:
    """30 frames per second of rising grey; `plays` says what each frame does, the last one for ever."""

    def __init__(self, plays: list[str], opens: bool = True, autofocus: bool = True) -> None:
        self.plays, self.opens, self.autofocus = plays, opens, autofocus
        self.count, self.released = 0, False
        self.values: dict[int, float] = {cv2.CAP_PROP_FRAME_WIDTH: 64, cv2.CAP_PROP_FRAME_HEIGHT: 48}
        self.forever = threading.Event()

    def __call__(self, *_: object) -> FakeCamera:
        if self.plays == ["open hangs"]:
            self.forever.wait(5)
        return self

    def isOpened(self) -> bool:
        return self.opens

    def set(self, key: int, value: float) -> bool:
        if key == cv2.CAP_PROP_AUTOFOCUS and not self.autofocus:
            return False
        if key not in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT):
            self.values[key] = value
        return True

    def get(self, key: int) -> float:
        return self.values.get(key, 0.0)

    def grab(self) -> bool:
        time.sleep(1 / 30)
        self.play = self.plays[min(self.count, len(self.plays) - 1)]
        if self.play == "hang":
            self.forever.wait(5)
        if self.play == "raise":
            raise cv2.error("the driver is unhappy")
        self.count += self.play != "fail"
        return self.play != "fail"

    def retrieve(self) -> tuple[bool, np.ndarray | None]:
        if self.play == "empty":
            return True, None
        size = (96, 128) if self.play == "larger" else (48, 64)
        return True, np.full((*size, 3), self.count % 256, np.uint8)

    def release(self) -> None:
        self.released = True


@pytest.fixture
def plug(monkeypatch: pytest.MonkeyPatch):
    """Makes a fake camera the one that OpenCV opens."""
    plugged = []

    def plug(*args: object, **options: bool) -> FakeCamera:
        fake = FakeCamera(*args, **options)
        plugged.append(fake)
        monkeypatch.setattr(cv2, "VideoCapture", fake)
        monkeypatch.setattr(live, "_check_device", lambda *_: None)
        return fake

    yield plug
    for fake in plugged:
        fake.forever.set()


def use_up(source: PictureSource) -> None:
    for _ in range(400):
        source.next(0.1)


def test_the_newest_frame_is_given_and_old_ones_are_dropped(plug) -> None:
    fake = plug(["go"])
    source = open_camera(0, patience=QUICK)
    offered = [source.next(1.0)]
    for _ in range(3):
        time.sleep(0.15)
        before = fake.count
        offered.append(source.next(1.0))
        assert offered[-1].image[0, 0] > before - 2
    assert [each.name for each in offered] == ["frame 0", "frame 1", "frame 2", "frame 3"]
    times = [each.time_s for each in offered]
    assert times == sorted(times)
    source.close()
    source.close()
    assert fake.released


@pytest.mark.parametrize(("play", "words"), [("fail", "no more pictures"), ("hang", "does not answer"),
                                             ("raise", "no more pictures"), ("empty", "no more pictures")])  # fmt: skip
def test_an_unplugged_camera_is_told_soon(plug, play: str, words: str) -> None:
    fake = plug(["go"] * 5 + [play])
    source = open_camera(0, patience=QUICK)
    with pytest.raises(Disconnected, match=f"{words}; check cable and plug"):
        use_up(source)
    assert fake.released == (play != "hang")


@pytest.mark.parametrize(
    ("plays", "opens", "words"),
    [
        (["go"], False, "cannot be opened"),
        (["fail"], True, "gives no picture"),
        (["hang"], True, "does not answer"),
        (["open hangs"], True, "does not answer"),
    ],
)
def test_a_camera_that_does_not_start_is_refused(plug, plays: list[str], opens: bool, words: str) -> None:
    plug(plays, opens=opens)
    with pytest.raises(InputError, match=words) as raised:
        open_camera(0, patience=QUICK)
    assert raised.value.remedy
    assert not isinstance(raised.value, Disconnected)


PATIENT = _StreamSettings(open_s=2.0, silence_s=1.5, failures=1, retries_s=(0.05, 0.1))


class Camera(ThreadingHTTPServer):
    """An MJPEG camera that breaks off after `frames` of a connection, and answers at most `connections`."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.frames, self.connections, self.stalls, self.sent = 10**6, 10**6, False, 0
        self.url = f"http://anna:s3cr/et@127.0.0.1:{self.server_port}/video"

    def handle_error(self, *_: object) -> None:
        """The reader hung up."""


class _Handler(BaseHTTPRequestHandler):
    server: Camera

    def log_message(self, *_: object) -> None:
        """Silent."""

    def do_GET(self) -> None:
        self.server.connections -= 1
        if self.server.connections < 0:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        for _ in range(self.server.frames):
            self.server.sent += 1
            grey = np.full((120, 160, 3), 5 * self.server.sent % 256, np.uint8)
            data = cv2.imencode(".jpg", grey)[1].tobytes()
            self.wfile.write(b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data))
            self.wfile.write(data + b"\r\n")
            time.sleep(0.02)
        while self.server.stalls:
            time.sleep(0.05)


@pytest.fixture
def server() -> Iterator[Camera]:
    server = Camera()
    server.url = server.url.replace("s3cr/et", "s3cret")
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server
    server.stalls = False
    server.frames = 0
    server.shutdown()
    server.server_close()


def test_a_stream_gives_frames_and_never_shows_its_password(server: Camera) -> None:
    source = open_stream(server.url, patience=PATIENT)
    found = [source.next(1.0) for _ in range(5)]
    source.close()
    assert [each.name for each in found] == [f"frame {index}" for index in range(5)]
    assert found[0].image.shape == (120, 160)
    assert source.live
    assert not source.ended
    assert source.name == f"http://***@127.0.0.1:{server.server_port}/video"


def test_a_stream_that_breaks_off_is_reached_again_then_lost(server: Camera, capfd: pytest.CaptureFixture[str]) -> None:
    server.frames, server.connections = 12, 3
    source = open_stream(server.url, patience=PATIENT)
    with pytest.raises(Disconnected, match="broke off and cannot be reached again") as raised:
        use_up(source)
    assert "s3cret" not in str(raised.value)
    assert len(source.notes) == 3  # the last one for good
    assert "s3cret" not in "".join(source.notes)
    assert capfd.readouterr() == ("", "")


@settings(max_examples=40, deadline=None)
@given(st.text(max_size=20), st.text(max_size=20))
def test_no_password_is_ever_shown(user: str, password: str) -> None:
    secret = f"<{password}>"
    assert secret not in _without_secrets(f"rtsp://{user}:{secret}@host/path")
