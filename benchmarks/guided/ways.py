"""Ways to choose the next pose of the board: as suggested, at random, and by rules of thumb."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.calibrate.guide.next_view import lens_progress
from vbaa_calib.calibrate.guide.poses import candidates, coarse_set, observation
from vbaa_calib.calibrate.guide.suggestion import FURTHEST, NEAREST
from vbaa_calib.calibrate.guide.view_uncertainty import view_blocks, with_a_lens
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

from .rigs import Photographer, Rig, wanted_pose

_TILT_RAD = np.radians(45.0)
_PEOPLES_TILT_RAD, _PEOPLES_PLACE = np.radians(40.0), 0.33
_SHARE = 0.35
_CELLS = (8, 6)

Way = Callable[[Photographer, Sequence[BoardView], LensSolution | None], BoardView | None]


def suggested(
    photographer: Photographer, views: Sequence[BoardView], solution: LensSolution | None
) -> BoardView | None:
    """What `lens_progress` asks for, held by hand."""
    rig = photographer.rig
    progress = lens_progress(views, rig.board, rig.plane, image_size=rig.image_size, solution=solution)
    if progress.suggestion is None:
        return None
    camera = None if solution is None else solution.camera
    return photographer.by_hand(wanted_pose(progress.suggestion, rig, camera))


def _as_people_do(photographer: Photographer, views: Sequence[BoardView], solution: LensSolution | None) -> BoardView:
    """Tilted by up to 40°, rolled a little, its middle in the middle two thirds, at any distance that is in focus."""
    rng = photographer.rng
    while True:
        around = rng.uniform(0, 2 * np.pi)
        tilt = rng.uniform(0.0, _PEOPLES_TILT_RAD) * np.array([np.cos(around), np.sin(around), 0.0])
        rotation = Rotation.from_rotvec(tilt) * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-0.5, 0.5)])
        place = 0.5 + rng.uniform(-_PEOPLES_PLACE, _PEOPLES_PLACE, 2)
        view = _picture(photographer, place, rotation.as_matrix(), facing=False)
        if view is not None:
            return view


def anywhere(photographer: Photographer, views: Sequence[BoardView], solution: LensSolution | None) -> BoardView:
    """Uniform over all that the suggestions are chosen from: every place, distance, direction, tilts up to 45°."""
    rng = photographer.rng
    while True:
        around = rng.uniform(0, 2 * np.pi)
        tilt = rng.uniform(0.0, _TILT_RAD) * np.array([np.cos(around), np.sin(around), 0.0])
        roll = Rotation.from_rotvec([0.0, 0.0, rng.choice([0.0, np.pi / 2])])
        rotation = (Rotation.from_rotvec(tilt) * roll).as_matrix()
        view = _picture(photographer, rng.uniform(0.05, 0.95, 2), rotation, facing=True)
        if view is not None:
            return view


def _covering(photographer: Photographer, views: Sequence[BoardView], solution: LensSolution | None) -> BoardView:
    """The rule of thumb: the board in the middle of the emptiest part of the picture, tilted at random."""
    rng, rig = photographer.rng, photographer.rig
    counts = np.zeros(_CELLS)
    for view in views:
        cells = np.clip(view.corners_px / np.array(rig.image_size) * _CELLS, 0, np.array(_CELLS) - 1).astype(int)
        np.add.at(counts, tuple(cells.T), 1.0)
    order = np.argsort(counts.ravel() + 0.01 * rng.uniform(size=counts.size))
    while True:
        for index in order.tolist():
            place = (np.array(np.unravel_index(index, _CELLS)) + 0.5) / _CELLS
            around = rng.uniform(0, 2 * np.pi)
            tilt = rng.uniform(0.0, _TILT_RAD) * np.array([np.cos(around), np.sin(around), 0.0])
            taken = _picture(photographer, place, Rotation.from_rotvec(tilt).as_matrix(), facing=True)
            if taken is not None:
                return taken


def _most_determinant(
    photographer: Photographer, views: Sequence[BoardView], solution: LensSolution | None
) -> BoardView | None:
    """The pose, of those that suggestions are chosen from, that adds most to the determinant of the information."""
    rig = photographer.rig
    if solution is None:
        return suggested(photographer, views, None)
    taken = with_a_lens(solution, views, rig.board)
    limits = NEAREST * rig.plane.distance_m, FURTHEST * rig.plane.distance_m
    found = candidates(taken.design, rig.board, coarse_set(taken.design, rig.board, *limits))
    poses = np.array([candidate.T_camera_board.vector for candidate in found])
    blocks, _ = view_blocks(taken.design, poses, [observation(candidate, rig.board) for candidate in found])
    grown = np.linalg.slogdet(np.eye(len(taken.information)) + taken.information + blocks)[1]
    return photographer.by_hand(found[int(np.argmax(grown))].T_camera_board)


def _picture(photographer: Photographer, place: np.ndarray, rotation: np.ndarray, facing: bool) -> BoardView | None:
    """At a place (2,) of the picture, 0 to 1, and a random distance; None where too little of the board is seen.

    facing : the rotation counts from a board that faces the camera, else from one parallel to the picture.
    """
    rig: Rig = photographer.rig
    ray = photographer.camera.unproject((place * (np.array(rig.image_size) - 1))[None])[0][0]
    turn = Rotation.align_vectors(ray[None], np.array([[0.0, 0.0, 1.0]]))[0].as_matrix() if facing else np.eye(3)
    distance = rig.plane.distance_m * photographer.rng.uniform(NEAREST, 1.4)
    half = rig.board.square_m * np.array([rig.board.squares_x, rig.board.squares_y, 0.0]) / 2
    whole = turn @ rotation
    view = photographer.picture(Pose(whole, distance * ray - whole @ half))
    enough = view is not None and len(view.ids) >= _SHARE * rig.board.corner_count
    return view if enough else None


SUGGESTED, PEOPLE = "as suggested", "random, as people do"
WAYS: dict[str, Way] = {
    SUGGESTED: suggested,
    PEOPLE: _as_people_do,
    "random, anywhere": anywhere,
    "emptiest part": _covering,
    "largest determinant": _most_determinant,
}
"""Name → way to choose the next pose; the first is ours."""
