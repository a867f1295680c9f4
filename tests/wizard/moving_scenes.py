"""Small worlds that move, as a camera with noise under flickering lamps would see them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np

SIZE = (640, 360)
_BOARD = cv2.aruco.CharucoBoard(
    (8, 6), 0.03, 0.022, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
).generateImage((320, 240), marginSize=5)


def _wall() -> np.ndarray:
    rng = np.random.default_rng(7)
    wall = cv2.GaussianBlur(rng.normal(0, 1, SIZE[::-1]).astype(np.float32), (0, 0), 25)
    return 110 + 25 * wall / wall.std()


WALL = _wall()
_NOISE = np.random.default_rng(8).normal(0, 1, (2 * SIZE[1], 2 * SIZE[0])).astype(np.float32)


def board_scene(shift_px: tuple[float, float], turn_rad: float = 0.0) -> np.ndarray:
    """(360, 640) float32: a printed board before a dull wall, moved and turned about the picture's centre."""
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    matrix = np.array([[cos, -sin, 0.0], [sin, cos, 0.0]])
    matrix[:, 2] = np.array([320, 180]) + shift_px - matrix[:, :2] @ [160, 120]
    grey = np.full((240, 320), 1.0, np.float32)
    mask = cv2.warpAffine(grey, matrix, SIZE, flags=cv2.INTER_LINEAR)
    board = cv2.warpAffine(20 + 0.65 * _BOARD.astype(np.float32), matrix, SIZE, flags=cv2.INTER_CUBIC)
    return cv2.GaussianBlur(mask * board + (1 - mask) * WALL, (0, 0), 0.8)


def antenna_scene(tip_px: float) -> np.ndarray:
    """(360, 640) float32: a bright antenna clamped at the left of a still board, its tip `tip_px` off."""
    scene = board_scene((0, 0))
    u = np.linspace(100, 575, 60)
    v = 150 + tip_px * ((u - 100) / 475) ** 2
    points = np.round(np.stack([u, v], axis=1) * 16).astype(np.int32)
    dark = scene.astype(np.uint8)
    cv2.polylines(dark, [points], False, 240, 4, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(dark, (0, 0), 0.8).astype(np.float32)


def filmed(
    scene: Callable[[float], np.ndarray],
    times_s: np.ndarray,
    seed: int = 0,
    noise: float = 3.0,
    flicker: float = 0.08,
    jpeg: int | None = None,
) -> Iterator[tuple[np.ndarray, float]]:
    """Frames of `scene(time)`: lamps that flicker by `flicker` of their light, sensor noise in grey levels, JPEG."""
    rng = np.random.default_rng(seed)
    for time_s in times_s:
        # 100 Hz, seen through a rolling shutter: bands that wander
        phase = 2 * np.pi * (100 * time_s + np.arange(SIZE[1]) / SIZE[1] * 1.3)
        light = (1 + flicker * np.sin(phase))[:, None] * (1 + flicker * rng.uniform(-1, 1))
        row, column = rng.integers(0, SIZE[1]), rng.integers(0, SIZE[0])
        grain = _NOISE[row : row + SIZE[1], column : column + SIZE[0]]
        picture = scene(float(time_s)) * light + noise * grain
        frame = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
        if jpeg is not None:
            frame = cv2.imdecode(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, jpeg])[1], 0)
        yield frame, float(time_s)
