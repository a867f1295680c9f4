"""The camera of a guided session and the hand that holds the board: what a wanted pose turns into."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from targets.charuco import corner_points

from ..calibrate.next_view import Suggestion
from ..calibrate.next_view_poses import shown_corners
from ..calibrate.plane import solve_board_pose
from ..calibrate.plane_starts import start_poses
from ..camera import Camera
from ..detect.corners import BoardView, detect_corners
from ..geometry import Pose
from ..synth.lens import Lens
from ..synth.picture import digitise, expose, studio, surroundings
from ..synth.render_board import board_patch, print_sheet
from .guided_rigs import Rig

_HAND_TURN_RAD, _HAND_DISTANCE, _HAND_PLACE = np.radians(5.0), 0.05, 0.03
_LEAST_CORNERS = 8
_TRIES = 40


class Photographer:
    """Takes pictures of the board on one rig; noise, hand and lighting all from the seed."""

    def __init__(self, rig: Rig, seed: int) -> None:
        self.rig, self.rng, self.camera = rig, np.random.default_rng(seed), rig.camera
        self._taken = 0
        if rig.picture is not None:
            lens = Lens(self.camera.model, rig.image_size, self.camera.matrix, self.camera.distortion)
            self._studio = studio(lens, rig.picture, self.rng)
            self._sheet = print_sheet(rig.board)

    def by_hand(self, wanted: Pose) -> BoardView | None:
        """The picture of the board held at about this pose: ± 5°, ± 5 % of the distance, ± 3 % of it to the side.

        A picture on which the board is not found is taken again; None after many.
        """
        half = _half(self.rig)
        for _ in range(_TRIES):
            turn = Rotation.from_rotvec(_HAND_TURN_RAD * self.rng.normal(size=3)).as_matrix()
            middle = wanted @ half
            aside = _HAND_PLACE * middle[2] * self.rng.normal(size=2)
            moved = middle * (1.0 + _HAND_DISTANCE * self.rng.normal()) + np.append(aside, 0.0)
            rotation = turn @ wanted.rotation
            view = self.picture(Pose(rotation, moved - rotation @ half))
            if view is not None:
                return view
        return None

    def picture(self, pose: Pose) -> BoardView | None:
        """The board at exactly this pose; None where fewer than 8 corners are found."""
        name = f"{self._taken:03d}.png"
        view = self._projected(pose, name) if self.rig.picture is None else self._rendered(pose, name)
        if len(view.ids) < _LEAST_CORNERS:
            return None
        self._taken += 1
        return view

    def _projected(self, pose: Pose, name: str) -> BoardView:
        ids = shown_corners(self.camera, [pose], self.rig.board)[0]
        pixels, _ = self.camera.project(pose @ corner_points(self.rig.board)[ids])
        noisy = pixels + self.rig.sigma_px * self.rng.normal(size=pixels.shape)
        return BoardView(name, ids, noisy, self.rig.image_size, np.arange(self.rig.board.corner_count // 2))

    def _rendered(self, pose: Pose, name: str) -> BoardView:
        # the camera looks down on the bench and is turned about its axis a little from picture to picture
        about = Rotation.from_rotvec([0.0, 0.0, self.rng.uniform(-0.5, 0.5)]).as_matrix()
        world = about @ np.diag([1.0, -1.0, -1.0])
        patch = board_patch(self._studio, self._sheet, pose, world)
        grey = expose(self._studio, surroundings(self._studio, world), [] if patch is None else [patch])
        return detect_corners(digitise(self._studio.spec, grey, self.rng), self.rig.board, name)


def wanted_pose(suggestion: Suggestion, rig: Rig, camera: Camera | None) -> Pose:
    """Where the board goes when its outline is brought to the one suggested: by it, while there is no lens.

    camera : the lens so far. With it, the pose is what is obeyed.
    """
    if camera is not None:
        return suggestion.T_camera_board
    flat, seen = rig.camera.unproject_normalized(suggestion.outline_px)
    if not seen.all():
        return suggestion.T_camera_board
    width, height = 2.0 * _half(rig)[:2]
    corners = np.array([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, height, 0.0], [0.0, height, 0.0]])
    return start_poses(corners, flat)[0]


def _half(rig: Rig) -> np.ndarray:
    return rig.board.square_m * np.array([rig.board.squares_x, rig.board.squares_y, 0.0]) / 2


def jig_pose(photographer: Photographer, camera: Camera, pictures: int = 8) -> Pose | None:
    """Of the board in the jig, found with a lens in pictures of their own noise; None where it is not found."""
    rig = photographer.rig
    views = [photographer.picture(rig.plane.board_pose(rig.board)) for _ in range(pictures)]
    found = [view for view in views if view is not None]
    return solve_board_pose(found, rig.board, camera).T_camera_board if found else None
