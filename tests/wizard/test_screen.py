"""What is written to a terminal fits it."""

from __future__ import annotations

import io

import pytest

from vbaa_calib.wizard.terminal import Screen


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
