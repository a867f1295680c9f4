"""A picture is accepted when the scene is held still, and not otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise

import cv2
import numpy as np
import pytest

from tests.wizard.moving_scenes import SIZE, WALL, antenna_scene, board_scene, filmed
from vbaa_calib.wizard.stillness import ON_A_STAND, Stillness, StillnessDetector, _features_of, motion_px

BOARD = board_scene((0, 0))


def held(gate: StillnessDetector, frames: Iterable[tuple[np.ndarray, float]]) -> list[tuple[float, Stillness]]:
    return [(time_s, gate.feed(image, time_s)) for image, time_s in frames]


def taken(results: list[tuple[float, Stillness]]) -> list[float]:
    return [time_s for time_s, result in results if result.take]


def clock(fps: float, until_s: float) -> np.ndarray:
    return np.arange(0, until_s, 1 / fps)


@pytest.mark.parametrize("fps", [10, 30])
@pytest.mark.parametrize(("noise", "jpeg"), [(1.0, None), (6.0, None), (3.0, 60)])
def test_a_still_scene_gives_one_picture_as_soon_as_it_was_held(fps: int, noise: float, jpeg: int | None) -> None:
    results = held(StillnessDetector(), filmed(lambda _: BOARD, clock(fps, 2.0), noise=noise, jpeg=jpeg))
    (time_s,) = taken(results)
    assert 0.69 <= time_s <= 0.7 + 1.5 / fps
    shares = [result.share for at_s, result in results if at_s <= time_s]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.parametrize("fps", [10, 30])
@pytest.mark.parametrize("speed_px", [1.0, 4.0, 20.0, 67.0])
def test_a_board_that_moves_is_never_taken(fps: int, speed_px: float) -> None:
    """`speed_px` from frame to frame, before a wall that stands still."""

    def scene(time_s: float) -> np.ndarray:
        return board_scene((speed_px * fps * time_s % 200 - 100, 0))

    assert taken(held(StillnessDetector(), filmed(scene, clock(fps, 1.5)))) == []


@pytest.mark.parametrize("fps", [10, 30])
def test_a_board_in_a_hand_is_taken(fps: int) -> None:
    """A tremor of 0.6 px (1 std) of 640, in waves of 0.6 to 8 Hz."""
    rng = np.random.default_rng(4)
    waves_hz = np.array([[0.6], [1.1], [2.3], [3.7], [5.9], [7.7]])
    waves_px = rng.normal(0, 1, (6, 2)) / np.sqrt(waves_hz)
    waves_px *= 0.6 / np.sqrt((waves_px**2).sum() / 2)
    phases = rng.uniform(0, 2 * np.pi, (6, 1))

    def scene(time_s: float) -> np.ndarray:
        return board_scene(tuple((waves_px * np.sin(2 * np.pi * waves_hz * time_s + phases)).sum(axis=0)))

    assert len(taken(held(StillnessDetector(), filmed(scene, clock(fps, 3.0))))) == 1


def test_slow_drift_is_not_a_hold() -> None:
    """Each step is under the limit, the sum is not."""
    frames = filmed(lambda time_s: board_scene((12 * time_s, 0)), clock(30, 2.0), noise=1.0)
    results = held(StillnessDetector(), frames)
    assert max(result.motion_px for _, result in results[1:]) <= 30 / 30
    assert taken(results) == []


@pytest.mark.parametrize("fps", [10, 30])
def test_each_pose_that_is_held_gives_one_picture(fps: int) -> None:
    def scene(time_s: float) -> np.ndarray:
        pose, since_s = divmod(time_s, 1.5)
        return board_scene((60 * pose - 80 + 60 * min(since_s / 0.4, 1), 0), 0.2 * pose)

    times = taken(held(StillnessDetector(), filmed(scene, clock(fps, 4.4))))
    assert [int(time_s / 1.5) for time_s in times] == [0, 1, 2]
    assert all(time_s % 1.5 >= 1.09 for time_s in times)


def test_a_hand_that_passes_or_a_lamp_does_not_make_a_second_picture() -> None:
    def scene(time_s: float) -> np.ndarray:
        picture = BOARD.copy()
        if 1.2 < time_s < 1.7:
            cv2.circle(picture, (int(640 * (time_s - 1.2) / 0.5), 200), 70, 150.0, -1)
        return picture * (0.7 if time_s > 2.8 else 1.0)

    results = held(StillnessDetector(), filmed(scene, clock(20, 4.2)))
    assert len(taken(results)) == 1
    assert "nothing has changed" in results[-1][1].words


def test_a_vibrating_antenna_is_waited_for() -> None:
    """9.3 Hz, dying away: the picture comes when the tip moves by less than a pixel; all else stands."""

    def tip_px(time_s: float) -> float:
        return 12 * np.exp(-1.5 * time_s) * np.cos(2 * np.pi * 9.3 * time_s)

    (time_s,) = taken(
        held(StillnessDetector(ON_A_STAND), filmed(lambda at_s: antenna_scene(tip_px(at_s)), clock(30, 4.0)))
    )
    assert 12 * np.exp(-1.5 * (time_s - 0.7)) < 1.0
    assert time_s < 3.5


def test_a_weight_that_is_hung_on_gives_the_next_picture() -> None:
    def scene(time_s: float) -> np.ndarray:
        picture = antenna_scene(0 if time_s < 1.5 else 8)
        if 1.2 < time_s < 1.7:
            cv2.circle(picture, (500, 200), 60, 150.0, -1)
        return picture

    first, second = taken(held(StillnessDetector(ON_A_STAND), filmed(scene, clock(20, 3.0))))
    assert first < 1.2
    assert second > 2.3


def test_dropped_frames_do_not_hurt_and_jumps_of_time_start_anew() -> None:
    times = clock(30, 2.0)
    kept = np.random.default_rng(3).random(len(times)) > 0.5
    assert len(taken(held(StillnessDetector(), filmed(lambda _: BOARD, times[kept])))) == 1
    few = np.array([0.0, 0.3, 0.6, 0.9])
    assert taken(held(StillnessDetector(), filmed(lambda _: BOARD, few))) == [pytest.approx(0.9)]
    gap = np.concatenate([clock(30, 0.6), 5 + clock(30, 0.6)])
    assert taken(held(StillnessDetector(), filmed(lambda _: BOARD, gap))) == []
    backwards = np.concatenate([clock(30, 0.6), 0.1 + clock(30, 0.6)])
    assert taken(held(StillnessDetector(), filmed(lambda _: BOARD, backwards))) == []
    assert taken(held(StillnessDetector(), filmed(lambda _: BOARD, np.zeros(60)))) == []


def test_another_size_starts_anew() -> None:
    gate = StillnessDetector()
    held(gate, filmed(lambda _: BOARD, clock(10, 0.65)))
    result = gate.feed(np.zeros((240, 320), np.uint8), 0.75)
    assert (result.share, result.take) == (0.0, False)
    assert "size" in result.words


@pytest.mark.parametrize("grey", [0, 90, 255])
def test_where_nothing_is_seen_nothing_is_taken(grey: int) -> None:
    results = held(StillnessDetector(), filmed(lambda _: np.full(SIZE[::-1], float(grey)), clock(10, 1.5), noise=2.0))
    assert taken(results) == []
    assert all(np.isnan(result.motion_px) for _, result in results)
    assert "more light" in results[-1][1].words


def test_a_refused_picture_may_be_taken_again() -> None:
    gate = StillnessDetector()
    assert len(taken(held(gate, filmed(lambda _: BOARD, clock(10, 1.2))))) == 1
    gate.rearm()
    assert len(taken(held(gate, filmed(lambda _: BOARD, 1.2 + clock(10, 1.2))))) == 1


def taken_while_focusing(sharp: Callable[[float], bool]) -> list[tuple[float, Stillness]]:
    """By the corners nothing moves; only the picture's sharpness changes."""
    gate, corners = StillnessDetector(), np.arange(20.0).reshape(10, 2)
    pictures = {True: BOARD.astype(np.uint8), False: cv2.GaussianBlur(BOARD, (0, 0), 2).astype(np.uint8)}
    return [
        (time_s, gate.feed(pictures[sharp(time_s)], time_s, corners, np.arange(10))) for time_s in np.arange(50) / 20
    ]


