"""Where the antenna ends in a picture, which stretches were not seen, and why."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.profile import measure

from .drawn_lines import SIZE, background, bent, exposed, straight, tube

BEYOND_PX = 6.0
"""The guide ends so far beyond the tip: a whole antenna is known to a few per cent."""


def longer(path_px: np.ndarray, by_px: float = BEYOND_PX) -> np.ndarray:
    ahead = path_px[-1] - path_px[-2]
    return np.vstack([path_px, path_px[-1] + by_px * ahead / np.linalg.norm(ahead)])


def end_of(picture: np.ndarray, guide_px: np.ndarray, width_px: float) -> Centreline:
    line = measure(picture.astype(np.uint8), guide_px, width_px)
    assert line.found, line.reason
    return line


@pytest.mark.parametrize(
    ("width_px", "blur_px"),
    [
        (1.8, 0.6),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in ((2.9, 1.8), (2.9, 0.8), (4.5, 0.8), (7.0, 0.7))),
    ],
)
def test_a_tip_is_found_to_a_fraction_of_a_pixel_with_the_deviation_it_has(width_px: float, blur_px: float) -> None:
    rng = np.random.default_rng(1)
    off, std = [], []
    for angle in (0.0, 7.3, 31.0, 45.0, 62.0, 90.0, 171.0, 233.0):
        path = straight(angle + rng.uniform(-2, 2), 180.0 + rng.uniform(0, 1))
        picture = exposed(background(rng, 3.0) + tube(path, width_px, 90.0, blur_px, cut=True), rng)
        line = end_of(picture, longer(path), width_px)
        assert line.end == "tip"
        ahead = (path[1] - path[0]) / np.linalg.norm(path[1] - path[0])
        off.append((line.end_px - path[1]) @ ahead)
        std.append(line.end_std_px)
    assert np.sqrt(np.mean(np.square(off))) < 0.25
    assert 0.2 < np.sqrt(np.mean((np.array(off) / std) ** 2)) < 1.6


def test_a_bent_line_ends_where_it_ends() -> None:
    rng = np.random.default_rng(2)
    path = bent((40.2, 70.1), 5.0, 35.0)
    line = end_of(exposed(background(rng, 3.0) + tube(path, 3.0, 90.0, cut=True), rng), longer(path), 3.0)
    ahead = (path[-1] - path[-2]) / np.linalg.norm(path[-1] - path[-2])
    assert line.end == "tip"
    assert abs((line.end_px - path[-1]) @ ahead) < 0.4


def hidden_by(picture: np.ndarray, end_px: np.ndarray, reach_px: float, level: float, fade_px: float) -> np.ndarray:
    """A box of one grey level in front of the antenna's last part."""
    box = np.zeros(picture.shape, np.float32)
    low, high = (np.rint(end_px + np.array(away)).astype(int) for away in ([-reach_px, -30.0], [30.0, 30.0]))
    cv2.rectangle(box, low.tolist(), high.tolist(), 1.0, -1)
    box = cv2.GaussianBlur(box, (0, 0), fade_px)
    return picture * (1.0 - box) + level * box


@pytest.mark.parametrize("level", [20.0, 140.0, 230.0])
@pytest.mark.parametrize("reach_px", [6.0, 20.0, 60.0])
def test_what_an_object_hides_is_no_tip(level: float, reach_px: float) -> None:
    rng = np.random.default_rng(4)
    path = straight(3.0)
    whole = background(rng, 3.0) + tube(path, 2.9, 90.0, cut=True)
    line = end_of(exposed(hidden_by(whole, path[1], reach_px, level, 0.8), rng), longer(path), 2.9)
    assert line.end in ("hidden", "unsure")


@pytest.mark.parametrize("radius_px", [3.5, 6.0])
def test_a_ball_is_no_tip(radius_px: float) -> None:
    rng = np.random.default_rng(6)
    path = straight(3.0)
    ball = np.zeros(SIZE, np.float32)
    cv2.circle(ball, np.rint(16 * path[1]).astype(int).tolist(), round(16 * radius_px), 90.0, -1, shift=4)
    whole = np.maximum(tube(path, 2.9, 90.0, cut=True), cv2.GaussianBlur(ball, (0, 0), 0.8))
    assert end_of(exposed(background(rng, 3.0) + whole, rng), longer(path), 2.9).end != "tip"


def test_a_line_that_leaves_the_picture_ends_at_its_border() -> None:
    rng = np.random.default_rng(7)
    path = np.array([[60.0, 100.0], [400.0, 120.0]])
    line = end_of(exposed(background(rng, 3.0) + tube(path, 2.9, 90.0), rng), path, 2.9)
    assert line.end == "border"


WIDTH_PX, BRIGHT = 4.0, 150.0
AXIS = np.stack([np.linspace(40.0, 260.0, 50), np.full(50, 130.0)], axis=1)


def drawn(ground: np.ndarray) -> np.ndarray:
    """A matt antenna of one brightness in front of a ground (H, W)."""
    share = tube(bent((40.0, 130.0), -5.0, 9.0), WIDTH_PX, 1.0)
    return ground * (1.0 - share) + BRIGHT * share
