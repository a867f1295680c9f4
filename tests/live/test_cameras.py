"""Live from a camera that breaks off, comes back with another size, sends rubbish, or is gone: it goes on, or ends in a
sentence with whole files. Nothing here depends on how fast it goes: the cameras wait for what they are to see."""

from __future__ import annotations

import json
import os
import signal
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.table.files import read_contacts
from vbaa_calib.cli.main import main
from vbaa_calib.core import console
from vbaa_calib.sources import live
from vbaa_calib.sources.live import LiveSource, StreamSettings
from vbaa_calib.streams import devices

from ..small_scene import small_rig
from .recordings import frames

BROKE_OFF = "broke off; it is opened again"


def picture() -> np.ndarray:
    return cv2.imread(str(frames()[0].image))


class Stage:
    """What camera and program wait for in each other. began : pictures count. said : what was told so far."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.began, self.broke_off, self.said = threading.Event(), threading.Event(), list[str]()
        forget, say = LiveSource.forget, console.say

        def begin(source: LiveSource) -> None:
            forget(source)
            self.began.set()

        def note(text: str) -> None:
            self.said.append(text)
            if BROKE_OFF in text:
                self.broke_off.set()
            say(text)

        monkeypatch.setattr(LiveSource, "forget", begin)
        monkeypatch.setattr(console, "say", note)
        monkeypatch.setattr(devices, "DEVICES", replace(devices.DEVICES, retries_s=(0.02,) * 5))
        monkeypatch.setattr(live, "_check_device", lambda *_: None)
        # a camera that waits for the program is not one that hangs
        monkeypatch.setattr(live, "StreamSettings", lambda: StreamSettings(open_s=300.0, silence_s=300.0, failures=6))


class Scripted:
    """In the place of `cv2.VideoCapture`: each opening has its pictures, after which it breaks off; None cannot be
    opened, and what can be called is called at the opening. After the last opening there is none."""

    def __init__(self, stage: Stage, openings: list[list[Any] | Callable[[], None] | None]) -> None:
        self.stage, self.openings, self.opened, self.given = stage, openings, 0, 0
        self.left: list[Any] | None = None

    def __call__(self, *_: object) -> Scripted:
        number, self.opened = self.opened, self.opened + 1
        now = self.openings[number] if number < len(self.openings) else None
        self.left = None if now is None or callable(now) else list(now)
        if callable(now):
            now()
        return self

    def isOpened(self) -> bool:
        return self.left is not None

    def grab(self) -> bool:
        if self.opened > 1 or self.given:
            assert self.stage.began.wait(60.0)
        return bool(self.left)

    def retrieve(self) -> tuple[bool, Any]:
        assert self.left is not None
        self.given += 1
        return True, self.left.pop(0)

    def get(self, key: int) -> float:
        return 0.0

    def set(self, key: int, value: float) -> bool:
        return False

    def release(self) -> None:
        pass


def run(source: str, out: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """The summary; every answered picture is in the table."""
    words = ("live", small_rig() / "rig.json", source, "-o", out, "--json", "--no-moment", "--pan", "0", "--tilt", "0")
    assert main([str(word) for word in words]) == 0
    summary: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert len(read_contacts(out)) == summary["frames"] > 0
    assert [path.name for path in out.parent.iterdir()] == [out.name]
    return summary


@pytest.mark.parametrize("back", ["whole", "larger", "rubbish"])
def test_a_camera_that_breaks_off_and_comes_back(
    back: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It goes on with what can be used, says that it broke off, and counts that it came back."""
    stage = Stage(monkeypatch)
    good, larger = picture(), np.zeros((480, 640, 3), np.uint8)
    rubbish: list[Any] = [None, np.zeros(7, np.uint8), np.zeros((4, 4, 2), np.uint8), np.zeros((9, 9), np.float64)]
    second = {"whole": [good] * 4, "larger": [larger] * 3 + [good] * 2, "rubbish": [*rubbish, *[good] * 2]}[back]
    fake = Scripted(stage, [[good] * 5, lambda: stage.broke_off.wait(60.0), second])
    monkeypatch.setattr(cv2, "VideoCapture", fake)
    summary = run("camera:0", tmp_path / "contacts.csv", capsys)
    assert summary["reconnected"] == 1
    # a second time only when it breaks off for good
    assert sum(BROKE_OFF in text for text in stage.said) in (1, 2)
    assert any("no more pictures" in note for note in summary["notes"])  # gone for good, in the end
    assert fake.opened == 3 + len(devices.DEVICES.retries_s)
    other = summary["stream"].get("pictures of another size", 0)
    # the first was given when it was opened, and not counted
    usable = 4 + len(second) - (len(rubbish) if back == "rubbish" else 0)
    assert summary["frames"] + summary["dropped"] + other == usable
    assert (other > 0) == any("of another size" in text for text in stage.said)


def test_an_interrupt_while_a_camera_is_away(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stage = Stage(monkeypatch)
    monkeypatch.setattr(devices, "DEVICES", replace(devices.DEVICES, retries_s=(0.02, 3600.0)))

    def interrupted() -> None:
        assert stage.broke_off.wait(60.0)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(cv2, "VideoCapture", Scripted(stage, [[picture()] * 4, interrupted]))
    assert "interrupted" in run("camera:0", tmp_path / "contacts.csv", capsys)["notes"]
