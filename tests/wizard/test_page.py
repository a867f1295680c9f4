"""The page of a wizard that runs: what it shows, and that what is done on it is meant for what it showed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vbaa_calib.sources.files import frame_picture
from vbaa_calib.wizard.capture import GO_ON
from vbaa_calib.wizard.flow import STEP_BY_NAME
from vbaa_calib.wizard.page import Page
from vbaa_calib.wizard.questions import Question
from vbaa_calib.wizard.server import PageCommand
from vbaa_calib.wizard.session_state import SessionState
from vbaa_calib.wizard.steps import PictureCheck
from vbaa_calib.wizard.store import Store
from vbaa_calib.wizard.ui import LivePicture, Ui, View


class Shown:
    """A server that only keeps what it was shown last, and commands to take."""

    url = "http://127.0.0.1:0/"

    def __init__(self, port: int = 0) -> None:
        self.number, self.state = 0, dict[str, Any]()
        self.jpeg: bytes | None = None
        self.commands: list[PageCommand] = []

    def show(self, state: Mapping[str, Any], jpeg: bytes | None = None) -> int:
        self.number += 1
        self.state, self.jpeg = json.loads(json.dumps(state)), jpeg
        return self.number

    def take_commands(self) -> list[PageCommand]:
        taken, self.commands = self.commands, []
        return taken


@dataclass
class Dialogue:
    """A page with the wizard's side of it, the server that it shows itself on, and the session."""

    ui: Ui
    page: Page
    shown: Shown
    store: Store

    def clicked(self, *commands: PageCommand) -> list[tuple[str, Any]]:
        """What arrives of these."""
        self.shown.commands = list(commands)
        return list(self.page.events(self.ui))

    def asked(self, question: Question, problem: str = "") -> int:
        """Ask without waiting; the number of what the page shows then."""
        self.ui.question, self.ui.words, self.ui.problem = question, question.words, problem
        self.page.update(self.ui, "question")
        return self.shown.number


@pytest.fixture
def led(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Dialogue]:
    monkeypatch.setattr("vbaa_calib.wizard.page.PageServer", Shown)
    monkeypatch.setattr(SessionState, "views", lambda *_: [SimpleNamespace(corners_px=np.array([[5.0, 5.0]]))])
    with Store(tmp_path / "rig") as store:
        page = Page(SessionState(store))
        shown = page._server
        assert isinstance(shown, Shown)
        yield Dialogue(Ui(page, interactive=True), page, shown, store)


def taken(store: Store) -> None:
    """A picture of the lens."""
    store.take("lens", frame_picture("frame 1", np.zeros((4, 4), np.uint8), 0.0), {})


def test_only_what_can_be_done_is_offered(led: Dialogue) -> None:
    led.ui.begin(STEP_BY_NAME["board"])
    assert led.shown.state["can"] == ["redo", "quit"]
    led.ui.begin(STEP_BY_NAME["lens"])
    assert led.shown.state["can"] == ["redo", "back", "quit"]
    taken(led.store)
    led.ui.live(LivePicture(np.full((90, 160), 100, np.uint8), PictureCheck(), 0.5))
    assert led.shown.state["can"] == ["take", "redo", "enough", "drop", "back", "quit"]
    led.asked(GO_ON)
    assert "take" not in led.shown.state["can"]
    assert led.shown.state["question"]["default"] is True
    doubt = {"question": "Is EI known?", "words": "to 3 %", "remedy": "hang another load"}
    document = {"verdict": "look at", "headline": "Look at it.", "session_findings": [], "findings": [doubt]}
    led.ui.done(document, "check.html")
    assert led.shown.state["can"] == ["quit"]
    assert led.shown.state["verdict"] == {
        "level": "look at",
        "words": "Look at it.",
        "found": ["Is EI known? to 3 % → hang another load"],
    }
    assert {step["status"] for step in led.shown.state["steps"]} == {"done"}


def test_a_second_click_before_the_first_was_seen_does_nothing(led: Dialogue) -> None:
    led.ui.begin(STEP_BY_NAME["lens"])
    taken(led.store)
    led.ui.say("took one")
    seen = led.shown.number
    commands = [PageCommand(kind=kind, seen=seen) for kind in ("drop", "drop", "quit")]
    assert led.clicked(*commands) == [("drop", None), ("quit", None)]
    led.ui.say("dropped")
    assert led.clicked(PageCommand(kind="drop", seen=led.shown.number)) == [("drop", None)]


def test_an_answer_is_for_the_question_that_was_seen(led: Dialogue) -> None:
    mass = Question("mass_g", "loads", "Mass?", unit="g")
    first = led.asked(mass)
    again = led.asked(mass, "too heavy")
    assert led.shown.state["question"]["problem"] == "too heavy"
    assert led.clicked(PageCommand(kind="answer", value={"mass_g": 5.0}, seen=first)) == []
    assert led.clicked(PageCommand(kind="answer", value={"pan_deg": 5.0}, seen=again)) == []
    assert led.clicked(PageCommand(kind="answer", value={"mass_g": 6.0}, seen=again)) == [("answer", 6.0)]


class Clicking(View):
    """Gives each of these answers once it is asked."""

    def __init__(self, *given: object) -> None:
        self.given, self.problems = list(given), list[str]()

    def update(self, ui: Ui, change: str) -> None:
        if change == "problem":
            self.problems.append(ui.problem)

    def events(self, ui: Ui) -> Iterator[tuple[str, Any]]:
        if self.given:
            yield "answer", self.given.pop(0)


def test_the_first_answer_counts_wherever_it_is_given() -> None:
    """A wrong one is told on every view, and a right one on another is waited for."""
    silent, clicking = Clicking(), Clicking("heavy", 7)
    question = Question("mass_g", "loads", "Mass?", unit="g")
    assert Ui(silent, clicking, interactive=True).ask(question) == 7.0
    assert silent.problems == clicking.problems != []
