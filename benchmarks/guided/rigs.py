"""The camera of a guided session and the hand that holds the board: what becomes of a suggested pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.boards import BARREL, BOARD, HD, MILD, VGA, WIDE, Optics, pose_by, rms_on_plane_mm
from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.guide.next_view import lens_progress
from vbaa_calib.calibrate.guide.settings import GuideSettings
from vbaa_calib.calibrate.guide.suggestion import Suggestion, visible_corners
from vbaa_calib.calibrate.guide.view_uncertainty import WorkPlane
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.bundle import BoardCorners
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.calibrate.pose.board_pose import solve_board_pose, start_poses
from vbaa_calib.camera import Camera
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.board import board_patch, print_sheet
from vbaa_calib.simulate.render.picture import digitise, expose, studio, surroundings
from vbaa_calib.simulate.scene.lens import Lens
from vbaa_calib.simulate.scene.scene import PictureSpec

GOAL_MM = 0.1
_CARD = BoardSpec(squares_x=6, squares_y=5, square_m=0.025, marker_m=0.019)
_DIM = PictureSpec(1.2, 6.0, 12.0, 0.35, 0.3, 0.35, 0.3, 0.2, 0.4, 0.0)
_HAND_TURN_RAD, _HAND_DISTANCE, _HAND_PLACE = np.radians(5.0), 0.05, 0.03
_LEAST_CORNERS, _TRIES = 8, 40


@dataclass(frozen=True, eq=False)
class Rig(Optics):
    """A camera, a board, and plane C: 240 x 120 mm at 0.4 m, tilted by 35°.

    sigma_px : deviation of a corner per axis, where corners are projected. picture : how pictures come about where
        they are rendered and the board is found in them; None where corners are projected.
    """

    board: BoardSpec
    sigma_px: float
    picture: PictureSpec | None = None

    @property
    def plane(self) -> WorkPlane:
        """Plane C, as the user describes it."""
        return WorkPlane.about(0.4, float(np.radians(35.0)), 0.24)

    @property
    def half_board_m(self) -> np.ndarray:
        """(3,) from the board's corner to its middle."""
        return self.board.square_m * np.array([self.board.squares_x, self.board.squares_y, 0.0]) / 2


def rigs() -> list[Rig]:
    """Two that are hard on the lens, one of them rendered too, and an easy one."""
    return [
        Rig("VGA, barrel, 15 cm board, 0.3 px", "opencv5", VGA, BARREL, _CARD, 0.3),
        Rig("VGA, barrel, 15 cm board, rendered", "opencv5", VGA, BARREL, _CARD, 0.0, _DIM),
        Rig("wide rational, 15 cm board, 0.3 px", "rational", HD, WIDE, _CARD, 0.3),
        Rig("f 900, A4 board, 0.15 px", "opencv5", HD, MILD, BOARD, 0.15),
    ]


def true_error_mm(camera: Camera, rig: Rig, board_pose: Pose | None = None) -> float:
    """Rms distance on C between points and where the lens puts their true pixels, mm; 100 mm where there is no ray.

    board_pose : of the board in the jig as it was found with this lens; without it, found from exact corners.
    """
    truth, plane = rig.camera, rig.plane
    pixels, inside = _seen(truth, plane.T_camera_plane @ np.column_stack([plane.points, np.zeros(len(plane.points))]))
    true_board = plane.board_pose(rig.board)
    if board_pose is None:
        points = corner_points(rig.board)
        corners, shown = _seen(truth, true_board @ points)
        board_pose = pose_by(camera, true_board, BoardCorners(points[shown], corners[shown]))
    T_camera_plane = board_pose @ true_board.inverse() @ plane.T_camera_plane
    return rms_on_plane_mm(camera, T_camera_plane, plane.points[inside], pixels[inside])


def _seen(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pixels, valid = camera.project(points)
    return pixels, valid & camera.in_picture(pixels)


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
        half = self.rig.half_board_m
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
        ids = visible_corners(self.camera, [pose], self.rig.board)[0]
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

    def in_the_jig(self, camera: Camera) -> Pose | None:
        """T_camera_board in the jig, found with a lens in 8 pictures of their own noise; None where it is not found."""
        views = [self.picture(self.rig.plane.board_pose(self.rig.board)) for _ in range(8)]
        found = [view for view in views if view is not None]
        flat = BoardShape.flat(corner_points(self.rig.board))
        return solve_board_pose(found, flat, camera).T_camera_board if found else None


def wanted_pose(suggestion: Suggestion, rig: Rig, camera: Camera | None) -> Pose:
    """Where the board goes when a suggestion is followed: its pose, or its outline while there is no lens yet.

    camera : the lens so far.
    """
    flat, seen = rig.camera.unproject_normalized(suggestion.outline_px)
    if camera is not None or not seen.all():
        return suggestion.T_camera_board
    width, height = 2.0 * rig.half_board_m[:2]
    corners = np.array([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, height, 0.0], [0.0, height, 0.0]])
    return start_poses(corners, flat)[0]


_PEOPLES_TILT_RAD, _PEOPLES_PLACE = np.radians(40.0), 0.33
_SHARE = 0.35
"""Of the board's corners that a picture must show."""
_GIVEN_UP = 100
"""Pictures with too little of the board in them that are taken before a strategy gives up."""

Strategy = Callable[[Photographer, Sequence[BoardView], LensSolution | None], BoardView | None]


def _suggested(
    photographer: Photographer, views: Sequence[BoardView], solution: LensSolution | None
) -> BoardView | None:
    """What `lens_progress` asks for, held by hand."""
    rig = photographer.rig
    progress = lens_progress(views, rig.board, rig.plane, image_size=rig.image_size, solution=solution)
    if progress.suggestion is None:
        return None
    camera = None if solution is None else solution.camera
    return photographer.by_hand(wanted_pose(progress.suggestion, rig, camera))


def _as_people_do(photographer: Photographer, *_views: object) -> BoardView | None:
    """Tilted by up to 40°, rolled a little, its middle in the middle two thirds, at any distance that is in focus.

    None where picture after picture shows too little of the board.
    """
    rng, rig = photographer.rng, photographer.rig
    for _ in range(_GIVEN_UP):
        around, tilt_rad = rng.uniform(0, 2 * np.pi), rng.uniform(0.0, _PEOPLES_TILT_RAD)
        tilt = Rotation.from_rotvec(tilt_rad * np.array([np.cos(around), np.sin(around), 0.0]))
        rotation = (tilt * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-0.5, 0.5)])).as_matrix()
        place = 0.5 + rng.uniform(-_PEOPLES_PLACE, _PEOPLES_PLACE, 2)
        ray = photographer.camera.unproject((place * (np.array(rig.image_size) - 1))[None])[0][0]
        distance = rig.plane.distance_m * rng.uniform(GuideSettings.nearest, 1.4)
        view = photographer.picture(Pose(rotation, distance * ray - rotation @ rig.half_board_m))
        if view is not None and len(view.ids) >= _SHARE * rig.board.corner_count:
            return view
    return None


SUGGESTED, PEOPLE = "as suggested", "random, as people do"
STRATEGIES: dict[str, Strategy] = {SUGGESTED: _suggested, PEOPLE: _as_people_do}
"""Name → strategy; the first is ours, and works out the next pose from the lens so far."""