def test_a_frame_that_is_less_sharp_than_the_hold_s_best_is_not_taken() -> None:
    results = taken_while_focusing(lambda time_s: not 0.62 < time_s < 0.98)
    assert taken(results) == [1.0]
    assert {result.words for time_s, result in results if 0.72 < time_s < 0.98} == {
        "hold still: waiting for a sharp frame"
    }


def test_a_lens_that_stays_refocused_starts_anew() -> None:
    (time_s,) = taken(taken_while_focusing(lambda time_s: time_s < 0.62))
    assert 2.1 < time_s < 2.3


def corner_frames(shift: Callable[[float], float], times_s: np.ndarray) -> list[tuple[float, np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.arange(7), np.arange(5)), axis=-1).reshape(-1, 2) * 30.0 + 100
    frames = []
    for time_s in times_s:
        ids = np.sort(rng.choice(35, 25, replace=False))
        frames.append((float(time_s), grid[ids] + [shift(time_s), 0] + rng.normal(0, 0.05, (25, 2)), ids))
    return frames


@pytest.mark.parametrize(("speed_px_s", "pictures"), [(0.0, 1), (3.0, 1), (15.0, 0), (900.0, 0)])
def test_corners_tell_the_board_s_motion_by_their_ids(speed_px_s: float, pictures: int) -> None:
    """900 px/s is one square of the board from frame to frame, which looks like none. The picture shows less."""
    gate, image = StillnessDetector(), np.clip(WALL, 0, 255).astype(np.uint8)
    results = [
        gate.feed(image, time_s, corners, ids)
        for time_s, corners, ids in corner_frames(lambda time_s: speed_px_s * time_s, clock(30, 1.5))
    ]
    assert sum(result.take for result in results) == pictures
    assert np.median([result.motion_px for result in results[1:]]) == pytest.approx(speed_px_s / 30, abs=0.15)


def test_motion_is_measured() -> None:
    """Against the shift that the scene was made with: within a factor of 2 while small, and never under a half."""
    for shift_px in (0.5, 1.0, 2.0):
        frames = filmed(lambda at_s, px=shift_px: board_scene((px * at_s, 0.0)), np.arange(6.0), noise=2.0)
        looks = [_features_of(image, time_s, None, None) for image, time_s in frames]
        found = [motion_px(here, there) for there, here in pairwise(looks)]
        assert shift_px / 2 < min(found)
        assert max(found) < 2 * shift_px
