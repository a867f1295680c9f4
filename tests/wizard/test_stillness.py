"""A picture is accepted when the scene is held still: small worlds that move, under lamps that flicker."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import cv2
import numpy as np
import pytest

from vbaa_calib.wizard.stillness import ON_A_STAND, StillnessDetector, _Stillness

SIZE = (640, 360)
_BOARD = cv2.aruco.CharucoBoard(
    (8, 6), 0.03, 0.022, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
).generateImage((320, 240), marginSize=5)


_SOFT = cv2.GaussianBlur(np.random.default_rng(7).normal(0, 1, SIZE[::-1]).astype(np.float32), (0, 0), 25)
WALL = 110 + 25 * _SOFT / _SOFT.std()
_NOISE = np.random.default_rng(8).normal(0, 1, (2 * SIZE[1], 2 * SIZE[0])).astype(np.float32)


def board_scene(shift_px: tuple[float, float]) -> np.ndarray:
    """(360, 640) float32: a printed board before a dull wall, moved from the picture's centre."""
    matrix = np.array([[1.0, 0.0, 160.0 + shift_px[0]], [0.0, 1.0, 60.0 + shift_px[1]]])
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
    scene: Callable[[float], np.ndarray], times_s: np.ndarray, noise: float = 3.0, jpeg: int | None = None
) -> Iterator[tuple[np.ndarray, float]]:
    """Frames of `scene(time)`: lamps that flicker by 8 % of their light, sensor noise in grey levels, JPEG."""
    rng = np.random.default_rng(0)
    for time_s in times_s:
        # 100 Hz, seen through a rolling shutter: bands that wander
        phase = 2 * np.pi * (100 * time_s + np.arange(SIZE[1]) / SIZE[1] * 1.3)
        light = (1 + 0.08 * np.sin(phase))[:, None] * (1 + 0.08 * rng.uniform(-1, 1))
        row, column = rng.integers(0, SIZE[1]), rng.integers(0, SIZE[0])
        grain = _NOISE[row : row + SIZE[1], column : column + SIZE[0]]
        picture = scene(float(time_s)) * light + noise * grain
        frame = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
        if jpeg is not None:
            frame = cv2.imdecode(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, jpeg])[1], 0)
        yield frame, float(time_s)


BOARD = board_scene((0, 0))


def held(gate: StillnessDetector, frames: Iterable[tuple[np.ndarray, float]]) -> list[tuple[float, _Stillness]]:
    return [(time_s, gate.feed(image, time_s)) for image, time_s in frames]


def taken(results: list[tuple[float, _Stillness]]) -> list[float]:
    return [time_s for time_s, (_, take, _) in results if take]


def clock(fps: float, until_s: float) -> np.ndarray:
    return np.arange(0, until_s, 1 / fps)


@pytest.mark.parametrize(("fps", "noise", "jpeg"), [(10, 6.0, None), (30, 1.0, None), (30, 3.0, 60)])
def test_a_still_scene_gives_one_picture_as_soon_as_it_was_held(fps: int, noise: float, jpeg: int | None) -> None:
    results = held(StillnessDetector(), filmed(lambda _: BOARD, clock(fps, 2.0), noise=noise, jpeg=jpeg))
    (time_s,) = taken(results)
    assert 0.69 <= time_s <= 0.7 + 1.5 / fps
    shares = [share for at_s, (share, _, _) in results if at_s <= time_s]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.parametrize(("fps", "speed_px"), [(10, 1.0), (10, 67.0), (30, 1.0), (30, 4.0), (30, 20.0)])
def test_a_board_that_moves_is_never_taken(fps: int, speed_px: float) -> None:
    """`speed_px` from frame to frame, before a wall that stands still."""

    def scene(time_s: float) -> np.ndarray:
        return board_scene((speed_px * fps * time_s % 200 - 100, 0))

    assert taken(held(StillnessDetector(), filmed(scene, clock(fps, 1.5)))) == []


def test_a_vibrating_antenna_is_waited_for() -> None:
    """9.3 Hz, dying away: the picture comes when the tip moves by less than a pixel; all else stands."""

    def tip_px(time_s: float) -> float:
        return 12 * np.exp(-1.5 * time_s) * np.cos(2 * np.pi * 9.3 * time_s)

    (time_s,) = taken(
        held(StillnessDetector(ON_A_STAND), filmed(lambda at_s: antenna_scene(tip_px(at_s)), clock(30, 4.0)))
    )
    assert 12 * np.exp(-1.5 * (time_s - 0.7)) < 1.0
    assert time_s < 3.5
