"""A camera before which somebody holds the board where it is wanted: moves there, and holds still, as hands do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.guided.rigs import Rig, rigs, wanted_pose
from vbaa_calib.calibrate.guide.next_view import ViewProgress
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.board import board_patch, print_sheet
from vbaa_calib.simulate.render.picture import digitise, expose, studio, surroundings
from vbaa_calib.simulate.scene.lens import Lens
from vbaa_calib.wizard.sources.picture import Picture, frame_picture

RIG = rigs()[1]
FPS = 6.0
PATIENCE_FRAMES = 9
_DOWN = np.diag([1.0, -1.0, -1.0])
_TREMBLE_M, _TREMBLE_RAD = 3e-5, 1e-4
_SLIP_RAD, _SLIP_SHARE = np.radians(4.0), 0.03
_EXPOSURE = 0.4
"""Of the time from frame to frame."""


class ObedientCamera:
    """A live source of rendered frames of `RIG`. `wanted` says where the board should be; it ends after `frames`.

    Whoever holds the board goes to the pose that is wanted in `moving` frames and stays there, trembling; when nothing
    happens, somewhere beside it. The first frame shows no board. Depends on nothing but the seed and what is wanted.
    """

    live = True

    def __init__(
        self, wanted: Callable[[], ViewProgress], frames: int, seed: int = 0, moving: int = 3, rig: Rig = RIG
    ) -> None:
        self.name = "obedient"
        self.notes: tuple[str, ...] = ()
        self.ended, self.number = False, 0
        self._wanted, self._frames, self._moving, self._rig = wanted, frames, moving, rig
        self._rng = np.random.default_rng(seed)
        camera = rig.camera
        assert rig.picture is not None
        lens = Lens(camera.model, rig.image_size, camera.matrix, camera.distortion)
        self._studio, self._sheet = studio(lens, rig.picture, self._rng), print_sheet(rig.board)
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
        pixels = self._empty() if number == 0 else self._frame()
        return frame_picture(f"frame {number}", pixels, number / FPS)

    def close(self) -> None:
        """Nothing is held open."""

    def _empty(self) -> np.ndarray:
        return digitise(self._studio.spec, expose(self._studio, self._behind, []), self._rng)

    def _frame(self) -> np.ndarray:
        now = self._wanted()
        if now.suggestion is not self._for or self._since > self._moving + PATIENCE_FRAMES:
            beside = now.suggestion is self._for
            self._for, self._since, self._from = now.suggestion, 0, self._at
            if now.suggestion is not None:
                camera = None if now.solution is None else now.solution.camera
                wanted = WorkPose.of(wanted_pose(now.suggestion, self._rig, camera))
                self._to = wanted.moved(self._rng, _SLIP_RAD, _SLIP_SHARE * wanted.shift[2]) if beside else wanted
        before, self._since = self._at, self._since + 1
        part = min(self._since / self._moving, 1.0)
        self._at = self._from.towards(self._to, part)
        if part < 1.0 or self._since == self._moving:
            return self._shot([before.towards(self._at, share) for share in np.linspace(1 - _EXPOSURE, 1, 3)])
        self._at = self._to.moved(self._rng, _TREMBLE_RAD, _TREMBLE_M)
        return self._shot([self._at])

    def _shot(self, poses: list[WorkPose]) -> np.ndarray:
        """A frame during which the board was at these poses."""
        light = np.zeros_like(self._behind)
        for pose in poses:
            patch = board_patch(self._studio, self._sheet, pose.pose, _DOWN)
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
