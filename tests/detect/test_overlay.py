"""The debug picture of what was seen in one picture, whatever the verdict."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from vbaa_calib.detect.drawing.overlay import (
    HIDDEN,
    OTHER_LINE,
    OUTSIDE,
    background,
    centreline_picture,
    corridor_mask,
    described,
    sigma_colours,
)
from vbaa_calib.detect.whisker.antenna import find
from vbaa_calib.detect.whisker.centreline import NOTHING, Centreline, EndKind, Verdict, Visibility
from vbaa_calib.detect.whisker.corridor import Corridor

from .drawn_lines import SIZE, exposed, straight, tube
from .drawn_lines import background as scene

AXIS = np.stack([np.linspace(40.0, 280.0, 25), np.full(25, 120.0)], axis=1)
WHERE = Corridor(AXIS, 8.0 + 0.9 * (AXIS[:, 0] - 40.0), 4.0)


def line_of(verdict: Verdict = "ok", end: EndKind = "tip", visibility: Visibility = Visibility.HIDDEN) -> Centreline:
    """A centreline of which the second third has that visibility."""
    guide = np.stack([np.linspace(40.0, 280.0, 241), np.linspace(120.0, 90.0, 241)], axis=1)
    seen = np.full(241, Visibility.SEEN, np.uint8)
    seen[80:160] = visibility
    kept = seen == Visibility.SEEN
    return Centreline(
        points_px=guide[kept],
        sigma_px=np.full(int(kept.sum()), 0.05),
        seen=float(kept.mean()),
        amplitude=80.0,
        breadth=1.5,
        verdict=verdict,
        reason="" if verdict == "ok" else f"words about {verdict}",
        guide_px=guide,
        visibility=seen,
        end_px=guide[-1],
        end=end,
        other_line_px=guide + np.array([0.0, 60.0]) if verdict == "ambiguous" else np.empty((0, 2)),
        noise=2.0,
    )


def has(image: np.ndarray, colour: tuple[int, int, int]) -> bool:
    """Whether a drawn picture has this colour above its legend."""
    return bool((np.abs(image[: 3 * SIZE[0]].astype(int) - np.array(colour)).max(axis=-1) < 25).any())


@pytest.mark.parametrize("verdict", get_args(Verdict))
@pytest.mark.parametrize("visibility", [Visibility.HIDDEN, Visibility.OUTSIDE])
def test_every_verdict_is_drawn_with_what_is_not_seen(verdict: Verdict, visibility: Visibility) -> None:
    line = line_of(verdict, visibility=visibility)
    drawn = centreline_picture(np.full(SIZE, 60, np.uint8), line, WHERE, ("a picture", "a note"))
    assert drawn.shape[1] == 3 * SIZE[1]
    assert has(drawn, HIDDEN if visibility == Visibility.HIDDEN else OUTSIDE)
    assert has(drawn, OTHER_LINE) == (verdict == "ambiguous")


def test_nothing_found_and_no_corridor() -> None:
    assert centreline_picture(np.zeros(SIZE, np.uint8), NOTHING, None, ("",)).shape[1] == 3 * SIZE[1]
    assert described(NOTHING) == "no point of the antenna was measured"


def test_numbers_in_words() -> None:
    said = described(line_of())
    for words in (
        "visible end at (280.0, 90.0) px: tip",
        "67 % of its length seen, 161 points; std across it 0.050 px",
        "33 % not seen between seen parts",
        "1.5 times as broad as in focus",
    ):
        assert words in said
    assert "visible end" not in described(line_of(end="none"))


def test_a_real_picture_is_marked_along_the_antenna() -> None:
    rng = np.random.default_rng(3)
    ends = straight(0.0, 240.0, (160.0, 120.0))
    image = exposed(scene(rng) + tube(ends, 4.0, 80.0), rng)
    drawn = centreline_picture(image, find(image, WHERE), WHERE, ("",)).astype(int)
    row = drawn[3 * 120 + 1, 3 * 60 : 3 * 260]
    assert (row[:, 0] - row[:, 2] > 150).mean() > 0.95


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_background_is_dark_and_darker_outside_the_corridor(kind: type) -> None:
    image = (np.random.default_rng(0).uniform(0.2, 1.0, SIZE) * 200).astype(kind)
    grey, inside = background(image, WHERE), corridor_mask(WHERE, (SIZE[1], SIZE[0])) > 0
    assert grey.max() <= 150
    assert grey[inside].mean() > 1.8 * grey[~inside].mean()
    assert inside[120, 45:275].all()
    assert not inside[:, :39].any()


def test_background_of_a_picture_without_contrast_is_not_all_noise() -> None:
    flat = np.random.default_rng(0).normal(90.0, 1.0, SIZE).astype(np.float32)
    flat[5, 5] = np.nan
    assert background(flat, None).std() < 15.0


def test_colours_of_deviations_go_one_way() -> None:
    colours = sigma_colours(np.array([0.0, 0.02, 0.05, 0.1, 0.5, 9.0, np.nan])).astype(int)
    assert (np.diff(colours[:, 1]) <= 0).all()
    assert (colours[0].tolist(), colours[-1].tolist()) == ([255, 255, 0], [255, 0, 255])
