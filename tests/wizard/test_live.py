"""The lens from a live camera: whoever obeys the wizard and holds still needs no key to reach the end of the step."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from targets.sheet import spec_document
from vbaa_calib.wizard.capture import Capture
from vbaa_calib.wizard.flow import STEP_BY_NAME
from vbaa_calib.wizard.page import Page
from vbaa_calib.wizard.session_state import SessionState
from vbaa_calib.wizard.step import Progress
from vbaa_calib.wizard.steps import guidance
from vbaa_calib.wizard.store import StepRecord, Store
from vbaa_calib.wizard.ui import LivePicture, Ui, View

from .obedient_camera import RIG, ObedientCamera

MOST_FRAMES = 150
LENS = STEP_BY_NAME["lens"]


class Watching(View):
    """Keeps the live pictures."""

    def __init__(self) -> None:
        self.lives: list[LivePicture] = []

    def update(self, ui: Ui, change: str) -> None:
        if change == "live" and ui.picture is not None:
            self.lives.append(ui.picture)


@contextmanager
def rig(root: Path) -> Iterator[SessionState]:
    """A session in which all is answered before the lens."""
    with Store(root) as store:
        (root / "board.yaml").write_text(spec_document(RIG.board, "of the test"))
        width, height = (1e3 * RIG.board.square_m * n for n in (RIG.board.squares_x, RIG.board.squares_y))
        answers: dict[str, Any] = {
            "board": "new",
            "paper": "A4",
            "measure_x_mm": width,
            "measure_y_mm": height,
            "board_along_x_mm": width,
            "board_along_y_mm": height,
            "antenna_length_mm": 240.0,
            "camera_distance_mm": 400.0,
            "camera_inclination_deg": 35.0,
        }
        store.answer(answers)
        state = SessionState(store)
        state.live_size = RIG.image_size
        yield state


@dataclass
class Seen:
    """What a run of the lens' step came to."""

    end: str
    lives: list[LivePicture]
    record: StepRecord
    last: Progress


@pytest.fixture(scope="module")
def obeyed(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """The lens by an obedient camera, the page looking on."""
    with rig(tmp_path_factory.mktemp("obeyed")) as state:
        watching = Watching()
        ui = Ui(watching, Page(state))
        try:
            ui.begin(LENS)
            end = Capture(state, ui, LENS, ObedientCamera(lambda: guidance(state), MOST_FRAMES)).run()
            return Seen(end, watching.lives, state.store.journal.of("lens"), LENS.progress(state))
        finally:
            ui.close()


def test_obeying_and_holding_still_is_enough(obeyed: Seen) -> None:
    assert (obeyed.end, obeyed.record.closed) == ("closed", "enough")
    assert len(obeyed.lives) < MOST_FRAMES
    assert 8 <= len(obeyed.record.taken) <= 12
    assert obeyed.last.enough
    assert obeyed.last.numbers[0].met
    assert not obeyed.record.left


def test_only_frames_that_are_held_still_are_taken(obeyed: Seen) -> None:
    by_name = {f"frame {index}": live for index, live in enumerate(obeyed.lives)}
    for one in obeyed.record.taken:
        live = by_name[one.source]
        assert live.held == 1.0
        assert not live.check.refusal
    moving = [live for live in obeyed.lives if live.words.startswith("moving")]
    assert len(moving) >= 2 * len(obeyed.record.taken)
    assert {hint.name for live in moving for hint in live.check.hints} & {"motion_blur", "out_of_focus"}
