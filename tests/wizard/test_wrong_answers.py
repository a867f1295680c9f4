"""Every answer that cannot be: exit 2 and one line with the place and what is expected, before anything is made."""

from __future__ import annotations

import datetime
from pathlib import Path

import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.wizard.state.catalogue import QUESTIONS, SOURCES, TABLES
from vbaa_calib.wizard.state.questions import Question

from .small_session import answers_file, call

EVERY = (*QUESTIONS, *SOURCES, *TABLES)
TYPED = {
    "number": [
        "240mm",
        "24 cm",
        "0,8",
        "nan",
        "inf",
        "-inf",
        "",
        " ",
        "ten",
        "1e400",
        "٢٤",
        "1_0",
        "0x10",
        "1e7",
        "-1e7",
    ],
    "numbers": ["a,b,c", "1,2,x", "", ",", "1e400,1,1", "nan,1,1", "1,2,3mm"],
    "choice": ("purple", "", "-"),
    "text": ("", "  "),
}
WRITTEN: dict[str, tuple[object, ...]] = {
    "number": (None, True, [], [1.0], {"value": 1}, float("nan"), 10**400, "240 mm", datetime.date(2026, 1, 1)),
    "numbers": (None, True, [], {"x": 1}, [1, 2, "x"], [[1], 2, 3], [1, 2, None], [float("inf"), 1, 1]),
    "choice": (None, True, 3, ["x"], {"x": 1}),
    "text": (None, 3, True, {"path": "x"}, "x" * 5000, datetime.date(2026, 1, 1)),
}


def expect_line(outcome: tuple[int, str], *words: str) -> None:
    """Exit 2; one line, which holds these words and a remedy."""
    code, said = outcome
    last = said.strip().splitlines()[-1]
    assert code == 2, said
    assert said.count("vbaa: ") == 1
    assert last.startswith("vbaa: ")
    assert "; " in last, f"no remedy: {last}"
    assert "Traceback" not in said
    for word in words:
        assert word in last, f"{word!r} is not in {last!r}"


def ranges(question: Question) -> tuple[float, ...]:
    """Just beyond the limits, which are answers themselves."""
    assert question.read(question.low) == question.low
    assert question.read(str(question.high)) == question.high
    return question.low - 1e-9 - 1e-6 * abs(question.low), question.high * 1.001


@pytest.mark.parametrize("question", EVERY, ids=lambda question: question.key)
def test_every_answer(question: Question) -> None:
    beyond = ranges(question) if question.kind == "number" else ()
    for given in (*TYPED[question.kind], *WRITTEN[question.kind], *beyond):
        with pytest.raises(InputError, match=question.key) as raised:
            question.read(given)
        assert raised.value.remedy.startswith("give ")
        assert question.unit in raised.value.remedy


@pytest.mark.parametrize("key", ["antenna_length_mm", "jig_turn_deg", "paper", "lens_source", "noload_readings"])
def test_a_flag_and_an_answers_file(key: str, tmp_path: Path) -> None:
    question = next(question for question in EVERY if question.key == key)
    for typed in TYPED[question.kind]:
        expect_line(call(tmp_path / "s", f"{question.flag}={typed}"), question.flag, "give ", question.unit)
    for value in WRITTEN[question.kind]:
        file = answers_file(tmp_path / "answers.yaml", {key: value})
        if key in {table.key for table in TABLES} and isinstance(value, list):
            continue
        expect_line(call(tmp_path / "s", "--answers", file), "answers.yaml", key, "give ", question.unit)
    assert not (tmp_path / "s").exists()


FILES: dict[str, tuple[str | bytes, tuple[str, ...]]] = {
    "unknown": ("xyz: 1\n", ("xyz", "the keys are board, ")),
    "no YAML": ("a: [1, 2\nb: 3\n", ("line 2", "not valid YAML")),
    "binary": (b"\x89PNG\r\n\x1a\n\x00\xff", ("is not UTF-8 text",)),
    "number of 5000 digits": ("antenna_length_mm: 0x" + 4200 * "f", ("antenna_length_mm", "give a number in mm")),
    "row is a number": ("noload_readings: [1, 2]\n", ("row 1", "is not a mapping", "pan_rad")),
    "row with unknown key": ("noload_readings: [{pan: 3}]\n", ("row 1", "unknown key 'pan'", "pan_deg")),
    "row with NaN": ("noload_readings: [{moment_mNm: .nan}]\n", ("row 1", "moment_mNm", "give a number")),
    "load at the clamp": ("loads_readings: [{distance_mm: 0}]\n", ("row 1", "distance_m is 0")),
    "picture twice": ("noload_readings: [{image: a.png}, {image: a.png}]\n", ("row 2", "a.png stands twice")),
    "picture is a number": ("noload_readings: [{image: 12}]\n", ("row 1", "image is no name")),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file(name: str, tmp_path: Path) -> None:
    content, words = FILES[name]
    file = tmp_path / "answers.yaml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    expect_line(call(tmp_path / "s", "--answers", file), "answers.yaml", *words)
    assert not (tmp_path / "s").exists()
