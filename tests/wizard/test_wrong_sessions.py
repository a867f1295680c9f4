"""Wrong answers, sources and session folders: exit 2, one line that says what to do, and no picture is lost."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from ..hostile import damage as d
from ..hostile.case import Damage
from .small_session import Tiny, call, expect_refused, finished, pictures, tiny

__all__ = ["finished", "tiny"]

ANSWERS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "readings in cm": (("--board-along-x-mm=16.51", "--board-along-y-mm=12"), ("x_mm is 16.51", "centimetres")),
    "axes parallel": (("--jig-board-x=y",), ("jig_board_x, jig_board_y", "right angles")),
    "board is a folder": (("--board=/tmp",), ("/tmp", "is a folder")),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_answers_that_do_not_go_together(name: str, tiny: Tiny) -> None:
    argv, words = ANSWERS[name]
    before = (tiny.session / "wizard.json").read_bytes()
    expect_refused(tiny, call(tiny.session, *argv), *words)
    assert (tiny.session / "wizard.json").read_bytes() == before


def inside(tiny: Tiny) -> str:
    return str(tiny.session / "intrinsics")


SOURCES: dict[str, tuple[Callable[[Tiny], str], tuple[str, ...]]] = {
    "in the session": (inside, ("lies inside the session", "another folder")),
    "no camera": (lambda tiny: "camera:97", ("camera",)),
}


@pytest.mark.parametrize("name", SOURCES)
def test_a_source(name: str, tiny: Tiny) -> None:
    source, words = SOURCES[name]
    expect_refused(tiny, call(tiny.session, "--reopen", "lens", "--lens-source", source(tiny)), *words)


TAKEN = {"pan_rad": 0, "tilt_rad": 0, "moment_Nm": 0}
JOURNALS: dict[str, tuple[Damage, str]] = {
    "a zero byte": (d.at("steps.lens.taken.0.file", "a\0b"), "no file of this session"),
    "reading is NaN": (d.at("steps.noload.taken.0.readings.pan_rad", math.nan), "noload.taken.0.readings.pan_rad: "),
    "no readings": (d.at("steps.noload.taken.0.readings", {}), "has no pan_rad"),
    "no force": (d.at("steps.loads.taken.0.readings", TAKEN), "has no distance_m"),
    "answer is null": (d.at("answers.board", None), "board is empty"),
    "scale is a list": (d.at("answers.measure_x_mm", [165.0]), "is not a number"),
}


@pytest.mark.parametrize("name", JOURNALS)
def test_a_damaged_journal(name: str, tiny: Tiny) -> None:
    damage, words = JOURNALS[name]
    file = tiny.session / "wizard.json"
    damage(file)
    before = file.read_bytes()
    expect_refused(tiny, call(tiny.session), "wizard.json", words)
    assert file.read_bytes() == before


def test_what_a_damaged_journal_says_helps(tiny: Tiny) -> None:
    """wizard.json moved away, the wizard goes on with session.yaml and the pictures that are there."""
    (tiny.session / "wizard.json").write_text("")
    expect_refused(tiny, call(tiny.session), "move wizard.json away")
    (tiny.session / "wizard.json").unlink()
    code, said = call(tiny.session)
    assert code == 0, said
    assert len(pictures(tiny.session)) == 7
    assert not list(tiny.session.glob("aside/**/*.png"))


FILES: dict[str, tuple[str, str | None, str]] = {
    "session.yaml cut off": ("session.yaml", "board: {", "session.yaml"),
    "board.yaml gone": ("board.yaml", None, "board.yaml"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_the_session(name: str, tiny: Tiny) -> None:
    file, content, words = FILES[name]
    if content is None:
        (tiny.session / file).unlink()
    else:
        (tiny.session / file).write_text(content)
    expect_refused(tiny, call(tiny.session), words)
