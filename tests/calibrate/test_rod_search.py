"""Rods in drawn pictures: any colour and width, clutter, shadow, two of them, mirrored, none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from vbaa_calib.calibrate.photo.centreline import RodLine, search_rod
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.polyline import offsets_from

Colour = tuple[float, float, float]
GREY: Colour = (120.0, 120.0, 120.0)


def bow(turn: float = 0.9, length: float = 420.0, start: tuple[float, float] = (-20.0, 130.0)) -> np.ndarray:
    """(N, 2) a line from the left border that turns down evenly."""
    angle = np.linspace(0.0, turn, 800)
    steps = np.stack([np.cos(angle), np.sin(angle)], axis=1) * length / len(angle)
    return np.cumsum(steps, axis=0) + start


def painted(lines: list[tuple[np.ndarray, float, Colour]], ground: Colour = GREY, seed: int = 0) -> np.ndarray:
    """(400, 520, 3) lines of a width and colour, the last one in front, with noise."""
    picture = np.full((1600, 2080, 3), ground, np.float32)
    for line, width, colour in lines:
        cv2.polylines(picture, [np.rint(4.0 * line + 1.5).astype(np.int32)], False, colour, max(1, round(4.0 * width)))
    small = cv2.resize(picture, (520, 400), interpolation=cv2.INTER_AREA)
    noisy = small + np.random.default_rng(seed).normal(0.0, 3.0, small.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def apart(found: RodLine, line: np.ndarray) -> float:
    """How far the found line is off at most, but for its ends."""
    inner = found.curve_px[len(found.curve_px) // 20 : -len(found.curve_px) // 20]
    return float(np.abs(offsets_from(line, inner)[1]).max())


@pytest.mark.parametrize(
    ("colour", "ground"),
    [
        ((230, 230, 230), GREY),
        ((20, 20, 20), GREY),
        ((60, 120, 200), (90, 150, 100)),  # as bright as what is behind it
    ],
)
def test_any_colour_is_found(colour: Colour, ground: Colour) -> None:
    line = bow()
    found = search_rod(painted([(line, 9.0, colour)], ground)).line()
    assert apart(found, line) < 1.0
    assert found.curve_px[0, 0] < 2.0
    assert np.hypot(*(found.curve_px[-1] - line[-1])) < 9.0
    assert found.tip_inside


def test_a_rod_is_found_among_things_if_its_ends_are_known() -> None:
    line, rng = bow(), np.random.default_rng(3)
    picture = painted([(line, 8.0, (230, 230, 230))], seed=3)
    for _ in range(25):
        u, v, wide, high = rng.integers((0, 250, 10, 10), (450, 350, 60, 50))
        if not np.any(np.all((line > [u - 12, v - 12]) & (line < [u + wide + 12, v + high + 12]), axis=1)):
            cv2.rectangle(
                picture, (int(u), int(v)), (int(u + wide), int(v + high)), rng.integers(0, 255, 3).tolist(), -1
            )
    assert apart(search_rod(picture, np.array([2.0, 130.0]), line[-1]).line(), line) < 1.0


def test_of_two_rods_the_one_that_is_clicked_is_found() -> None:
    line = bow(1.2)[100:]
    chord = line[-1] - line[0]
    other = 2.0 * (line[0] + np.outer((line - line[0]) @ chord, chord) / (chord @ chord)) - line + [0.0, 11.0]
    picture = painted([(line, 5.0, (170.0, 170.0, 170.0)), (other, 5.0, (240.0, 240.0, 240.0))])
    assert apart(search_rod(picture, line[0], line[-1]).line(), line) < 1.0


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_found_where_nothing_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    clouds = cv2.GaussianBlur(rng.normal(0.0, 1.0, (300, 400, 3)), (0, 0), 2.0 + 6.0 * seed)
    picture = np.clip(128.0 + 40.0 * clouds / clouds.std() + rng.normal(0.0, 4.0, clouds.shape), 0, 255)
    with pytest.raises(InputError, match="no rod"):
        search_rod(picture.astype(np.uint8)).line()


def test_a_rod_that_is_hidden_between_its_ends_is_refused() -> None:
    line = bow()
    picture = painted([(line, 9.0, (230, 230, 230))])
    picture[:, 150:260] = 120
    with pytest.raises(InputError, match=r"interrupted|no rod"):
        search_rod(picture, np.array([2.0, 130.0]), line[-1]).line()


def test_a_rod_that_another_crosses_is_found_between_its_ends() -> None:
    line, other = bow(), np.array([[150.0, -20.0], [200.0, 420.0]])
    picture = painted([(line, 9.0, (230, 230, 230)), (other, 36.0, (40, 60, 160))])
    assert apart(search_rod(picture, np.array([2.0, 130.0]), line[-1]).line(), line) < 1.0


def test_an_end_that_something_covers_is_no_tip_unless_it_is_known() -> None:
    line = bow()
    picture = painted([(line, 9.0, (230, 230, 230))])
    u, v = line[-1].astype(int)
    cv2.rectangle(picture, (u - 30, v - 5), (u + 30, v + 50), (30, 60, 90), -1)
    search = search_rod(picture)
    assert apart(search.line(), line[line[:, 1] < v - 5]) < 1.0
    assert not search.line().tip_inside
    assert search.line(1).tip_inside


def test_a_rod_of_two_colours_along_it_is_one_rod() -> None:
    line = bow()
    across = np.gradient(line, axis=0)[:, ::-1] * [-1.0, 1.0]
    across /= np.hypot(*across.T)[:, None]
    halves = [(line + side * 4.0 * across, 8.0, colour) for side, colour in ((1, (40, 200, 220)), (-1, (60, 110, 20)))]
    found = search_rod(painted(halves)).line()
    assert apart(found, line) < 1.0
    assert found.width_px == pytest.approx(16.0, abs=2.0)
