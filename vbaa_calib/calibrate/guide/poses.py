"""Poses in which a person can hold the board, and the corners that are visible in each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.board_flex import bend
from vbaa_calib.calibrate.lens.bundle import Observation
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose

from .view_uncertainty import LensDesign

_FILLS = (0.9, 0.6, 0.4)
"""Shares of the picture's shorter relative side that the board takes up, near to far."""

_COLUMNS, _LINES = (0.1, 0.3, 0.5, 0.7, 0.9), (0.1, 0.3, 0.5, 0.7, 0.9)
_TILT_RAD = np.radians(38.0)
_TILTS = 8
LEAST_SHARE = 0.35
"""Part of the board's corners that a picture must show."""
_LEAST_CORNERS = 8
_LEAST_MARKER_PX = 18.0
_EDGE_PX = 3.0


@dataclass(frozen=True, eq=False)
class HeldPose:
    """How a board is held before the camera.

    place : (2,) of its middle in the picture, 0 to 1 from the upper left. distance_m : of its middle.
    tilt_rad : between its normal and the line of sight. away_rad : direction in the picture in which it is tilted
        back, right 0, down π/2. roll_rad : about the line of sight, 0 with the board's x to the right; of a pose that
        was seen, its long side's angle in the picture, within ±π/2.
    """

    place: tuple[float, float]
    distance_m: float
    tilt_rad: float
    away_rad: float
    roll_rad: float


@dataclass(frozen=True, eq=False)
class ViewCandidate:
    """A pose of the board, and the ids (N,) of the corners that are visible with all their markers."""

    held: HeldPose
    T_camera_board: Pose
    ids: np.ndarray


def coarse_poses(design: LensDesign, spec: BoardSpec, near_m: float, far_m: float) -> list[HeldPose]:
    """A grid of distances within limits, of places, and of tilts in every direction."""
    size = spec.square_m * np.array([spec.squares_x, spec.squares_y])
    filled_m = np.max(size * design.intrinsics[:2] / np.array(design.image_size))
    distances = sorted({float(np.clip(filled_m / fill, near_m, far_m)) for fill in _FILLS})
    tilts = [(0.0, 0.0)] + [(_TILT_RAD, 2 * np.pi * index / _TILTS) for index in range(_TILTS)]
    return [
        HeldPose((x, y), distance, tilt, away, 0.0)
        for distance in distances
        for x in _COLUMNS
        for y in _LINES
        for tilt, away in tilts
    ]


def finer_poses(best: HeldPose, near_m: float, far_m: float) -> list[HeldPose]:
    """Poses near the best so far: other places, distances and tilts, and a quarter turn."""
    places = [(best.place[0] + dx, best.place[1] + dy) for dx in (-0.08, 0.0, 0.08) for dy in (-0.08, 0.0, 0.08)]
    held = [replace(best, place=place) for place in places]
    for ratio in (0.8, 1.0, 1.25):
        distance = float(np.clip(ratio * best.distance_m, near_m, far_m))
        for tilt in np.radians((0.0, 25.0, 38.0, 50.0)):
            held += [HeldPose(best.place, distance, float(tilt), best.away_rad, roll) for roll in (0.0, np.pi / 2)]
    return held


def view_candidates(
    design: LensDesign, spec: BoardSpec, held: Sequence[HeldPose], share: float = LEAST_SHARE
) -> list[ViewCandidate]:
    """Those poses that show at least a share of the board's corners, none too small or too steep to be read."""
    places = np.array([one.place for one in held]) * (np.array(design.image_size) - 1)
    rays, seen = design.camera.unproject(places)
    kept = [one for one, ok in zip(held, seen.tolist(), strict=True) if ok]
    poses = _poses(kept, rays[seen], spec)
    shown = visible_corners(design.camera, poses, spec)
    least = max(_LEAST_CORNERS, round(share * spec.corner_count))
    return [
        ViewCandidate(one, pose, ids) for one, pose, ids in zip(kept, poses, shown, strict=True) if len(ids) >= least
    ]


