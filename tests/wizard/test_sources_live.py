"""Cameras that hang, break and come back: played by a capture that does as it is told."""

from __future__ import annotations

import threading
import time

import cv2
import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.sources import Source, SourceLost, live
from vbaa_calib.wizard.sources.live import CameraSettings, Patience, open_camera, parse_camera

QUICK = Patience(open_s=0.6, silence_s=0.4, failures=3)


class FakeCamera:
    """30 frames per second of rising grey; `plays` says what each frame does, the last one for ever."""

    made: list[FakeCamera]

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


def use_up(source: Source) -> None:
    for _ in range(200):
        source.next(0.1)


def test_the_newest_frame_is_given_and_old_ones_are_dropped(plug) -> None:
    fake = plug(["go"])
    source = open_camera(CameraSettings(0), patience=QUICK)
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
    source = open_camera(CameraSettings(0), patience=QUICK)
    with pytest.raises(SourceLost, match=f"{words}; check cable and plug"):
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
        open_camera(CameraSettings(0), patience=QUICK)
    assert raised.value.remedy
    assert not isinstance(raised.value, SourceLost)


@pytest.mark.parametrize(
    "text",
    ["x", "", "-1", "0 ", "٣", "12345", "0?width=0", "0?width=-5", "0?width=1e3", "0?width=", "0?colour=blue",
     "0?fourcc=MJ", "0?fourcc=MJPÉ", "0?height=99999", "0?width", "video0", "0;rm -rf", "?width=10"],
)  # fmt: skip
def test_a_camera_that_is_not_one_is_refused(text: str) -> None:
    with pytest.raises(InputError) as raised:
        parse_camera(text)
    assert raised.value.remedy
