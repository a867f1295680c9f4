"""From the first question to rig.json as a person goes it: one folder that the camera's program fills for all steps."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.images import read_picture
from vbaa_calib.session import load_session, read_loads, read_noload
from vbaa_calib.wizard import flow
from vbaa_calib.wizard.against_answers import entries_that_show_it
from vbaa_calib.wizard.questions import Question
from vbaa_calib.wizard.session_state import SessionState, still_of
from vbaa_calib.wizard.steps import Progress, Step
from vbaa_calib.wizard.store import Store
from vbaa_calib.wizard.ui import LivePicture, Ui, WizardView
from viz.report import check as report

from ..small_scene import simulated, small_scene
from .small_session import answers

MOST_ANSWERS, MOST_WITHOUT_READINGS = 25, 15
WRONG_MM = 80.0
PATIENCE = 8
"""Looks at the folder without news after which a person types enough."""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the camera sees, and truth.json."""
    folder = tmp_path_factory.mktemp("first-hour")
    scene = small_scene(noload=2, loads=())
    scene["intrinsics"]["pictures"] = 8
    level = {"pan_deg": 0.0, "tilt_deg": 0.0, "force_y_N": 0.0}
    places = ((0.1, 0.02), (0.16, 0.01), (0.2, 0.005))
    scene["loads"] = [level | {"distance_m": place, "force_z_N": -9.80665 * mass} for place, mass in places]
    return simulated(folder, scene)


class Person(Ui):
    """Answers what is asked, counts it, and lets the camera's program write the pictures of a step once it waits."""

    def __init__(self, session: Path, camera: Path) -> None:
        super().__init__(WizardView(), interactive=True)
        self.session, self.camera = session, camera
        self.count, self.said, self.begun, self.asked = 0, list[str](), set[str](), list[str]()
        self.given = answers(session) | {"source": str(camera), "board_thickness_mm": self._thickness_mm()}
        loaded = load_session(session)
        self.stills = {"noload": read_noload(loaded), "loads": read_loads(loaded)}
        self.idle, self.advice, self.matches = 0, list[str](), set[str]()

    def _thickness_mm(self) -> float:
        return 1e3 * float(read_yaml(self.session / "session.yaml")["board"].get("thickness_m", 0.0))

    def say(self, line: str) -> None:
        self.said.append(line)
        self.idle = 0
        super().say(line)

    def show(self, step: Step, progress: Progress) -> None:
        self.advice.append(progress.next)
        super().show(step, progress)

    def live(self, picture: LivePicture) -> None:
        if picture.check.closeness is not None:
            self.matches.add(self.step.name if self.step else "")
        super().live(picture)

    def ask(self, question: Question, facts: Mapping[str, Any] | None = None) -> Any:
        self.count += 1
        self.asked.append(question.key)
        assert question.key != "again"
        if question.key == "go_back":
            raise AssertionError(f"stuck: {self.said[-3:]}")
        given = self.given.get(question.key, question.default)
        if question.key == "board_thickness_mm":
            self.count += 1
            assert self.change("jig_turn_deg", "0 0 1")
        if question.key == "plane_way":
            # somebody is still at the lens
            path = next((self.session / "intrinsics").glob("*.png"))
            assert cv2.imwrite(str(self.camera / "lens_late.jpg"), cv2.imread(str(path)))
        if question.key == "readings":
            assert not self.problem
            given = self._readings(question.words)
        return question.read(given)

    def _readings(self, words: str) -> str:
        step, number, _ = words.split("_", 2)
        return self._line(step, self.stills[step][int(number)])

    def _line(self, step: str, still: Any) -> str:
        numbers = [np.degrees(still.pan_rad), np.degrees(still.tilt_rad), 1e3 * still.moment_Nm]
        if step == "loads":
            mass_g = 1e3 * np.hypot(still.force_y_N, still.force_z_N) / 9.80665
            numbers = [mass_g, 1e3 * still.distance_m, *numbers]
        return " ".join(f"{number:.9g}" for number in numbers)

    def commands(self) -> list[str]:
        name = self.step.name if self.step else ""
        if name not in self.begun:
            self.begun.add(name)
            self._write(name)
            self.idle = 0
        self.idle += 1
        if self.idle < PATIENCE:
            return []
        self.count += 1
        assert self.idle < 2 * PATIENCE, f"stuck: {self.said[-3:]}"
        return ["enough"]

    def _write(self, step: str) -> None:
        if step in self.stills:
            files = [still.image for still in self.stills[step]]
        else:
            files = sorted((self.session / {"lens": "intrinsics"}.get(step, step)).glob("*.png"))
        for number, path in enumerate(files):
            # written long ago: a folder source need not watch it
            target = self.camera / f"{step}_{number}_.png"
            shutil.copy(path, target)
            os.utime(target, (1e9, 1e9))
        if step == "plane":
            # a picture of the lens step in another file: none of the jig
            path = next((self.session / "intrinsics").glob("*.png"))
            assert cv2.imwrite(str(self.camera / "plane_0x.jpg"), cv2.imread(str(path)))


@pytest.fixture(scope="module")
def walked(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SessionState, Person]]:
    """A wizard's session, which stays open, and who answered."""
    folder = tmp_path_factory.mktemp("walked")
    (folder / "camera").mkdir()
    person = Person(session, folder / "camera")
    with Store(folder / "rig") as store:
        state = SessionState(store)
        person.document = flow.walk(state, person, report.page)
        yield state, person


@pytest.fixture
def state(walked: tuple[SessionState, Person]) -> Iterator[SessionState]:
    """The session, whose answers are put back after the test."""
    before = dict(walked[0].store.journal.answers)
    yield walked[0]
    walked[0].store.answer(before)


def test_from_the_first_question_to_the_rig(session: Path, walked: tuple[SessionState, Person]) -> None:
    (state, person), journal = walked, walked[0].store.journal
    assert person.count <= MOST_ANSWERS
    assert len([key for key in person.asked if key != "readings"]) <= MOST_WITHOUT_READINGS
    assert person.document["verdict"] != "does not hold", person.document["words"]
    assert person.matches == {"lens"}, "how near each picture is to the pose suggested"
    for step in ("lens", "plane", "noload", "loads"):
        assert {one.source.split("_")[0] for one in journal.of(step).taken} == {step}
    assert "moved" in next(one.why for one in journal.of("plane").left if one.source == "plane_0x.jpg")
    truth = json.loads((session / "truth.json").read_text())
    rig = json.loads((state.store.root / "rig.json").read_text())
    assert rig["antenna"]["stiffness_Nm2"] == pytest.approx(truth["stiffness_Nm2"], rel=0.03)


def test_a_wrong_thickness_is_named_by_the_first_free_picture(state: SessionState) -> None:
    """Not blamed on light: where the jig's answers put the antenna, it is not."""
    first = state.store.journal.of("noload").taken[0]
    path = state.store.path(first)
    right_mm = state.store.journal.answers["board_thickness_mm"]
    state.store.answer({"board_thickness_mm": WRONG_MM})
    still, image = still_of("noload", path, first.readings), read_picture(path)
    with pytest.raises(InputError):
        state.observe(still, "noload", image)
    assert f"`board_thickness_mm = {right_mm:g}`" in entries_that_show_it(state, still, "noload", image)
