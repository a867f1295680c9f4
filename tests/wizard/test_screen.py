"""What is written to a terminal fits it."""

from __future__ import annotations

import io

import pytest

from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.wizard.steps.step import Number, Progress
from vbaa_calib.wizard.ui.base import progress_lines
from vbaa_calib.wizard.ui.terminal import Screen, wrapped


def test_lines_are_broken_at_blanks_and_hang_below_their_label() -> None:
    words = "look at   the corners reach over 47 % of the picture, none in the upper right"
    lines = wrapped(words, 40, "  ", 12 * " ").split("\n")
    assert all(len(line) <= 40 for line in lines)
    assert lines[0].startswith("  look at   the")
    assert all(line.startswith(12 * " ") and line[12] != " " for line in lines[1:])
    assert " ".join(" ".join(lines).split()) == " ".join(words.split())


def test_an_address_stays_whole_and_blank_lines_stay() -> None:
    address = "http://127.0.0.1:45213/?token=" + 43 * "x"
    assert address in wrapped(f"open {address} in a browser", 40).split("\n")
    assert wrapped("one\n\ntwo", 40) == "one\n\ntwo"


class FakeTerminal(io.StringIO):
    """Standard error that says it is a terminal."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> FakeTerminal:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.delenv("NO_COLOR", raising=False)
    return FakeTerminal()


def test_the_status_changes_and_what_was_typed_stays(terminal: FakeTerminal) -> None:
    screen = Screen(terminal)
    screen.below("type: ", "first")
    terminal.truncate(0)
    screen.below("type: ", "second")
    # the cursor is kept, goes up, and comes back to what was typed
    assert terminal.getvalue().lstrip("\0") == "\0337\033[A\rsecond\033[K\0338"
    terminal.truncate(0)
    screen.below("type: ", "second")
    assert not terminal.getvalue().strip("\0")


def test_what_is_written_takes_the_place_of_status_and_prompt(terminal: FakeTerminal) -> None:
    screen = Screen(terminal)
    screen.below("type: ", "status")
    screen.write("took one", "bold")
    assert terminal.getvalue().endswith("\r\033[K\033[A\033[K\033[1mtook one\033[0m\n")


@pytest.mark.parametrize(("name", "value"), [("TERM", "dumb"), ("NO_COLOR", "1")])
def test_plain_terminals_get_plain_text(
    terminal: FakeTerminal, monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv(name, value)
    screen = Screen(terminal)
    screen.write("words", "bold")
    assert terminal.getvalue() == "words\n"


def test_signs_that_a_terminal_does_not_have_are_no_error(
    terminal: FakeTerminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FakeTerminal, "encoding", "latin-1")
    Screen(terminal).write("→ 3 °")
    assert terminal.getvalue() == "? 3 °\n"


def test_a_step_says_what_is_wrong_what_to_do_and_what_is_next_last() -> None:
    progress = Progress(
        seen=("3 pictures",),
        missing=("5 more",),
        next="board in the left",
        numbers=(Number("plane C", "0.2 mm", "0.1 mm", False), Number("lens", "0.05 px", "0.1 px", True)),
        diagnoses=(Diagnosis("a", "it slips", "clamp it"), Diagnosis("b", "it is bent", "straighten it", grave=True)),
    )
    assert progress_lines(progress) == [
        "seen      3 pictures",
        "          plane C: 0.2 mm (goal 0.1 mm)",
        "          lens: 0.05 px (goal 0.1 px, reached)",
        "missing   5 more",
        "WRONG     it is bent",
        "          → straighten it",
        "look at   it slips",
        "          → clamp it",
        "next      board in the left",
    ]
