"""Blur, saturation and contrast of drawn views, and which of them are dropped."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.board.view_quality import ViewQuality, measure_quality
from vbaa_calib.detect.quality.screen import screen_views

from .drawn_boards import SPEC, Conditions, drawn, picture, smeared

PIXEL_PX = np.sqrt(1.0 / 12.0)


def view(condition: Conditions, seed: int = 0, motion_px: np.ndarray | None = None) -> BoardView:
    board = drawn(seed, condition)
    board = board if motion_px is None else smeared(board, motion_px)
    return detect_corners(picture(board, seed), SPEC, f"{seed}.png")


def quality(one: BoardView) -> ViewQuality:
    assert one.quality is not None
    return one.quality


@pytest.mark.parametrize(
    "blur_px", [0.4, pytest.param(1.5, marks=pytest.mark.slow), pytest.param(2.5, marks=pytest.mark.slow)]
)
def test_blur_is_measured(blur_px: float) -> None:
    for seed in range(2):
        one = quality(view(Conditions(70, blur_px), seed))
        assert one.blur_px == pytest.approx(2 * (np.hypot(blur_px, PIXEL_PX),), rel=0.12)
        assert one.motion < 1.15
        assert (one.collinear, one.saturated) == (False, 0.0)


def test_blur_does_not_depend_on_exposure_or_noise() -> None:
    for condition in (Conditions(60, 1.0, 2.0, 0.2), Conditions(60, 1.0, 8.0), Conditions(60, 1.0, 0.0)):
        assert quality(view(condition)).mean_blur_px == pytest.approx(np.hypot(1.0, PIXEL_PX), rel=0.1)


def test_motion_is_seen_with_its_direction() -> None:
    """Smeared along one side of the squares: the standard deviation of a box of 8 px is 2.3 px."""
    still = view(Conditions(70, 0.7), 4)
    row = still.corners_px[still.ids < SPEC.squares_x - 1]
    along = (row[-1] - row[0]) / np.linalg.norm(row[-1] - row[0])
    moved = quality(view(Conditions(70, 0.7), 4, 8.0 * along))
    assert moved.blur_px[0] == pytest.approx(np.sqrt(0.7**2 + PIXEL_PX**2 + 64.0 / 12.0), rel=0.15)
    assert moved.blur_px[1] == pytest.approx(np.hypot(0.7, PIXEL_PX), rel=0.35)
    assert abs(along @ [np.cos(moved.direction_rad), np.sin(moved.direction_rad)]) > 0.97
    assert "motion" in moved.blur_in_words


def test_saturation_shows_and_grows_over_the_edges() -> None:
    plain, clipped, flooded = (quality(view(Conditions(60, 0.8, 2.0, exposure))) for exposure in (1.0, 1.6, 4.0))
    assert plain.saturated == 0.0
    assert plain.edge_level == pytest.approx(0.5, abs=0.02)
    assert clipped.saturated > 0.95
    assert clipped.edge_level == pytest.approx(0.5 * 1.6 * 213 / 255, abs=0.06)
    assert flooded.edge_level > 0.9


def test_good_views_stay_and_bad_ones_go_with_their_reason() -> None:
    good = [view(Conditions(60, 0.8), seed) for seed in range(4)]
    few = dataclasses.replace(good[0], ids=good[0].ids[:4], corners_px=good[0].corners_px[:4])
    row = good[1].ids < SPEC.squares_x - 1
    in_row = measure_quality(np.full((400, 400), 128, np.uint8), good[1].ids[row], good[1].corners_px[row], SPEC)
    bad = {
        "4 corners, at least 6 are needed": few,
        "its corners lie (nearly) on a line": dataclasses.replace(good[1], quality=in_row),
        "the board is not found": detect_corners(np.full((50, 50), 255, np.uint8), SPEC),
        "pale, black and white differ by ": view(Conditions(60, 0.8, 2.0, 0.12), 11),
        "overexposed: 100 % of the white": view(Conditions(60, 0.8, 2.0, 3.0), 12),
        "blurred by 5.5 px": dataclasses.replace(
            good[2], quality=dataclasses.replace(quality(good[2]), blur_px=(5.0, 6.0))
        ),
    }
    kept, dropped = screen_views([*good, *bad.values()])
    assert kept == good
    assert [one for one, _ in dropped] == list(bad.values())
    for (_, reason), words in zip(dropped, bad, strict=True):
        assert reason.startswith(words)
