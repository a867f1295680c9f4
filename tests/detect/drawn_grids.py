"""Chessboards and grids of circles drawn by rays, every sub-pixel's own, through a lens."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from targets.board import Chessboard, CircleGrid, corner_points

CHESSBOARD = Chessboard("chessboard", 9, 6, 0.02)
CIRCLES = CircleGrid("circles", 9, 6, 0.02)
ASYMMETRIC = CircleGrid("asymmetric_circles", 4, 11, 0.014)
SIZE = (640, 480)
MATRIX = np.array([[720.0, 0.0, 315.0], [0.0, 724.0, 244.0], [0.0, 0.0, 1.0]])
DISTORTION = np.array([-0.25, 0.1, 0.0005, -0.0005, 0.0])
_SUBPIXELS = 5


def pose(seed: int, spec: Chessboard | CircleGrid, tilt: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """A rotation vector and a translation, m: the whole board in view, tilted by `tilt` rad in some direction."""
    rng = np.random.default_rng(seed)
    points = corner_points(spec)
    way = rng.uniform(0.0, 2.0 * np.pi)
    turn = cv2.Rodrigues(tilt * np.array([np.cos(way), np.sin(way), 0.0]))[0]
    turn = turn @ cv2.Rodrigues(np.array([0.0, 0.0, rng.uniform(-0.3, 0.3)]))[0]
    distance = 1.5 * float((np.ptp(points[:, :2], axis=0) * MATRIX[0, 0] / SIZE).max())
    shift = np.array([*rng.uniform(-0.06, 0.06, 2) * distance, distance]) - turn @ points.mean(axis=0)
    return cv2.Rodrigues(turn)[0].ravel(), shift


@cache
def _rays() -> np.ndarray:
    pixels = np.stack(np.meshgrid(*map(np.arange, SIZE)), axis=-1).astype(float).reshape(-1, 1, 2)
    return cv2.undistortPointsIter(pixels, MATRIX, DISTORTION, None, None, (3, 40, 1e-9)).reshape(1, -1, 2)


def drawn(
    spec: Chessboard | CircleGrid, rvec: np.ndarray, shift: np.ndarray, blur_px: float = 0.8, radius: float = 0.3
) -> tuple[np.ndarray, np.ndarray]:
    """Grey levels (H, W) float before noise, and the true marks (corner_count, 2) px; radius : of circles by pitch."""
    turn = cv2.Rodrigues(rvec)[0]
    onto = np.linalg.inv(np.stack([turn[:, 0], turn[:, 1], shift], axis=1))
    place = cv2.perspectiveTransform(_rays(), onto)[0].T.reshape(2, *SIZE[::-1]).copy()
    down, across = np.gradient(place, axis=(1, 2))
    offsets = (np.arange(_SUBPIXELS) + 0.5) / _SUBPIXELS - 0.5
    white = 1.0 - np.mean(
        [_black(spec, place + x * across + y * down, radius) for x in offsets for y in offsets], axis=0
    )
    grey = 40.0 + 160.0 * white
    grey = cv2.GaussianBlur(grey, (0, 0), blur_px)
    return grey, cv2.projectPoints(corner_points(spec), rvec, shift, MATRIX, DISTORTION)[0].reshape(-1, 2)


def _black(spec: Chessboard | CircleGrid, place: np.ndarray, radius: float) -> np.ndarray:
    """(H, W) which places (2, H, W) m of the board's plane are black."""
    if isinstance(spec, Chessboard):
        x, y = np.floor(place / spec.square_m).astype(int)
        return (x >= 0) & (y >= 0) & (x < spec.squares_x) & (y < spec.squares_y) & ((x + y) % 2 == 0)
    places, black = spec.lattice[..., None, None], np.zeros(place.shape[1:], bool)
    wide = 2 if spec.type == "asymmetric_circles" else 1
    for offset in range(wide):
        nearest = wide * np.rint((place / spec.spacing_m - offset) / wide) + offset
        on = ((nearest >= places.min(axis=0)) & (nearest <= places.max(axis=0))).all(axis=0)
        black |= on & (((place - spec.spacing_m * nearest) ** 2).sum(axis=0) < (radius * spec.pitch_m) ** 2)
    return black


def picture(grey: np.ndarray, noise: float = 2.0, seed: int = 0) -> np.ndarray:
    return np.clip(np.rint(grey + np.random.default_rng(seed).normal(0.0, noise, grey.shape)), 0, 255).astype(np.uint8)
