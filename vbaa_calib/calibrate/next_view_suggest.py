"""The pose of the board that would lower the error on plane C most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import BoardSpec
from targets.charuco import corner_points

from ..geometry import Pose
from .next_view_plane import WorkPlane
from .next_view_poses import Candidate, Held, candidates, coarse_set, finer_set, observation
from .next_view_taken import Taken
from .next_view_words import pose_words
from .next_view_worth import mean_square, view_blocks

NEAREST, FURTHEST = 0.6, 1.7
"""Of plane C's distance: what lies beyond is out of focus in a camera that is sharp on plane C."""

_WHOLE_SHARE = 0.95
_WHOLE_PICTURES = 3
_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class Suggestion:
    """The picture to take next.

    Attributes
    ----------
    T_camera_board : pose of the board. outline_px : (4, 2) its outline in the picture, from the board's origin round.
    words : what a person can do. std_m : on plane C after it by noise, were the lens right; NaN while there is none.
    """

    T_camera_board: Pose
    outline_px: np.ndarray
    words: str
    std_m: float


def best_next(taken: Taken, plane: WorkPlane, spec: BoardSpec, functional: np.ndarray | None) -> Suggestion | None:
    """The best of a designed set of poses, then of those near it. None where none shows enough of the board.

    functional : of `plane_functional`; without it the lens as a whole is what is to be known better.
    """
    aim = np.eye(taken.information.shape[0])[None] if functional is None else functional
    # the first pictures find the board and start the lens: all of it has to be seen
    share = _WHOLE_SHARE if taken.pictures < _WHOLE_PICTURES else None
    limits = NEAREST * plane.distance_m, FURTHEST * plane.distance_m
    best = _best(taken, coarse_set(taken.design, spec, *limits), spec, aim, share)
    if best is None:
        return None
    for _ in range(_ROUNDS):
        best = _best(taken, [best[0].held, *finer_set(best[0].held, *limits)], spec, aim, share) or best
    candidate, square = best
    known = taken.solved and functional is not None
    return Suggestion(
        candidate.T_camera_board,
        _outline(taken, candidate, spec),
        pose_words(taken.design.camera, candidate.T_camera_board, spec, len(candidate.ids), taken.solved),
        taken.inflation * float(np.sqrt(square)) if known else np.nan,
    )


def _best(
    taken: Taken, ways: Sequence[Held], spec: BoardSpec, aim: np.ndarray, share: float | None
) -> tuple[Candidate, float] | None:
    found = candidates(taken.design, spec, ways) if share is None else candidates(taken.design, spec, ways, share)
    if not found:
        return None
    poses = np.array([candidate.T_camera_board.vector for candidate in found])
    blocks, _ = view_blocks(taken.design, poses, [observation(candidate, spec) for candidate in found])
    squares = mean_square(aim, taken.information + blocks)
    index = int(np.argmin(squares))
    return found[index], float(squares[index])


def _outline(taken: Taken, candidate: Candidate, spec: BoardSpec) -> np.ndarray:
    """Corners that lie outside the picture, where the lens may fold, by the homography of those inside."""
    points = corner_points(spec)[candidate.ids]
    pixels, _ = taken.design.camera.project(candidate.T_camera_board @ points)
    homography, _ = cv2.findHomography(points[:, :2], pixels)
    width, height = spec.square_m * spec.squares_x, spec.square_m * spec.squares_y
    corners = np.array([[[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]])
    return cv2.perspectiveTransform(corners, homography)[0]
