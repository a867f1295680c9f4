"""The pose of the board to show next; how well a live picture matches it, and what to change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from targets.board import AprilGrid, BoardWithIds, corner_points
from vbaa_calib.calibrate.lens.board_shape import deformations
from vbaa_calib.calibrate.lens.bundle import BoardCorners
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.calibrate.pose.board_pose import start_poses
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import SolveError
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Pose

from .settings import GuideSettings
from .view_uncertainty import LensInformation, WorkPlane, mean_square, nominal_intrinsics


class _BoardPlace(NamedTuple):
    """Placement of a board relative to the camera."""

    place: tuple[float, float]  # of its middle in the picture, 0 to 1 from the upper left
    distance_m: float  # of its middle
    tilt_rad: float  # between its normal and the line of sight
    away_rad: float  # direction in the picture in which it is tilted back, right 0, down π/2
    # about the line of sight, 0 with the board's x to the right; of a seen pose its long side's, within ±π/2
    roll_rad: float


@dataclass(frozen=True, eq=False)
class Suggestion:
    """The picture to take next."""

    T_camera_board: Pose  # pose of the board
    outline_px: np.ndarray  # (4, 2) its outline in the picture, from the board's origin round
    words: str  # what a person can do
    std_m: float  # on plane C after it, by noise alone; NaN while there is none


def best_next(
    known: LensInformation, plane: WorkPlane, spec: BoardWithIds, sensitivity: np.ndarray | None
) -> Suggestion | None:
    """The most informative pose of a designed set, refined among its neighbours; None where no pose shows enough of
    the board. sensitivity : see `plane_sensitivity`; None: all lens parameters count."""
    aim = np.eye(known.information.shape[0])[None] if sensitivity is None else sensitivity
    # the first pictures find the board and start the lens: all of it has to be seen
    share = GuideSettings.whole_share if known.pictures < GuideSettings.whole_pictures else GuideSettings.least_share
    limits = GuideSettings.nearest * plane.distance_m, GuideSettings.furthest * plane.distance_m
    placed = _coarse_poses(known, spec, *limits)
    candidate, square = None, np.nan
    for _ in range(1 + GuideSettings.rounds):
        found = _view_candidates(known, spec, placed, share)
        if found:
            poses = np.array([pose.vector for _, pose, _ in found])
            blocks, _ = known.view_blocks(poses, [_observation(ids, spec) for *_, ids in found])
            squares = mean_square(aim, known.information + blocks)
            candidate, square = found[int(np.argmin(squares))], float(squares.min())
        if candidate is None:
            return None
        placed = [candidate[0], *_finer_poses(candidate[0], *limits)]
    assert candidate is not None, "there is at least one round"
    _, pose, ids = candidate
    points, camera = corner_points(spec)[ids], known.camera
    # corners outside the picture, where the lens may fold, by the homography of those inside
    homography, _ = cv2.findHomography(points[:, :2], camera.project(pose @ points)[0])
    solved = known.solved and sensitivity is not None
    return Suggestion(
        pose,
        cv2.perspectiveTransform(spec.outline_m[None], homography)[0],
        _pose_words(camera, pose, spec, len(ids), known.solved),
        known.inflation * float(np.sqrt(square)) if solved else np.nan,
    )


def _coarse_poses(known: LensInformation, spec: BoardWithIds, near_m: float, far_m: float) -> list[_BoardPlace]:
    """A grid of poses: distances within limits, places in the picture, tilts in every direction."""
    filled_m = np.max(spec.size_m * known.intrinsics[:2] / np.array(known.image_size))
    distances = sorted({float(np.clip(filled_m / fill, near_m, far_m)) for fill in GuideSettings.fills})
    tilts = [(0.0, 0.0)] + [
        (GuideSettings.tilt_rad, 2 * np.pi * index / GuideSettings.tilts) for index in range(GuideSettings.tilts)
    ]
    places = [(x, y) for x in GuideSettings.places for y in GuideSettings.places]
    return [_BoardPlace(at, far, *tilt, 0.0) for far in distances for at in places for tilt in tilts]


def _finer_poses(best: _BoardPlace, near_m: float, far_m: float) -> list[_BoardPlace]:
    """Poses near the best so far: other places, distances and tilts, and rolled by a quarter turn."""
    places = [(best.place[0] + dx, best.place[1] + dy) for dx in (-0.08, 0.0, 0.08) for dy in (-0.08, 0.0, 0.08)]
    placed = [best._replace(place=place) for place in places]
    for ratio in (0.8, 1.0, 1.25):
        distance = float(np.clip(ratio * best.distance_m, near_m, far_m))
        for tilt in np.radians((0.0, 25.0, 38.0, 50.0)):
            placed += [_BoardPlace(best.place, distance, float(tilt), best.away_rad, roll) for roll in (0.0, np.pi / 2)]
    return placed


def _view_candidates(
    known: LensInformation, spec: BoardWithIds, placed: Sequence[_BoardPlace], share: float = GuideSettings.least_share
) -> list[tuple[_BoardPlace, Pose, np.ndarray]]:
    """Poses T_camera_board in which at least a share of the board's corners is large and flat enough to be detected,
    and the ids (N,) of the corners visible with all their markers."""
    places = np.array([one.place for one in placed]) * (np.array(known.image_size) - 1)
    rays, seen = known.camera.unproject(places)
    kept = [one for one, ok in zip(placed, seen.tolist(), strict=True) if ok]
    poses = _poses(kept, rays[seen], spec)
    visible = visible_corners(known.camera, poses, spec)
    least = max(GuideSettings.least_corners, round(share * spec.corner_count))
    return [one for one in zip(kept, poses, visible, strict=True) if len(one[2]) >= least]


def visible_corners(camera: Camera, poses: Sequence[Pose], spec: BoardWithIds) -> list[np.ndarray]:
    """Per picture the ids (N,) of the corners visible with their four squares, or their tag; none where the markers
    are too small to be decoded."""
    if not poses:
        return []
    lattice, around, marker = _lattice(spec)
    pixels, valid = camera.project(np.concatenate([pose @ lattice for pose in poses]))
    pixels, valid = pixels.reshape(len(poses), -1, 2), valid.reshape(len(poses), -1)
    with np.errstate(invalid="ignore"):
        inside = np.all(
            (pixels > GuideSettings.edge_px) & (pixels < np.array(camera.image_size) - 1 - GuideSettings.edge_px),
            axis=-1,
        )
    found = []
    for mask, own in zip((inside & valid)[:, around].all(axis=-1), pixels, strict=True):
        ids = np.flatnonzero(mask)
        # the smallest height of what is around a corner, from the diagonals of that
        four = own[around[ids]]
        first, second = four[:, 2] - four[:, 0], four[:, 3] - four[:, 1]
        area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
        sides = np.linalg.norm(four - np.roll(four, 1, axis=1), axis=-1)
        smallest_px = float((area / sides.max(axis=1)).min()) if len(ids) else 0.0
        found.append(ids if smallest_px * marker > GuideSettings.least_module_px * spec.modules else ids[:0])
    return found


def _poses(placed: Sequence[_BoardPlace], rays: np.ndarray, spec: BoardWithIds) -> list[Pose]:
    """Poses with the board's middle on each ray (N, 3), facing the camera, then tilted and rolled."""
    if not placed:
        return []
    across = np.stack([-rays[:, 1], rays[:, 0], np.zeros(len(rays))], axis=1)
    sine = np.linalg.norm(across, axis=1)
    facing = across * (np.arctan2(sine, rays[:, 2]) / np.maximum(sine, 1e-12))[:, None]
    # tilted back towards `away`: the normal, which points away from the viewer, turns the opposite direction
    tilt = np.array([[np.sin(one.away_rad), -np.cos(one.away_rad), 0.0] for one in placed])
    tilt *= np.array([one.tilt_rad for one in placed])[:, None]
    roll = np.array([[0.0, 0.0, one.roll_rad] for one in placed])
    rotations = _turns(facing) @ _turns(tilt) @ _turns(roll)
    shifts = np.array([one.distance_m for one in placed])[:, None] * rays - rotations @ _middle(spec)
    return [Pose(rotation, shift) for rotation, shift in zip(rotations, shifts, strict=True)]


