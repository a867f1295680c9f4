"""Going back: to a step's questions after its pictures began, and over several answers, none of them lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vbaa_calib.session import load_session, read_noload
from vbaa_calib.wizard import flow
from vbaa_calib.wizard.questions import QUESTIONS, Question
from vbaa_calib.wizard.session_state import SessionState
from vbaa_calib.wizard.store import Store
from vbaa_calib.wizard.ui import Interrupted, Ui, View

from .small_session import answers, tiny_source, unseen_steps

BACK, QUIT, ENTER = "!back", "!quit", object()
PATIENCE = 50
"""Looks for pictures before a question that is expected."""


class Typist(Ui):
    """Answers what is asked as its script has it: (key, answer or command), or (pictures to wait for, command)."""

    def __init__(self, script: Sequence[tuple[str | int, Any]], store: Store) -> None:
        super().__init__(View(), interactive=True)
        self.script, self.store, self.offered = list(script), store, dict[str, Any]()
        self.waited = 0

    def ask(self, question: Question, facts: Mapping[str, Any] | None = None) -> Any:
        if not self.script:
            raise Interrupted("quit")
        key, given = self.script.pop(0)
        assert question.key == key
        self.offered[question.key] = question.default
        if isinstance(given, str) and given.startswith("!"):
            raise Interrupted(given[1:])
        return question.read(question.default if given is ENTER else given)

    def commands(self) -> list[str]:
        if not self.script:
            raise Interrupted("quit")
        wanted, command = self.script[0]
        if isinstance(wanted, str):
            self.waited += 1
            assert self.waited < PATIENCE, f"{wanted} is not asked"
            return []
        if len(self.store.journal.of(self.step.name if self.step else "").taken) < wanted:
            return []
        self.script.pop(0)
        return [command[1:]]


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, step in unseen_steps().items():
        monkeypatch.setitem(flow.STEP_BY_NAME, name, step)
    return tiny_source(tmp_path / "source")


def walked(root: Path, given: Mapping[str, Any], script: Sequence[tuple[str | int, Any]]) -> tuple[Store, Typist]:
    """A wizard that knows these answers, with a script typed to its end."""
    with Store(root) as store:
        store.answer(given)
        typist = Typist(script, store)
        with pytest.raises(Interrupted):
            flow.walk(SessionState(store), typist, lambda document: "")
    assert not typist.script
    return store, typist


def until(source: Path, last: str) -> dict[str, Any]:
    """All answers up to this one."""
    every = answers(source) | {"board_reading_std_mm": 0.25, "jig_std_mm": 0.05, "jig_std_deg": 0.02}
    every |= {"board_thickness_mm": 3.0}
    order = [question.key for question in QUESTIONS if question.key in every]
    return {key: every[key] for key in order[: order.index(last) + 1]}


def test_back_reaches_the_questions_of_a_step_whose_pictures_have_begun(source: Path, tmp_path: Path) -> None:
    """A distance noted wrong is mended without losing a picture; everything else is Enter."""
    script = [
        (3, BACK),
        ("camera_distance_mm", 410),
        (3, "!enough"),
        ("plane_way", QUIT),
    ]
    store, typist = walked(tmp_path / "session", until(source, "camera_inclination_deg"), script)
    assert store.journal.answers["camera_distance_mm"] == 410
    assert store.journal.answers["camera_inclination_deg"] == 30
    assert typist.offered["camera_distance_mm"] == 370
    assert len(store.journal.of("lens").taken) == 3
    assert store.journal.of("lens").closed


def test_without_a_moment_sensor_no_moment_is_asked_for(source: Path, tmp_path: Path) -> None:
    """A line has the angles alone, session.yaml says null, and the table has no such column."""
    (source / "noload" / "noload.csv").unlink()
    script: list[tuple[str | int, Any]] = [(3, "!enough"), (1, "!enough"), ("moment_sensor", "no")]
    script += [("readings", "0 0"), ("readings", "0 20"), (2, QUIT)]
    store, _ = walked(tmp_path / "session", until(source, "antenna_diameter_mm"), script)
    assert all("moment_Nm" not in one.readings for one in store.journal.of("noload").taken)
    session = load_session(tmp_path / "session")
    assert not session.with_sensor
    assert [np.isnan(still.moment_Nm) for still in read_noload(session)] == [True, True]
    assert SessionState.answers_of(tmp_path / "session" / "session.yaml")["moment_sensor"] is False


def test_a_sensor_of_several_axes_is_asked_for_all_its_channels(source: Path, tmp_path: Path) -> None:
    (source / "noload" / "noload.csv").unlink()
    answers = until(source, "antenna_diameter_mm") | {"sensor_axes": "wrench"}
    script: list[tuple[str | int, Any]] = [(3, "!enough"), (1, "!enough"), ("moment_sensor", ENTER)]
    script += [("readings", "0 0 1 2 3 4 5 6"), ("readings", "0 20 1 2 3 4 5 6"), (2, QUIT)]
    walked(tmp_path / "session", answers, script)
    session = load_session(tmp_path / "session")
    assert session.wrench_sensor is not None
    assert session.wrench_sensor.std_N == pytest.approx(3e-3)
    first, _ = read_noload(session)
    assert first.readings == pytest.approx([1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3])
