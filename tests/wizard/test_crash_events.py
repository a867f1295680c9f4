"""What may happen to a wizard while it works: sources that go, Ctrl-C, a second wizard, files that others touch."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from vbaa_calib.sources.files import Picture, SourceLost, frame_picture
from vbaa_calib.wizard import flow
from vbaa_calib.wizard import flow as opening
from vbaa_calib.wizard.steps import PictureCheck
from vbaa_calib.wizard.store import Journal, Store

from .small_session import Tiny, call, expect_refused, finished, pictures, tiny, tree

__all__ = ["finished", "tiny"]


def on_picture(patch: pytest.MonkeyPatch, step: str, number: int, event: Callable[[], object]) -> None:
    """Something happens while the picture `number` of a step is checked."""
    seen = 0

    def check(state: Any, picture: Picture, readings: Any) -> PictureCheck:
        nonlocal seen
        seen += 1
        if seen == number:
            event()
        return PictureCheck("is bad" if picture.name.startswith("bad") else "")

    patch.setitem(flow.STEP_BY_NAME, step, replace(flow.STEP_BY_NAME[step], check=check))


def journal(tiny: Tiny) -> Journal:
    return Journal.read(tiny.session / "wizard.json")


def test_the_source_goes(tiny: Tiny, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.rmtree(tiny.session)
    folder = tiny.source / "intrinsics"
    on_picture(monkeypatch, "lens", 2, lambda: folder.rename(tiny.source / "gone"))
    code, said = call(tiny.session, "--answers", tiny.answers)
    assert code == 2
    assert said.strip().splitlines()[-1].startswith("vbaa: ")
    assert "no such folder" in said
    assert len(journal(tiny).of("lens").taken) == 2
    (tiny.source / "gone").rename(folder)
    assert call(tiny.session)[0] == 0
    assert len(journal(tiny).of("lens").taken) == 3


class Unplugged:
    """A camera that gives the same still picture for a while, then is gone."""

    live, ended, name, notes = True, False, "camera:0", ()

    def __init__(self, frames: int) -> None:
        self.left, self.frames = frames, frames
        self.pixels = np.random.default_rng(4).integers(0, 255, (60, 80), np.uint8)

    def next(self, timeout_s: float) -> Picture:
        if not self.left:
            raise SourceLost("is unplugged", where=self.name, remedy="plug it in and run the wizard again")
        self.left -= 1
        return frame_picture(f"frame {self.left}", self.pixels, 0.1 * (self.frames - self.left))

    def close(self) -> None:
        self.left = 0


def test_the_camera_is_unplugged(tiny: Tiny, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "open_source", lambda *_: Unplugged(80))
    found = replace(flow.STEP_BY_NAME["lens"], progress=lambda state: flow.STEP_BY_NAME["plane"].progress(state))
    monkeypatch.setitem(flow.STEP_BY_NAME, "lens", found)
    before = len(journal(tiny).of("lens").taken)
    outcome = call(tiny.session, "--reopen", "lens")
    expect_refused(tiny, outcome, "camera:0", "is unplugged", "plug it in")
    assert len(journal(tiny).of("lens").taken) >= before


def test_ctrl_c(tiny: Tiny, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit 130 with how to go on; what was taken stays."""
    shutil.rmtree(tiny.session)
    on_picture(monkeypatch, "noload", 2, lambda: signal.raise_signal(signal.SIGINT))
    # a shell that runs the tests in the background has the signal ignored
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        code, said = call(tiny.session, "--answers", tiny.answers)
    finally:
        signal.signal(signal.SIGINT, before)
    assert code == 130
    assert f"`vbaa wizard {tiny.session}` goes on here" in said
    assert len(journal(tiny).of("noload").taken) == 1
    assert call(tiny.session)[0] == 0


def test_two_at_once(tiny: Tiny) -> None:
    before = tree(tiny.session, "")
    with Store(tiny.session):
        expect_refused(tiny, call(tiny.session, "--redo", "lens"), "another wizard", "end that one first")
    assert tree(tiny.session, "") == before


def test_pictures_that_are_lost_or_changed(tiny: Tiny) -> None:
    """They are told, put aside where they are something else now, and taken again where the source has them."""
    (tiny.session / "intrinsics" / "0001.png").unlink()
    (tiny.session / "noload" / "0002.png").write_bytes(b"something else")
    code, said = call(tiny.session)
    assert code == 0
    assert "2 pictures are gone or have changed" in said
    assert "intrinsics/0001.png" in said
    assert sorted(one.source for one in journal(tiny).of("lens").taken) == ["1.png", "2.png", "3.png"]
    assert sorted(one.source for one in journal(tiny).of("noload").taken) == ["1.png", "2.png"]
    assert [path.read_bytes() for path in tiny.session.glob("aside/**/0002.png")] == [b"something else"]
    assert "something else" not in "".join(tree(tiny.session))


def test_strangers_that_come_meanwhile(tiny: Tiny, monkeypatch: pytest.MonkeyPatch) -> None:
    """The calibration reads whole folders: none comes in between the last picture and the verdict."""
    on_picture(monkeypatch, "loads", 1, lambda: (tiny.session / "intrinsics" / "late.png").write_bytes(b"late"))
    assert call(tiny.session, "--redo", "loads")[0] == 0
    assert "intrinsics/late.png" not in tree(tiny.session)


def test_a_session_is_gone_on_with_when_its_journal_is_moved_away(tiny: Tiny) -> None:
    (tiny.session / "wizard.json").write_text("")
    expect_refused(tiny, call(tiny.session), "move wizard.json away")
    (tiny.session / "wizard.json").unlink()
    code, said = call(tiny.session)
    assert code == 0, said
    assert len(pictures(tiny.session)) == 7
    assert not list(tiny.session.glob("aside/**/*.png"))
