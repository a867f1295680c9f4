"""Strategies that choose the next pose of the board: as suggested, at random, and by rules of thumb."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.calibrate.guide.next_view import lens_progress
from vbaa_calib.calibrate.guide.suggestion import FURTHEST, NEAREST, coarse_poses, observation, view_candidates
from vbaa_calib.calibrate.guide.view_uncertainty import LensInformation, view_blocks
from vbaa_calib.calibrate.lens.intrinsics import LensSolution
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

from .rigs import Photographer, wanted_pose

_TILT_RAD = np.radians(45.0)
_PEOPLES_TILT_RAD, _PEOPLES_PLACE = np.radians(40.0), 0.33
_SHARE = 0.35
_CELLS = (8, 6)
_TRIES = 100
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


def _as_people_do(photographer: Photographer) -> BoardView | None:
    """Tilted by up to 40°, rolled a little, its middle in the middle two thirds, at any distance that is in focus."""
    rng = photographer.rng
    rotation = _tilt(rng, _PEOPLES_TILT_RAD) * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-0.5, 0.5)])
    place = 0.5 + rng.uniform(-_PEOPLES_PLACE, _PEOPLES_PLACE, 2)
    return _picture(photographer, place, rotation, facing=False)


def _anywhere(photographer: Photographer) -> BoardView | None:
    """Uniform over all that the suggestions are chosen from: every place, distance, direction, tilts up to 45°."""
    rng = photographer.rng
    rotation = _tilt(rng, _TILT_RAD) * Rotation.from_rotvec([0.0, 0.0, rng.choice([0.0, np.pi / 2])])
    return _picture(photographer, rng.uniform(0.05, 0.95, 2), rotation, facing=True)


def _random(choose: Callable[[Photographer], BoardView | None]) -> Strategy:
    def strategy(photographer: Photographer, views: Sequence[BoardView], _: LensSolution | None) -> BoardView | None:
        tries = (choose(photographer) for _ in range(_TRIES))
        return next((view for view in tries if view is not None), None)

    return strategy


def _covering(photographer: Photographer, views: Sequence[BoardView], _: LensSolution | None) -> BoardView | None:
    """The rule of thumb: the board in the middle of the emptiest part of the picture, tilted at random."""
    rng = photographer.rng
    counts = np.zeros(_CELLS)
    for view in views:
        cells = np.clip(view.corners_px / np.array(photographer.rig.image_size) * _CELLS, 0, np.array(_CELLS) - 1)
        np.add.at(counts, tuple(cells.astype(int).T), 1.0)
    order = np.argsort(counts.ravel() + 0.01 * rng.uniform(size=counts.size)).tolist()
    places = ((np.array(np.unravel_index(index, _CELLS)) + 0.5) / _CELLS for index in order * _TRIES)
    tries = (_picture(photographer, place, _tilt(rng, _TILT_RAD), facing=True) for place in places)
    return next((view for view in tries if view is not None), None)


def _most_determinant(
    photographer: Photographer, views: Sequence[BoardView], solution: LensSolution | None
) -> BoardView | None:
    """The pose, of those that suggestions are chosen from, that adds most to the determinant of the information."""
    rig = photographer.rig
    if solution is None:
        return _suggested(photographer, views, None)
    taken = LensInformation.of(solution, views, rig.board)
    limits = NEAREST * rig.plane.distance_m, FURTHEST * rig.plane.distance_m
    found = view_candidates(taken.design, rig.board, coarse_poses(taken.design, rig.board, *limits))
    poses = np.array([candidate.T_camera_board.vector for candidate in found])
    blocks, _ = view_blocks(taken.design, poses, [observation(candidate, rig.board) for candidate in found])
    grown = np.linalg.slogdet(np.eye(len(taken.information)) + taken.information + blocks)[1]
    return photographer.by_hand(found[int(np.argmax(grown))].T_camera_board)


def _tilt(rng: np.random.Generator, most_rad: float) -> Rotation:
    """About a random axis in the picture."""
    around = rng.uniform(0, 2 * np.pi)
    return Rotation.from_rotvec(rng.uniform(0.0, most_rad) * np.array([np.cos(around), np.sin(around), 0.0]))


def _picture(photographer: Photographer, place: np.ndarray, rotation: Rotation, facing: bool) -> BoardView | None:
    """At a place (2,) of the picture, 0 to 1, and a random distance; None where too little of the board is seen.

    facing : the rotation counts from a board that faces the camera, else from one parallel to the picture.
    """
    rig = photographer.rig
    ray = photographer.camera.unproject((place * (np.array(rig.image_size) - 1))[None])[0][0]
    turn = Rotation.align_vectors(ray[None], np.array([[0.0, 0.0, 1.0]]))[0].as_matrix() if facing else np.eye(3)
    distance = rig.plane.distance_m * photographer.rng.uniform(NEAREST, 1.4)
    whole = turn @ rotation.as_matrix()
    view = photographer.picture(Pose(whole, distance * ray - whole @ rig.half_board_m))
    return view if view is not None and len(view.ids) >= _SHARE * rig.board.corner_count else None


SUGGESTED, PEOPLE = "as suggested", "random, as people do"
STRATEGIES: dict[str, Strategy] = {
    SUGGESTED: _suggested,
    PEOPLE: _random(_as_people_do),
    "random, anywhere": _random(_anywhere),
    "emptiest part": _covering,
    "largest determinant": _most_determinant,
}
"""Name → strategy; the first is ours."""
NEED_A_LENS = (SUGGESTED, "largest determinant")
"""Those that work out the next pose from the lens so far."""