def visible_corners(camera: Camera, poses: Sequence[Pose], spec: BoardSpec) -> list[np.ndarray]:
    """Ids (N,) of the corners whose four squares are in the picture, for each T_camera_board.

    None where the board is seen so small or so steeply that its markers cannot be read.
    """
    if not poses:
        return []
    lattice, around = _lattice(spec)
    pixels, valid = camera.project(np.concatenate([pose @ lattice for pose in poses]))
    pixels, valid = pixels.reshape(len(poses), -1, 2), valid.reshape(len(poses), -1)
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels > _EDGE_PX) & (pixels < np.array(camera.image_size) - 1 - _EDGE_PX), axis=-1)
    found = []
    for mask, own in zip((inside & valid)[:, around].all(axis=-1), pixels, strict=True):
        ids = np.flatnonzero(mask)
        readable = len(ids) and _smallest_px(own[around[ids]]) * spec.marker_m / spec.square_m > _LEAST_MARKER_PX
        found.append(ids if readable else ids[:0])
    return found


def _poses(held: Sequence[HeldPose], rays: np.ndarray, spec: BoardSpec) -> list[Pose]:
    """The board's middle on each ray (N, 3), turned to the camera, then tilted and rolled."""
    if not held:
        return []
    across = np.stack([-rays[:, 1], rays[:, 0], np.zeros(len(rays))], axis=1)
    sine = np.linalg.norm(across, axis=1)
    facing = across * (np.arctan2(sine, rays[:, 2]) / np.maximum(sine, 1e-12))[:, None]
    # tilted back towards `away`: the normal, which points away from the viewer, turns the opposite direction
    tilt = np.array([[np.sin(one.away_rad), -np.cos(one.away_rad), 0.0] for one in held])
    tilt *= np.array([one.tilt_rad for one in held])[:, None]
    roll = np.array([[0.0, 0.0, one.roll_rad] for one in held])
    turned = Rotation.from_rotvec(facing) * Rotation.from_rotvec(tilt) * Rotation.from_rotvec(roll)
    half = spec.square_m * np.array([spec.squares_x, spec.squares_y, 0.0]) / 2
    rotations = turned.as_matrix()
    shifts = np.array([one.distance_m for one in held])[:, None] * rays - rotations @ half
    return [Pose(rotation, shift) for rotation, shift in zip(rotations, shifts, strict=True)]


@lru_cache(maxsize=8)
def _lattice(spec: BoardSpec) -> tuple[np.ndarray, np.ndarray]:
    """(m, 3) m all corners of squares, and (corner_count, 4) which lie diagonal to each inner corner."""
    nx, ny = spec.squares_x + 1, spec.squares_y + 1
    x, y = np.meshgrid(np.arange(nx), np.arange(ny))
    lattice = spec.square_m * np.stack([x.ravel(), y.ravel(), np.zeros(nx * ny)], axis=1)
    column, line = np.rint(corner_points(spec)[:, :2] / spec.square_m).astype(int).T
    around = [(line + dy) * nx + column + dx for dy, dx in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    return lattice, np.stack(around, axis=1)


def _smallest_px(around: np.ndarray) -> float:
    """Smallest height, px, of a square: from the diagonals (N, 4, 2) of the four squares around each corner."""
    first, second = around[:, 2] - around[:, 0], around[:, 3] - around[:, 1]
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    sides = np.linalg.norm(around - np.roll(around, 1, axis=1), axis=-1)
    return float((area / sides.max(axis=1)).min() / 2)


def observation(candidate: ViewCandidate, spec: BoardSpec) -> Observation:
    """Its corners, for derivatives alone: their pixels are 0."""
    return Observation(corner_points(spec)[candidate.ids], np.zeros((len(candidate.ids), 2)), bend(spec)[candidate.ids])
