"""Answers and readings: units, tables, lines typed on a terminal, going back, and what contradicts them."""

from __future__ import annotations

import datetime
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vbaa_calib.antenna.materials import MATERIALS
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.images import read_picture
from vbaa_calib.wizard import flow, steps
from vbaa_calib.wizard.against_answers import antenna_diagnoses, camera_place, entries_that_show_it
from vbaa_calib.wizard.asking import change
from vbaa_calib.wizard.questions import BY_KEY, QUESTIONS, SOURCES, TABLES, Question
from vbaa_calib.wizard.session_state import SessionState, still_of
from vbaa_calib.wizard.store import Store
from vbaa_calib.wizard.ui import Interrupted, Ui, WizardView

from .small_session import answers, answers_file, call, rendered, tiny_source, unseen_steps

RNG_SEED = 11


@pytest.mark.parametrize("question", [q for q in QUESTIONS if q.kind == "number"], ids=lambda question: question.key)
def test_a_number_typed_is_the_number_written(question: Question) -> None:
    rng = np.random.default_rng(RNG_SEED)
    for value in rng.uniform(question.low, question.high, 20).tolist():
        assert question.read(repr(value)) == question.read(value) == value
        assert question.read(f"  {value!r} ") == value


@pytest.mark.parametrize(
    ("key", "unit", "per_unit"),
    [
        *(
            ("jig_translation_mm", unit, per_mm)
            for unit, per_mm in (("m", 1e-3), ("cm", 0.1), ("mm", 1.0), ("in", 1 / 25.4))
        ),
        ("weights_g", "kg", 1e-3),
        ("jig_turn_deg", "rad", np.pi / 180),
    ],
)
def test_a_unit_may_be_typed(key: str, unit: str, per_unit: float) -> None:
    """Behind each number, or behind the last for all, however they are separated."""
    question = BY_KEY[key]
    for value in np.random.default_rng(RNG_SEED).uniform(1.0, 100.0, (20, 3)):
        numbers = [repr(float(one)) for one in per_unit * value]
        for text in (f"{' '.join(numbers)} {unit}", f"{', '.join(numbers)}{unit}", f"{unit}; ".join(numbers) + unit):
            assert question.read(text) == pytest.approx(value.tolist(), rel=1e-12)
        assert replace(question, kind="number").read(numbers[0] + unit) == pytest.approx(value[0])


EVERY = (*QUESTIONS, *SOURCES, *TABLES)
TYPED = {
    "number": ["240 miles", "24 24", "0,8", "nan", "-inf", "", " ", "ten", "1e400", "٢٤", "1_0", "0x10", "1e7", "-1e7"],
    "numbers": ["a,b,c", "1,2,x", "", ",", "1e400,1,1", "nan,1,1", "1,2,3 miles", "about 1 2 3"],
    "choice": ["purple", "", "-"],
    "sides": ["", "half", "2 x", "-2", "1.5", "1x2x3"],
    "yesno": ["", "maybe", "2"],
    "text": ["", "  "],
}
WRITTEN: dict[str, list[object]] = {
    "number": [None, True, [], [1.0], {"value": 1}, float("nan"), 10**400, datetime.date(2026, 1, 1)],
    "numbers": [None, True, [], {"x": 1}, [[1], 2, 3], [1, 2, None], [float("inf"), 1, 1]],
    "choice": [None, True, 3, ["x"], {"x": 1}],
    "sides": [None, True, 1.5, -2, [2, 1]],
    "yesno": [None, 3, ["yes"], {"x": 1}],
    "text": [None, 3, {"path": "x"}, "x" * 5000],
}


@pytest.mark.parametrize("question", EVERY, ids=lambda question: question.key)
def test_every_answer(question: Question) -> None:
    beyond: tuple[float, ...] = ()
    if question.kind == "number":  # the limits are answers themselves
        assert question.read(question.low) == question.low
        assert question.read(str(question.high)) == question.high
        beyond = question.low - 1e-9 - 1e-6 * abs(question.low), question.high * 1.001
    for given in [*TYPED[question.kind], *WRITTEN[question.kind], *beyond]:
        with pytest.raises(InputError, match=question.key) as raised:
            question.read(given)
        assert raised.value.remedy.startswith("give ")
        assert question.unit in raised.value.remedy


MAIN = "import sys; from vbaa_calib.cli.main import main; sys.exit(main(['wizard', *sys.argv[1:]]))"


def test_without_a_terminal_it_never_waits(tmp_path: Path) -> None:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "TERM": "xterm"}
    command = ["/bin/sh", "-c", 'exec "$@" <&-', "sh", sys.executable, "-c", MAIN, "rig"]
    closed = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert closed.returncode == 2
    assert "board_along_x_mm is not answered" in closed.stderr
    assert "\033" not in closed.stderr


BACK, QUIT, ENTER = "!back", "!quit", object()
PATIENCE = 50
"""Looks for pictures before a question that is expected."""


class Typist(Ui):
    """Answers what is asked as its script has it: (key, answer or command), or (pictures to wait for, command)."""

    def __init__(self, script: Sequence[tuple[str | int, Any]], store: Store) -> None:
        super().__init__(WizardView(), interactive=True)
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
    script = [(3, BACK), ("camera_distance_mm", 410), (3, "!enough"), ("plane_way", QUIT)]
    store, typist = walked(tmp_path / "session", until(source, "camera_inclination_deg"), script)
    assert store.journal.answers["camera_distance_mm"] == 410
    assert store.journal.answers["camera_inclination_deg"] == 30
    assert typist.offered["camera_distance_mm"] == 370
    assert len(store.journal.of("lens").taken) == 3
    assert store.journal.of("lens").closed