def _turns(rotvecs_rad: np.ndarray) -> np.ndarray:
    """(N, 3, 3) rotations of rotation vectors (N, 3)."""
    return np.array([Pose.from_rotvec(one, np.zeros(3)).rotation for one in rotvecs_rad])


def _middle(spec: BoardWithIds) -> np.ndarray:
    """(3,) the middle of the print in the board frame, m."""
    return np.append(spec.outline_m.mean(axis=0), 0.0)


@lru_cache(maxsize=8)
def _lattice(spec: BoardWithIds) -> tuple[np.ndarray, np.ndarray, float]:
    """(m, 3) m all corners of squares; (corner_count, 4) indices of those diagonal to each inner corner (for an
    AprilGrid those of its tag); and the ratio of a marker's side to the side of the quadrilateral around it."""
    if isinstance(spec, AprilGrid):
        line, column = np.divmod(np.arange(spec.corner_count), spec.corner_columns)
        first = (line - line % 2) * spec.corner_columns + column - column % 2
        across = np.array([0, 1, spec.corner_columns + 1, spec.corner_columns])
        return corner_points(spec), first[:, None] + across, 1.0
    nx, ny = spec.squares_x + 1, spec.squares_y + 1
    x, y = np.meshgrid(np.arange(nx), np.arange(ny))
    lattice = spec.square_m * np.stack([x.ravel(), y.ravel(), np.zeros(nx * ny)], axis=1)
    column, line = np.rint(corner_points(spec)[:, :2] / spec.square_m).astype(int).T
    around = [(line + dy) * nx + column + dx for dy, dx in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    return lattice, np.stack(around, axis=1), spec.marker_m / spec.square_m / 2.0


def _observation(ids: np.ndarray, spec: BoardWithIds) -> BoardCorners:
    """Corners of these ids (N,) with pixels 0, for derivatives alone."""
    return BoardCorners(corner_points(spec)[ids], np.zeros((len(ids), 2)), deformations(corner_points(spec))[ids])


def _seen_as(camera: Camera, T_camera_board: Pose, spec: BoardWithIds) -> _BoardPlace:
    """Place, distance and tilt of a board's pose relative to the camera."""
    middle = T_camera_board @ _middle(spec)
    distance = float(np.linalg.norm(middle))
    ray = middle / distance
    pixel, valid = camera.project(middle[None])
    flat = camera.matrix[:2, 2] + np.diag(camera.matrix)[:2] * ray[:2] / max(ray[2], 0.05)
    x, y = (pixel[0] if valid[0] else flat) / (np.array(camera.image_size) - 1)
    normal = T_camera_board.rotation[:, 2]
    cosine = float(normal @ ray)
    across, down, _ = -(normal - cosine * ray)
    long_side = T_camera_board.rotation[:, 0 if spec.size_m[0] >= spec.size_m[1] else 1]
    angle = float(np.arctan2(long_side[1], long_side[0]))
    tilt, away = float(np.arccos(np.clip(abs(cosine), 0.0, 1.0))), float(np.arctan2(down, across))
    return _BoardPlace((float(x), float(y)), distance, tilt, away, float((angle + np.pi / 2) % np.pi - np.pi / 2))


def _pose_words(camera: Camera, T_camera_board: Pose, spec: BoardWithIds, corners: int, metric: bool) -> str:
    """A pose in words, for the terminal. corners : number of corners to be visible. metric : whether the distance is
    known."""
    seen = _seen_as(camera, T_camera_board, spec)
    across = "left" if seen.place[0] < 0.4 else "right" if seen.place[0] > 0.6 else "middle"
    down = "upper " if seen.place[1] < 0.4 else "lower " if seen.place[1] > 0.6 else ""
    parts = [f"board in the {down}{across} of the picture"]
    if corners < GuideSettings.whole_share * spec.corner_count:
        parts[0] += f", partly outside it ({corners} of its {spec.corner_count} corners seen)"
    if metric:
        parts.append(f"{seen.distance_m:.2f} m away")
    else:
        filled = np.diag(camera.matrix)[:2] / np.array(camera.image_size)
        share = np.max(spec.size_m * filled) / seen.distance_m
        parts.append(f"so near that it fills {100 * min(share, 1.0):.0f} % of the picture's width or height")
    upright = ["its long side upright"] if abs(seen.roll_rad) > GuideSettings.upright_rad else []
    return ", ".join([*parts, _tilt_words(seen), *upright])


def _tilt_words(placed: _BoardPlace) -> str:
    """Which edge is turned away from the camera, and by how much."""
    if placed.tilt_rad < GuideSettings.facing_rad:
        return "facing the camera"
    sides = ("right", "lower right", "lower", "lower left", "left", "upper left", "upper", "upper right")
    side, tilt_deg = sides[round(placed.away_rad / (np.pi / 4)) % 8], 5 * round(np.degrees(placed.tilt_rad) / 5)
    return f"its {side} {'corner' if ' ' in side else 'edge'} turned {tilt_deg}° away from the camera"


def pose_match(suggestion: Suggestion, view: BoardView, spec: BoardWithIds, camera: Camera | None) -> tuple[float, str]:
    """Similarity of a view to the suggested pose, from 0 to 1 (above about 0.6 it is as informative), and what to
    change, in words ("further left, nearer").

    camera : the lens so far; without it a nominal one counts.
    """
    if len(view.ids) == 0:
        return 0.0, "the board is not seen"
    points = corner_points(spec)[view.ids]
    if len(view.ids) < GuideSettings.match_corners or not fixes_homography(points[:, :2]):
        return 0.0, "too little of the board is seen"
    camera = camera or camera_of(LENS_MODELS["none"], nominal_intrinsics(view.image_size), view.image_size)
    flat, valid = camera.unproject_normalized(view.corners_px)
    try:
        poses = start_poses(points[valid], flat[valid]) if fixes_homography(points[valid, :2]) else []
    except SolveError:
        poses = []
    if valid.sum() < GuideSettings.match_corners or not poses:
        return 0.0, "the board is seen at too flat an angle"
    wanted = _seen_as(camera, suggestion.T_camera_board, spec)
    seen = _seen_as(camera, poses[0], spec)
    across, down = np.subtract(wanted.place, seen.place)
    farther = np.log(wanted.distance_m / seen.distance_m)
    tilt = wanted.tilt_rad * np.exp(1j * wanted.away_rad) - seen.tilt_rad * np.exp(1j * seen.away_rad)
    turn = (wanted.roll_rad - seen.roll_rad + np.pi / 2) % np.pi - np.pi / 2
    parts = [
        (abs(across) / GuideSettings.place_off, "further right" if across > 0 else "further left"),
        (abs(down) / GuideSettings.place_off, "lower" if down > 0 else "higher"),
        (abs(farther) / GuideSettings.distance_off, "farther away" if farther > 0 else "nearer"),
        (float(abs(tilt)) / GuideSettings.tilt_off_rad, _tilt_words(wanted)),
        (
            1.2 * max(abs(turn) / GuideSettings.roll_off_rad - 0.5, 0.0),
            "turned by a quarter" if abs(turn) > 1.0 else "less askew",
        ),
    ]
    share = float(1.0 / (1.0 + 0.4 * sum(size**2 for size, _ in parts)))
    changes = [words for size, words in sorted(parts, reverse=True) if size > GuideSettings.mentioned][:3]
    return share, ", ".join(changes) or "hold it there"
