"""The pose of the board to show next; how well a live picture matches it, and what to change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Pose

from .poses import LEAST_SHARE, HeldPose, ViewCandidate, coarse_poses, finer_poses, observation, view_candidates
from .view_uncertainty import LensInformation, WorkPlane, mean_square, nominal_intrinsics, view_blocks

_SIDES = ("right", "lower right", "lower", "lower left", "left", "upper left", "upper", "upper right")
_FACING_RAD = np.radians(8.0)
_UPRIGHT_RAD = np.radians(60.0)
_WHOLE = 0.95


def seen_as(camera: Camera, T_camera_board: Pose, spec: BoardSpec) -> HeldPose:
    """A pose as seen by the camera."""
    half = spec.square_m * np.array([spec.squares_x, spec.squares_y, 0.0]) / 2
    middle = T_camera_board @ half
    distance = float(np.linalg.norm(middle))
    ray = middle / distance
    pixel, valid = camera.project(middle[None])
    flat = camera.matrix[:2, 2] + np.diag(camera.matrix)[:2] * ray[:2] / max(ray[2], 0.05)
    place = (pixel[0] if valid[0] else flat) / (np.array(camera.image_size) - 1)
    normal = T_camera_board.rotation[:, 2]
    cosine = float(normal @ ray)
    tilt = -(normal - cosine * ray)
    long_side = T_camera_board.rotation[:, 0 if spec.squares_x >= spec.squares_y else 1]
    angle = float(np.arctan2(long_side[1], long_side[0]))
    return HeldPose(
        (float(place[0]), float(place[1])),
        distance,
        float(np.arccos(np.clip(abs(cosine), 0.0, 1.0))),
        float(np.arctan2(tilt[1], tilt[0])),
        float((angle + np.pi / 2) % np.pi - np.pi / 2),
    )


def _pose_words(camera: Camera, T_camera_board: Pose, spec: BoardSpec, corners: int, metric: bool) -> str:
    """A pose for the terminal: where, how far, how turned; right and left as the picture shows them.

    corners : how many of the board's are to be seen. metric : whether the distance is known.
    """
    seen = seen_as(camera, T_camera_board, spec)
    parts = [f"board in the {_place_words(seen.place)} of the picture"]
    if corners < _WHOLE * spec.corner_count:
        parts[0] += f", partly outside it ({corners} of its {spec.corner_count} corners seen)"
    if metric:
        parts.append(f"{seen.distance_m:.2f} m away")
    else:
        size = spec.square_m * np.array([spec.squares_x, spec.squares_y])
        share = np.max(size * np.diag(camera.matrix)[:2] / seen.distance_m / np.array(camera.image_size))
        parts.append(f"so near that it fills {100 * min(share, 1.0):.0f} % of the picture's width or height")
    parts.append(tilt_words(seen))
    if abs(seen.roll_rad) > _UPRIGHT_RAD:
        parts.append("its long side upright")
    return ", ".join(parts)


def tilt_words(held: HeldPose) -> str:
    """Which edge is turned away from the camera, and by how much."""
    if held.tilt_rad < _FACING_RAD:
        return "facing the camera"
    side, tilt_deg = _SIDES[round(held.away_rad / (np.pi / 4)) % 8], 5 * round(np.degrees(held.tilt_rad) / 5)
    return f"its {side} {'corner' if ' ' in side else 'edge'} turned {tilt_deg}° away from the camera"


def _place_words(place: tuple[float, float]) -> str:
    """ "upper left", "middle", ... of the picture."""
    across = "left" if place[0] < 0.4 else "right" if place[0] > 0.6 else ""
    down = "upper" if place[1] < 0.4 else "lower" if place[1] > 0.6 else ""
    return f"{down} {across or 'middle'}".strip()


NEAREST, FURTHEST = 0.6, 1.7
"""Of plane C's distance: what lies beyond is out of focus in a camera that is sharp on plane C."""

_WHOLE_SHARE = 0.95
_WHOLE_PICTURES = 3
_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class Suggestion:
    """The picture to take next.

    T_camera_board : pose of the board. outline_px : (4, 2) its outline in the picture, from the board's origin round.
    words : what a person can do. std_m : on plane C after it by noise, were the lens right; NaN while there is none.
    """

    T_camera_board: Pose
    outline_px: np.ndarray
    words: str
    std_m: float


