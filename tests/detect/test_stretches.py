"""Which stretch of a drawn antenna was not seen, and why: where it is as bright as its background, and the like."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from vbaa_calib.detect.drawing.overlay import centreline_picture
from vbaa_calib.detect.whisker.antenna import find
from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.detect.whisker.stretches import Cause, explained, stretches, why_lost

from .drawn_lines import SIZE, background, bent, exposed, tube

WIDTH_PX, BRIGHT = 4.0, 150.0
FROM, TO = 130, 180
"""Columns between which something is wrong."""
AXIS = np.stack([np.linspace(40.0, 260.0, 50), np.full(50, 130.0)], axis=1)
WHERE = Corridor(AXIS, 8.0 + 0.9 * (AXIS[:, 0] - 40.0), WIDTH_PX)


def drawn(ground: np.ndarray) -> np.ndarray:
    """A matt antenna of one brightness in front of a ground (H, W)."""
    share = tube(bent((40.0, 130.0), -5.0, 9.0), WIDTH_PX, 1.0)
    return ground * (1.0 - share) + BRIGHT * share


def cloth(level: float) -> Callable[[np.random.Generator], np.ndarray]:
    """A picture with a strip of cloth of this brightness behind the antenna."""

    def picture(rng: np.random.Generator) -> np.ndarray:
        ground = background(rng, 1.0)
        ground[:, FROM:TO] = level
        return drawn(cv2.GaussianBlur(ground, (0, 0), 2.0))

    return picture


def in_front(rng: np.random.Generator) -> np.ndarray:
    """Something dark in front of it."""
    picture = drawn(background(rng, 1.0))
    picture[80:170, FROM:TO] = 75.0
    return picture


def textured(rng: np.random.Generator) -> np.ndarray:
    """A coarse texture over everything there."""
    picture = drawn(background(rng, 1.0))
    picture[:, FROM:TO] += 14.0 * rng.standard_normal((SIZE[0], TO - FROM))
    return picture


@pytest.mark.parametrize(
    ("draw", "cause"),
    [
        (cloth(BRIGHT), Cause.FAINT),
        (cloth(220.0), Cause.REVERSED),
        (in_front, Cause.HIDDEN),
        (textured, Cause.DISTURBED),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_the_stretch_that_fails_is_named_at_its_place(draw: Callable, cause: Cause, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = exposed(draw(rng), rng)
    line = find(image, WHERE)
    parts = stretches(image, line, WHERE)
    (lost,) = [part for part in parts if part.cause is not Cause.SEEN]
    assert lost.cause is cause
    assert lost.path_px[0, 0] == pytest.approx(FROM, abs=6.0)
    assert lost.path_px[-1, 0] == pytest.approx(TO, abs=6.0)
    assert 100 * lost.start == pytest.approx(100 * (FROM - 40) / 215, abs=4.0)
    words, remedy = why_lost(parts)
    assert cause.words in words
    assert remedy == cause.remedy
    # the same, dashed in the picture in a colour of its own
    plain, marked = (centreline_picture(image, line, WHERE, ("",), each) for each in ((), parts))
    changed = np.abs(plain[: 3 * SIZE[0]].astype(int) - marked[: 3 * SIZE[0]]).max(axis=-1) > 25
    assert changed.any() == (cause is not Cause.HIDDEN)


def test_parts_cover_the_antenna_and_a_whole_one_has_nothing_to_explain() -> None:
    rng = np.random.default_rng(5)
    image = exposed(drawn(background(rng, 1.0)), rng)
    line = find(image, WHERE)
    (whole,) = stretches(image, line, WHERE)
    assert (whole.cause, whole.start) == (Cause.SEEN, 0.0)
    assert why_lost([whole]) == ("", "")
    assert explained(line, image, WHERE) is line


def test_an_antenna_that_does_not_show_at_all_is_explained() -> None:
    rng = np.random.default_rng(6)
    image = exposed(drawn(np.full(SIZE, BRIGHT)), rng)
    line = explained(find(image, WHERE), image, WHERE)
    assert not line.found
    assert "0–100 % of its length: not there, or as bright as what lies behind it" in line.reason
