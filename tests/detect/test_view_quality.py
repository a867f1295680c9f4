"""Blur, light and reflections of drawn views: measured, explained, and what is dropped for them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from targets.board import AprilGrid, BoardSpec, BoardWithIds
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.board.view_quality import ViewQuality, measure_quality
from vbaa_calib.detect.quality.hints import _blur_ellipse as blur_ellipse
from vbaa_calib.detect.quality.hints import picture_hints
from vbaa_calib.detect.quality.screen import screen_views

from .drawn_boards import GOOD, SPEC, Conditions, DrawnBoard, drawn, picture, smeared

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


LEGACY = BoardSpec(6, 4, 0.02, 0.014, legacy_pattern=True)
COARSE = BoardSpec(7, 5, 0.02, 0.016)
GRID = AprilGrid("aprilgrid", 4, 3, 0.02, 0.3)


def hints(image: np.ndarray, spec: BoardWithIds = SPEC) -> list[Diagnosis]:
    return picture_hints(image, detect_corners(image, spec, "picture"), spec)


def names(found: list[Diagnosis]) -> list[str]:
    return [one.name for one in found]


def the_one(found: list[Diagnosis], name: str) -> Diagnosis:
    assert name in names(found), [str(one) for one in found]
    return next(one for one in found if one.name == name)


def lit_up(board: DrawnBoard, where_px: np.ndarray, radius_px: float) -> DrawnBoard:
    """A lamp's reflection: a patch that is clipped, with a soft rim."""
    v, u = np.indices(board.grey.shape)
    apart = np.hypot(u - where_px[0], v - where_px[1]) / radius_px
    return dataclasses.replace(board, grey=board.grey + 300.0 * np.exp(-(apart**4)))


@pytest.mark.parametrize("spec", [SPEC, LEGACY, GRID])
@pytest.mark.parametrize(
    "conditions", [GOOD, Conditions(30, 0.5, 3.0), Conditions(70, 1.4), Conditions(55, 0.6, 2, 1.3)]
)
def test_good_pictures_are_not_found_fault_with(conditions: Conditions, spec: BoardWithIds) -> None:
    assert hints(picture(drawn(1, conditions, spec)), spec) == []


@pytest.mark.parametrize("spec", [SPEC, LEGACY, GRID])
@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 45.0, 90.0, 135.0])
def test_motion_is_told_from_focus_with_direction_and_length(angle_deg: float, spec: BoardWithIds) -> None:
    """In any direction: along the squares' diagonals too, where their edges are blurred alike."""
    angle, length = np.radians(angle_deg), 8.0
    words = ("sideways", "along the diagonal \\", "up or down", "along the diagonal /")
    taken = Conditions(110, 0.8) if spec is GRID else GOOD
    image = picture(smeared(drawn(1, taken, spec), length * np.array([np.cos(angle), np.sin(angle)])))
    view = detect_corners(image, spec)
    long_px, short_px, direction_rad = blur_ellipse(image, view, spec)
    off = (direction_rad - angle + np.pi / 2) % np.pi - np.pi / 2
    assert abs(off) < np.radians(12.0)
    assert long_px > 1.8 * short_px
    found = the_one(picture_hints(image, view, spec), "motion_blur")
    if angle_deg % 45.0 == 0.0:
        assert words[round(angle_deg / 45.0) % 4] in found.words
    assert int(found.words.split(" px")[0].split()[-1]) == pytest.approx(length, abs=2.0)


def test_blur_out_of_focus_is_no_motion() -> None:
    """While corners are found by their own edges, beyond that by those of the whole picture."""
    view_hints = hints(picture(drawn(1, Conditions(40, 2.0, 0.5), COARSE)), COARSE)
    assert names(view_hints) == ["out_of_focus"]
    assert "blurred by 2." in view_hints[0].words
    lost = hints(picture(drawn(1, Conditions(40, 3.6))))
    assert the_one(lost, "out_of_focus").grave
    assert "motion_blur" not in names(lost)


@pytest.mark.parametrize("radius_px", [60.0, 100.0])
def test_a_reflection_is_found_with_its_place(radius_px: float) -> None:
    board = drawn(1)
    low, high = board.corners_px.min(axis=0), board.corners_px.max(axis=0)
    for side in np.ndindex(2, 2):
        centre = low + (high - low) * (0.2 + 0.6 * np.array(side))
        nearest = board.corners_px[np.argmin(np.linalg.norm(board.corners_px - centre, axis=1))]
        words = the_one(hints(picture(lit_up(board, nearest, radius_px))), "reflection").words
        sides = (("left",), ("right",))[side[0]] + (("upper", "top"), ("lower", "bottom"))[side[1]]
        assert any(word in words for word in sides)
        assert ("right", "left")[side[0]] not in words