def test_a_table_or_board_that_was_mended_counts(source: Path, tmp_path: Path) -> None:
    """Whichever table was edited, that of the pictures or the session's own; and pictures that were left out for a
    board's file are offered again once that describes another board."""
    board = tmp_path / "board.yaml"
    board.write_text(
        "{type: charuco, squares_x: 8, squares_y: 6, square_m: 0.02, marker_m: 0.015, dictionary: DICT_4X4_50}"
    )
    given = (
        until(source, "source")
        | answers(source)
        | {"board": str(board), "board_along_x_mm": 160, "board_along_y_mm": 120}
    )
    session, file = tmp_path / "session", answers_file(tmp_path / "answers.yaml", given)
    call(session, "--answers", file)
    for path, was, mended in (
        (source / "loads" / "loads.csv", "0.1,0,-0.05", "0.11,0,-0.05"),
        (session / "loads" / "loads.csv", "0.11,0", "0.12,0"),
        (session / "loads" / "loads.csv", "0.12,0", "a tenth,0"),
    ):
        path.write_text(path.read_text().replace(was, mended))
        os.utime(path, (2e9, 2e9))
        call(session, "--answers", file)
        os.utime(source / "loads" / "loads.csv", (1e9, 1e9))
    with Store(session) as store:
        assert store.journal.of("loads").taken[0].readings["distance_m"] == 0.12
        assert store.journal.of("lens").left
    board.write_text(board.read_text().replace("6", "7"))
    call(session, "--answers", file, "--board-along-y-mm", 140, "--source", tmp_path / "nowhere")
    with Store(session) as store:
        assert not store.journal.of("lens").left


MADE_OF, OTHER = "stainless steel", "nylon"
RIGHT = {"jig_translation_mm": [28.0, 61.0, -9.0], "jig_board_x": "x", "jig_board_y": "-y"}


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wizard's session up to the free antenna, all answers right; never to be written to."""
    folder = tmp_path_factory.mktemp("answers")
    source = Path(shutil.copytree(rendered(), folder / "source", ignore=shutil.ignore_patterns("loads")))
    given = answers(source) | {"material": MADE_OF}
    call(folder / "session", "--answers", answers_file(folder / "answers.yaml", given))
    return folder / "session"


@pytest.fixture
def state(taken: Path, tmp_path: Path) -> Iterator[SessionState]:
    with Store(Path(shutil.copytree(taken, tmp_path / "session"))) as store:
        yield SessionState(store)


def named(state: SessionState) -> str:
    """What is said of the first free picture, found where the answers put it or not; "" where all is well."""
    first = state.store.journal.of("noload").taken[0]
    path = state.store.path(first)
    still, image = still_of("noload", path, first.readings), read_picture(path)
    try:
        state.observe(still, "noload", image)
    except InputError:
        return entries_that_show_it(state, still, "noload", image)
    return " ".join(one.remedy for one in antenna_diagnoses(state, together=False))


def test_right_answers_are_not_questioned(state: SessionState) -> None:
    assert named(state) == ""
    assert {one.severity for one in antenna_diagnoses(state)} <= {"note"}
    assert camera_place(state, state.plane().estimates[0].T_antenna_camera)[1] == []


SLIPS: list[dict[str, Any]] = [
    {"jig_translation_mm": [28.0, 61.0, 9.0]},
    {"jig_translation_mm": [28.0, -61.0, -9.0]},
    {"jig_translation_mm": [-28.0, 61.0, -9.0]},
    {"jig_translation_mm": [61.0, 28.0, -9.0]},
    {"jig_translation_mm": [2.8, 6.1, -0.9]},
    {"jig_translation_mm": [28.0 / 25.4, 61.0 / 25.4, -9.0 / 25.4]},
    {"jig_board_x": "-x", "jig_board_y": "y"},
    {"jig_board_x": "y", "jig_board_y": "x"},
]


def expect_named(slip: dict[str, Any], state: SessionState) -> None:
    state.store.answer(slip)
    words = named(state)
    for key in slip:
        right = RIGHT[key]
        if isinstance(right, str):
            assert f"`{key} = {right}`" in words
        else:
            entries = re.findall(rf"`{key} = ([^`]*)`", words)
            assert any(np.allclose([float(one) for one in entry.split(",")], right, atol=0.02) for entry in entries)


@pytest.mark.parametrize("slip", [SLIPS[index] for index in np.random.default_rng(4).permutation(len(SLIPS))[:1]])
def test_a_slip_in_the_jig_is_named_with_the_entry_that_fits(slip: dict[str, Any], state: SessionState) -> None:
    expect_named(slip, state)


def test_another_material_is_named_and_nothing_is_enough_before(state: SessionState) -> None:
    """And once it is right, the step goes on: the numbers that follow from the material are others, too."""
    right = state.session.antenna
    assert change(state, Ui(), "material", OTHER)
    assert state.session.antenna.youngs_modulus_Pa == pytest.approx(MATERIALS[OTHER].youngs_modulus_Pa)
    (doubt,) = [one for one in antenna_diagnoses(state) if "material" in one.name]
    assert MADE_OF in doubt.remedy
    now = steps.STEP_BY_NAME["noload"].progress(state)
    assert not now.enough
    assert "more will not help" not in now.next
    assert change(state, Ui(), "material", MADE_OF)
    assert state.session.antenna == right
    assert {one.severity for one in antenna_diagnoses(state)} <= {"note"}
