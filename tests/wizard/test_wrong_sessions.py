"""Wrong answers, sources and session folders: exit 2, one line that says what to do, and no picture is lost."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from typing import Any

import pytest

from .small_session import call
from .tiny_wizard import Tiny, expect_refused, finished, pictures, tiny

__all__ = ["finished", "tiny"]

ANSWERS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "readings in cm": (("--board-along-x-mm=16.51", "--board-along-y-mm=12"), ("x_mm is 16.51", "centimetres")),
    "readings in inches": (("--board-along-x-mm=6.5", "--board-along-y-mm=4.7244"), ("board_along_x_mm", "inch")),
    "readings exchanged": (("--board-along-x-mm=120", "--board-along-y-mm=165"), ("board_along_x_mm", "exchange")),
    "stretched one way": (("--board-along-x-mm=165", "--board-along-y-mm=118"), ("board_along_x_mm", "%")),
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
    "missing": (lambda tiny: str(tiny.source / "none"), ("none", "no such folder or video")),
    "in the session": (inside, ("lies inside the session", "another folder")),
    "the session": (lambda tiny: str(tiny.session), ("lies inside the session", "another folder")),
    "no camera": (lambda tiny: "camera:97", ("camera",)),
}


@pytest.mark.parametrize("name", SOURCES)
def test_a_source(name: str, tiny: Tiny) -> None:
    source, words = SOURCES[name]
    expect_refused(tiny, call(tiny.session, "--reopen", "lens", "--lens-source", source(tiny)), *words)


def changed(change: Callable[[dict[str, Any]], object]) -> Callable[[str], str]:
    """wizard.json with something changed in it."""

    def damage(text: str) -> str:
        data = json.loads(text)
        change(data)
        return json.dumps(data)

    return damage


def first(step: str, **entries: object) -> Callable[[str], str]:
    """wizard.json with these entries in the first picture of a step."""
    return changed(lambda data: data["steps"][step]["taken"][0].update(entries))


def reading(name: str, value: object) -> Callable[[str], str]:
    """wizard.json with a reading of the first picture of the free antenna set."""
    return changed(lambda data: data["steps"]["noload"]["taken"][0]["readings"].update({name: value}))


def answer(key: str, value: object) -> Callable[[str], str]:
    """wizard.json with an answer set."""
    return changed(lambda data: data["answers"].update({key: value}))


JOURNALS: dict[str, tuple[Callable[[str], str], str]] = {
    "number": (lambda text: "3", "must be a JSON object"),
    "key twice": (lambda text: text.replace('"schema"', '"schema": "", "schema"'), "'schema' stands twice"),
    "no schema": (changed(lambda data: data.pop("schema")), "vbaa.wizard/1 is needed"),
    "taken is a number": (changed(lambda data: data["steps"]["lens"].update(taken=3)), "damaged"),
    "elsewhere": (first("lens", file="/etc/passwd"), "no file of this session"),
    "zero byte": (first("lens", file="a\0b"), "no file of this session"),
    "reading is NaN": (reading("pan_rad", float("nan")), "noload.taken.0.readings.pan_rad: "),
    "no readings": (first("noload", readings={}), "has no pan_rad"),
    "no force": (first("loads", readings={"pan_rad": 0, "tilt_rad": 0, "moment_Nm": 0}), "has no distance_m"),
    "answer is null": (answer("board", None), "board is empty"),
    "choice that is none": (answer("plane_way", "by eye"), "by eye"),
    "scale is a list": (answer("measure_x_mm", [165.0]), "is not a number"),
}


@pytest.mark.parametrize("name", JOURNALS)
def test_a_damaged_journal(name: str, tiny: Tiny) -> None:
    damage, words = JOURNALS[name]
    file = tiny.session / "wizard.json"
    file.write_text(damage(file.read_text()))
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


FOLDERS: dict[str, tuple[Callable[[Tiny], object], str]] = {
    "a file": (lambda tiny: tiny.answers, "File exists"),
    "in a file": (lambda tiny: tiny.answers / "s", "Not a directory"),
    "too long": (lambda tiny: tiny.source / ("s" * 300), "File name too long"),
    "zero byte": (lambda tiny: "a\0b", "null byte"),
    "where nothing can be": (lambda tiny: "/proc/session", "cannot be made"),
}


@pytest.mark.parametrize("name", FOLDERS)
def test_a_session_folder(name: str, tiny: Tiny) -> None:
    folder, words = FOLDERS[name]
    expect_refused(tiny, call(folder(tiny), "--answers", tiny.answers), words, "name another folder")


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


def test_nothing_given(tiny: Tiny) -> None:
    """The first question without an answer is named with both ways to answer it."""
    shutil.rmtree(tiny.session)
    words = ("board_along_x_mm is not answered", "--board-along-x-mm", "--answers FILE")
    expect_refused(tiny, call(tiny.session.with_name("new")), *words)
