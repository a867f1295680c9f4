"""A pose of the board in words that a person can act on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec

from ..camera import Camera
from ..geometry import Pose

_DIRECTIONS = (
    "right edge",
    "lower right corner",
    "lower edge",
    "lower left corner",
    "left edge",
    "upper left corner",
    "upper edge",
    "upper right corner",
)
_FACING_RAD = np.radians(8.0)
_UPRIGHT_RAD = np.radians(60.0)
_WHOLE = 0.95


@dataclass(frozen=True)
class Seen:
    """How a board stands before the camera.

    Attributes
    ----------
    place : (2,) of its middle in the picture, 0 to 1 from the upper left. distance_m : of its middle.
    tilt_rad : between its normal and the line of sight. away_rad : where in the picture it leans back, right 0,
        down π/2. long_rad : its long side's angle in the picture, within ±π/2.
    """

    place: tuple[float, float]
    distance_m: float
    tilt_rad: float
    away_rad: float
    long_rad: float


def seen_as(camera: Camera, T_camera_board: Pose, spec: BoardSpec) -> Seen:
    """What a pose looks like from the camera."""
    half = spec.square_m * np.array([spec.squares_x, spec.squares_y, 0.0]) / 2
    middle = T_camera_board @ half
    distance = float(np.linalg.norm(middle))
    ray = middle / distance
    pixel, valid = camera.project(middle[None])
    flat = camera.matrix[:2, 2] + np.diag(camera.matrix)[:2] * ray[:2] / max(ray[2], 0.05)
    place = (pixel[0] if valid[0] else flat) / (np.array(camera.image_size) - 1)
    normal = T_camera_board.rotation[:, 2]
    cosine = float(normal @ ray)
    lean = -(normal - cosine * ray)
    long_side = T_camera_board.rotation[:, 0 if spec.squares_x >= spec.squares_y else 1]
    angle = float(np.arctan2(long_side[1], long_side[0]))
    return Seen(
        (float(place[0]), float(place[1])),
        distance,
        float(np.arccos(np.clip(abs(cosine), 0.0, 1.0))),
        float(np.arctan2(lean[1], lean[0])),
        float((angle + np.pi / 2) % np.pi - np.pi / 2),
    )


def pose_words(camera: Camera, T_camera_board: Pose, spec: BoardSpec, corners: int, metric: bool) -> str:
    """A pose for the terminal: where, how far, how turned; right and left as the picture shows them.

    corners : how many of the board's are to be seen. metric : whether the distance is known.
    """
    seen = seen_as(camera, T_camera_board, spec)
    parts = [f"board in the {place_words(seen.place)} of the picture"]
    if corners < _WHOLE * spec.corner_count:
        parts[0] += f", partly outside it ({corners} of its {spec.corner_count} corners seen)"
    parts.append(f"{seen.distance_m:.2f} m away" if metric else f"{_size_words(camera, seen, spec)}")
    parts.append(lean_words(seen.tilt_rad, seen.away_rad))
    if abs(seen.long_rad) > _UPRIGHT_RAD:
        parts.append("its long side upright")
    return ", ".join(parts)


def _size_words(camera: Camera, seen: Seen, spec: BoardSpec) -> str:
    size = spec.square_m * np.array([spec.squares_x, spec.squares_y])
    share = np.max(size * np.diag(camera.matrix)[:2] / seen.distance_m / np.array(camera.image_size))
    return f"so near that it fills {100 * min(share, 1.0):.0f} % of the picture's width or height"


def lean_words(tilt_rad: float, away_rad: float) -> str:
    """Which edge is turned away from the camera, and by how much."""
    if tilt_rad < _FACING_RAD:
        return "facing the camera"
    sector = round(away_rad / (np.pi / 4)) % 8
    return f"its {_DIRECTIONS[sector]} turned {5 * round(np.degrees(tilt_rad) / 5)}° away from the camera"


def place_words(place: tuple[float, float]) -> str:
    """ "upper left", "middle", ... of the picture."""
    across = "left" if place[0] < 0.4 else "right" if place[0] > 0.6 else ""
    down = "upper" if place[1] < 0.4 else "lower" if place[1] > 0.6 else ""
    if across and down:
        return f"{down} {across}"
    return across or {"upper": "upper middle", "lower": "lower middle"}.get(down, "middle")