def best_next(
    known: LensInformation, plane: WorkPlane, spec: BoardSpec, sensitivity: np.ndarray | None
) -> Suggestion | None:
    """The best of a designed set of poses, then of those near it. None where none shows enough of the board.

    sensitivity : of `plane_sensitivity`; without it the lens as a whole counts.
    """
    aim = np.eye(known.information.shape[0])[None] if sensitivity is None else sensitivity
    # the first pictures find the board and start the lens: all of it has to be seen
    share = _WHOLE_SHARE if known.pictures < _WHOLE_PICTURES else LEAST_SHARE
    limits = NEAREST * plane.distance_m, FURTHEST * plane.distance_m
    best = _best(known, coarse_poses(known.design, spec, *limits), spec, aim, share)
    if best is None:
        return None
    for _ in range(_ROUNDS):
        best = _best(known, [best[0].held, *finer_poses(best[0].held, *limits)], spec, aim, share) or best
    candidate, square = best
    solved = known.solved and sensitivity is not None
    return Suggestion(
        candidate.T_camera_board,
        _outline(known, candidate, spec),
        _pose_words(known.design.camera, candidate.T_camera_board, spec, len(candidate.ids), known.solved),
        known.inflation * float(np.sqrt(square)) if solved else np.nan,
    )


def _best(
    known: LensInformation, held: Sequence[HeldPose], spec: BoardSpec, aim: np.ndarray, share: float
) -> tuple[ViewCandidate, float] | None:
    found = view_candidates(known.design, spec, held, share)
    if not found:
        return None
    poses = np.array([candidate.T_camera_board.vector for candidate in found])
    blocks, _ = view_blocks(known.design, poses, [observation(candidate, spec) for candidate in found])
    squares = mean_square(aim, known.information + blocks)
    return found[int(np.argmin(squares))], float(squares.min())


def _outline(known: LensInformation, candidate: ViewCandidate, spec: BoardSpec) -> np.ndarray:
    """Corners that lie outside the picture, where the lens may fold, by the homography of those inside."""
    points = corner_points(spec)[candidate.ids]
    pixels, _ = known.design.camera.project(candidate.T_camera_board @ points)
    homography, _ = cv2.findHomography(points[:, :2], pixels)
    corners = spec.square_m * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (spec.squares_x, spec.squares_y)
    return cv2.perspectiveTransform(corners[None], homography)[0]


_LEAST_CORNERS = 6
_PLACE, _DISTANCE, _TILT_RAD = 0.12, 0.2, np.radians(15.0)
_SAY = 0.6
_LONG_RAD = np.radians(40.0)


def pose_match(
    suggestion: Suggestion,
    view: BoardView,
    spec: BoardSpec,
    camera: Camera | None,
    image_size: tuple[int, int],
) -> tuple[float, str]:
    """0 to 1, and what to change in words ("further left, nearer"). Above about 0.6 is as good as the pose itself.

    camera : the lens so far; without it a nominal one is known. image_size : (width, height) px of the view.
    """
    if len(view.ids) == 0:
        return 0.0, "the board is not seen"
    points = corner_points(spec)[view.ids]
    if len(view.ids) < _LEAST_CORNERS or not fixes_homography(points[:, :2]):
        return 0.0, "too little of the board is seen"
    camera = camera or camera_of(LENS_MODELS["none"], nominal_intrinsics(image_size), image_size)
    flat, valid = camera.unproject_normalized(view.corners_px)
    ok = valid.sum() >= _LEAST_CORNERS and fixes_homography(points[valid, :2])
    if ok:
        ok, rotvec, shift = cv2.solvePnP(points[valid], flat[valid], np.eye(3), None)
    if not ok or shift[2, 0] <= 0.0:
        return 0.0, "the board is seen at too flat an angle"
    pose = Pose.from_rotvec(rotvec.ravel(), shift.ravel())
    return _compared(seen_as(camera, suggestion.T_camera_board, spec), seen_as(camera, pose, spec))


def _compared(wanted: HeldPose, seen: HeldPose) -> tuple[float, str]:
    across, down = np.subtract(wanted.place, seen.place)
    farther = np.log(wanted.distance_m / seen.distance_m)
    tilt = wanted.tilt_rad * np.exp(1j * wanted.away_rad) - seen.tilt_rad * np.exp(1j * seen.away_rad)
    turn = (wanted.roll_rad - seen.roll_rad + np.pi / 2) % np.pi - np.pi / 2
    parts = [
        (abs(across) / _PLACE, "further right" if across > 0 else "further left"),
        (abs(down) / _PLACE, "lower" if down > 0 else "higher"),
        (abs(farther) / _DISTANCE, "farther away" if farther > 0 else "nearer"),
        (float(abs(tilt)) / _TILT_RAD, tilt_words(wanted)),
        (0.6 * max(abs(turn) / _LONG_RAD - 0.5, 0.0) * 2, "turned by a quarter" if abs(turn) > 1.0 else "less askew"),
    ]
    share = float(1.0 / (1.0 + 0.4 * sum(size**2 for size, _ in parts)))
    said = [words for size, words in sorted(parts, reverse=True) if size > _SAY][:3]
    return share, ", ".join(said) if said else "hold it there"
