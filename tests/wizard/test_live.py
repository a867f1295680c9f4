"""The lens from a live camera: whoever obeys the wizard and holds still needs no key to reach the end of the step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.guided.rigs import rigs, wanted_pose
from targets.sheet import spec_document
from vbaa_calib.calibrate.guide.next_view import ViewProgress
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.board import board_patch, print_sheet
from vbaa_calib.simulate.render.picture import digitise, expose, studio, surroundings
from vbaa_calib.simulate.scene.lens import Lens
from vbaa_calib.sources.files import Picture, frame_picture
from vbaa_calib.wizard.capture import Capture
from vbaa_calib.wizard.flow import STEP_BY_NAME
from vbaa_calib.wizard.page import Page
from vbaa_calib.wizard.session_state import SessionState
from vbaa_calib.wizard.steps import Progress, _guidance
from vbaa_calib.wizard.store import Store, _StepRecord
from vbaa_calib.wizard.ui import LivePicture, Ui, WizardView

RIG = rigs()[1]
FPS = 6.0
MOVING_FRAMES, PATIENCE_FRAMES = 3, 9
_DOWN = np.diag([1.0, -1.0, -1.0])
_TREMBLE_M, _TREMBLE_RAD = 3e-5, 1e-4
_SLIP_RAD, _SLIP_SHARE = np.radians(4.0), 0.03
_EXPOSURE = 0.4
"""Of the time from frame to frame."""


class ObedientCamera:
    """A live source of rendered frames of `RIG`. `wanted` says where the board should be; it ends after `frames`.

    Whoever holds the board goes to the pose that is wanted in a few frames and stays there, trembling; when nothing
    happens, somewhere beside it. The first frame shows no board. Depends on nothing but what is wanted.
    """

    live = True

    def __init__(self, wanted: Callable[[], ViewProgress], frames: int) -> None:
        self.name = "obedient"
        self.notes: tuple[str, ...] = ()
        self.ended, self.number = False, 0
        self._wanted, self._frames = wanted, frames
        self._rng = np.random.default_rng(0)
        lens = Lens(RIG.camera.model, RIG.image_size, RIG.camera.matrix, RIG.camera.distortion)
        assert RIG.picture is not None
        self._studio, self._sheet = studio(lens, RIG.picture, self._rng), print_sheet(RIG.board)
        self._behind = surroundings(self._studio, _DOWN)
        self._at = self._from = self._to = WorkPose.of(Pose(np.eye(3), np.array([-0.05, -0.04, 0.5])))
        self._for: object = None
        self._since = 0

    def next(self, timeout_s: float) -> Picture | None:
        """The next frame."""
        if self.ended:
            return None
        number, self.number = self.number, self.number + 1
        self.ended = self.number >= self._frames
        pixels = self._frame() if number else self._shot([None])
        return frame_picture(f"frame {number}", pixels, number / FPS)

    def close(self) -> None:
        """Nothing is held open."""

    def _frame(self) -> np.ndarray:
        now = self._wanted()
        if now.suggestion is not self._for or self._since > MOVING_FRAMES + PATIENCE_FRAMES:
            beside = now.suggestion is self._for
            self._for, self._since, self._from = now.suggestion, 0, self._at
            if now.suggestion is not None:
                camera = None if now.solution is None else now.solution.camera
                wanted = WorkPose.of(wanted_pose(now.suggestion, RIG, camera))
                self._to = wanted.moved(self._rng, _SLIP_RAD, _SLIP_SHARE * wanted.shift[2]) if beside else wanted
        before, self._since = self._at, self._since + 1
        part = min(self._since / MOVING_FRAMES, 1.0)
        self._at = self._from.towards(self._to, part)
        if part < 1.0 or self._since == MOVING_FRAMES:
            return self._shot([before.towards(self._at, share) for share in np.linspace(1 - _EXPOSURE, 1, 3)])
        self._at = self._to.moved(self._rng, _TREMBLE_RAD, _TREMBLE_M)
        return self._shot([self._at])

    def _shot(self, poses: Sequence[WorkPose | None]) -> np.ndarray:
        """A frame during which the board was at these poses, or nowhere."""
        light = np.zeros_like(self._behind)
        for pose in poses:
            patch = None if pose is None else board_patch(self._studio, self._sheet, pose.pose, _DOWN)
            light += expose(self._studio, self._behind, [] if patch is None else [patch])
        return digitise(self._studio.spec, light / len(poses), self._rng)


class WorkPose:
    """A pose of the board that can be gone to: turn and place of T_camera_board."""

    def __init__(self, turn: Rotation, shift: np.ndarray) -> None:
        self.turn, self.shift = turn, shift

    @staticmethod
    def of(pose: Pose) -> WorkPose:
        """From a pose."""
        return WorkPose(Rotation.from_matrix(pose.rotation), pose.translation_m)

    @property
    def pose(self) -> Pose:
        """T_camera_board."""
        return Pose(self.turn.as_matrix(), self.shift)

    def towards(self, other: WorkPose, part: float) -> WorkPose:
        """A part of the way."""
        turns = Rotation.concatenate([self.turn, other.turn])
        return WorkPose(Slerp([0.0, 1.0], turns)(part), (1 - part) * self.shift + part * other.shift)

    def moved(self, rng: np.random.Generator, turn_rad: float, shift_m: float) -> WorkPose:
        """By chance."""
        return WorkPose(
            Rotation.from_rotvec(turn_rad * rng.normal(size=3)) * self.turn, self.shift + shift_m * rng.normal(size=3)
        )


MOST_FRAMES = 150
LENS = STEP_BY_NAME["lens"]


class Watching(WizardView):
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
    record: _StepRecord
    last: Progress


@pytest.fixture(scope="module")
def obeyed(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """The lens by an obedient camera, the page looking on."""
    with rig(tmp_path_factory.mktemp("obeyed")) as state:
        watching = Watching()
        ui = Ui(watching, Page(state))
        try:
            ui.begin(LENS)
            end = Capture(state, ui, LENS, ObedientCamera(lambda: _guidance(state), MOST_FRAMES)).run()
            return Seen(end, watching.lives, state.store.journal.of("lens"), LENS.progress(state))
        finally:
            ui.close()


@pytest.mark.slow
def test_obeying_and_holding_still_is_enough(obeyed: Seen) -> None:
    assert (obeyed.end, obeyed.record.closed) == ("closed", "enough")
    assert len(obeyed.lives) < MOST_FRAMES
    assert 8 <= len(obeyed.record.taken) <= 12
    assert obeyed.last.enough
    assert obeyed.last.numbers[0].met
    assert not obeyed.record.left


@pytest.mark.slow
def test_only_frames_that_are_held_still_are_taken(obeyed: Seen) -> None:
    by_name = {f"frame {index}": live for index, live in enumerate(obeyed.lives)}
    for one in obeyed.record.taken:
        live = by_name[one.source]
        assert live.held == 1.0
        assert not live.check.refusal
    moving = [live for live in obeyed.lives if live.words.startswith("moving")]
    assert len(moving) >= 2 * len(obeyed.record.taken)
    assert {hint.name for live in moving for hint in live.check.hints} & {"motion_blur", "out_of_focus"}
