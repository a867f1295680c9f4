"""What may happen to a wizard: sources that go, Ctrl-C, kills, a second wizard, files that others touch."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vbaa_calib.sources.files import Picture
from vbaa_calib.wizard import flow
from vbaa_calib.wizard.steps import PictureCheck
from vbaa_calib.wizard.store import Store, _Journal

from .small_session import (
    Tiny,
    answers,
    answers_file,
    call,
    expect_refused,
    finished,
    pictures,
    rendered,
    tiny,
    tiny_source,
    tree,
)

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


def journal(tiny: Tiny) -> _Journal:
    return _Journal.read(tiny.session / "wizard.json")


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


def test_a_session_is_gone_on_with_when_its_journal_is_moved_away(tiny: Tiny) -> None:
    (tiny.session / "wizard.json").write_text("")
    expect_refused(tiny, call(tiny.session), "move wizard.json away")
    (tiny.session / "wizard.json").unlink()
    code, said = call(tiny.session)
    assert code == 0, said
    assert len(pictures(tiny.session)) == 7
    assert not list(tiny.session.glob("aside/**/*.png"))


ROOT = Path(__file__).parents[2]


def killed(folder: Path, seeing: bool, **plans: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """What the killer found of each plan."""
    (folder / "plan.json").write_text(json.dumps({"seeing": seeing, **plans}))
    command = [sys.executable, "-m", "tests.wizard.killer", str(folder / "plan.json")]
    subprocess.run(command, cwd=ROOT, check=True, env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True)
    found: dict[str, dict[str, Any]] = json.loads((folder / "plan.found.json").read_text())
    return found


@pytest.fixture(scope="module", params=[3, pytest.param(100, marks=pytest.mark.slow)])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where sessions of tiny pictures, which no step looks at, were killed so often."""
    folder = tmp_path_factory.mktemp("killed")
    given = answers(tiny_source(folder / "source"))
    first = ["--answers", str(answers_file(folder / "first.yaml", given))]
    sweep = ["--answers", str(answers_file(folder / "sweep.yaml", given | {"plane_way": "sweep"}))]
    often: dict[str, Any] = {"kills": request.param, "seed": 8}
    killed(
        folder,
        False,
        first=often | {"argv": first},
        redo=often | {"before": first, "argv": [*first, "--redo", "lens"], "again": first},
        way=often | {"before": first, "argv": sweep},
        given=often | {"before": first, "by_hand": True, "argv": []},
    )
    return folder


@pytest.mark.parametrize("name", ["first", "redo", "way", "given"])
def test_nothing_is_lost(name: str, folder: Path) -> None:
    """A redo is not asked for again: what was gone is taken anew, what was not gone is as it was."""
    found = json.loads((folder / "plan.found.json").read_text())[name]
    assert found["promises"] > 0 or name != "first"
    assert found["broken"] == []
    assert set(found["differing"]) <= ({"wizard.json"} if name == "redo" else set())


def test_a_session_that_was_made_by_hand_stays(folder: Path) -> None:
    """Its pictures are there, and what the wizard writes anew is kept as it was."""
    assert len(list((folder / "given").glob("[!a]*/*.png"))) == 7
    kept = folder / "given" / "aside" / "given"
    assert (kept / "noload.csv").read_text().startswith("remark,")
    assert (kept / "session.yaml").exists()


@pytest.mark.slow
def test_with_eyes(tmp_path: Path) -> None:
    """Rendered pictures, real judgement, real verdict: rig.json is the same to the last bit."""
    file = answers_file(tmp_path / "a.yaml", answers(rendered()))
    plan = {"argv": ["--answers", str(file)], "kills": 40, "seed": 12}
    found = killed(tmp_path, True, rig=plan)["rig"]
    assert found["promises"] > 0
    assert found["broken"] == found["differing"] == []


IMAGE = np.zeros((2, 3), np.uint8)


def picture(name: str, content: bytes | None = None, suffix: str = ".png") -> Picture:
    return Picture(name, IMAGE, suffix, name.encode() if content is None else content)
