"""The scale of a print from two readings: what it says, how sure it is, what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from targets.board import BoardSpec
from targets.print_scale import MOST_ASPECT, SIGNIFICANT, print_scale, rescaled

SPEC = BoardSpec(11, 7, 0.020, 0.015, thickness_m=0.003)


def test_deviations_against_sampling() -> None:
    """Scatter of scale and aspect over readings with noise, against what is predicted for one of them."""
    rng = np.random.default_rng(3)
    true = 0.997
    drawn = [
        print_scale(260, true * 260 + noise_x, 150, true * 150 + noise_y)
        for noise_x, noise_y in rng.normal(0, 0.25, (4000, 2))
    ]
    one = print_scale(260, true * 260, 150, true * 150)
    together = [each for each in drawn if not each.differs]
    assert np.std([each.scale for each in together]) == pytest.approx(one.std, rel=0.05)
    assert np.mean([each.scale for each in together]) == pytest.approx(true, abs=4 * one.std / math.sqrt(4000))
    assert np.std([each.aspect for each in drawn]) == pytest.approx(one.aspect_std, rel=0.05)
    # square prints are called different as seldom as three deviations say: 0.27 %, ± 3 deviations of the count
    assert sum(each.differs for each in drawn) == pytest.approx(4000 * 0.0027, abs=10)


def test_the_longer_ruler_weighs_more() -> None:
    """By the square of its length."""
    scale = print_scale(200, 200.0, 100, 100.3)
    assert (scale.std_x, scale.std_y) == pytest.approx((0.25 / 200, 0.25 / 100))
    assert scale.scale == pytest.approx((4 * 1.0 + 1 * 1.003) / 5)
    # and squares that may be a tenth of a per cent out of square leave half of it open
    assert scale.std == pytest.approx(math.hypot(0.25 / math.hypot(200, 100), MOST_ASPECT / 2))
    assert not scale.differs


def test_axes_that_differ_are_no_board() -> None:
    """Beyond the readings' doubt and beyond what matters; then there is no common scale, only words."""
    scale = print_scale(260, 260.0, 150, 148.5)
    assert scale.differs
    assert scale.aspect == pytest.approx(260 / 260 / (148.5 / 150) - 1)
    assert math.isnan(scale.scale)
    assert math.isnan(scale.std)
    assert "axes differ by 1.01 ± 0.20 %" in scale.words
    assert "print it again" in scale.remedy
    with pytest.raises(ValueError, match="axes differ"):
        rescaled(SPEC, scale)


def test_a_caliper_sees_what_a_ruler_does_not() -> None:
    """The same readings, judged by how good they are; and a difference that does not matter is let pass."""
    readings = (150, 150.0, 150, 149.6)
    assert not print_scale(*readings).differs
    assert print_scale(*readings, reading_std_mm=0.03).differs
    tiny = print_scale(150, 150.0, 150, 150 * (1 - 0.9 * MOST_ASPECT), reading_std_mm=0.005)
    assert abs(tiny.aspect) > SIGNIFICANT * tiny.aspect_std
    assert not tiny.differs


def test_the_board_as_it_was_printed() -> None:
    """Squares and markers follow the scale, the mount does not."""
    scale = print_scale(260, 252.2, 150, 145.5)
    board = rescaled(SPEC, scale)
    assert board.square_m == pytest.approx(0.020 * 0.97, abs=1e-9)
    assert board.marker_m == pytest.approx(0.015 * 0.97, abs=1e-9)
    assert (board.thickness_m, board.squares_x, board.dictionary) == (0.003, 11, "DICT_4X4_100")
    assert "fitted it to the page" in scale.remedy
    assert rescaled(SPEC, print_scale(260, 260, 150, 150)) == SPEC


def test_words_say_what_the_readings_are_worth() -> None:
    """Lengths and what would not show, from the same deviations."""
    scale = print_scale(200, 200.0, 200, 200.0)
    assert "100.00 ± 0.09 %" in scale.words
    assert "lengths of 240 mm are known to 0.21 mm" in scale.words
    assert "a difference of the axes below 0.5 % would not show" in scale.words
    assert scale.remedy == "go on with the size as measured"
    assert "longer stretch" in print_scale(60, 60, 60, 60).remedy


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ((260, 26.0, 150, 15.0), "centimetres were read, it seems, 260 mm would do"),
        ((260, 260.0, 150, 14.9), "reading_y_mm is 14.9 where about 150 is expected: centimetres"),
        ((254, 10.0, 150, 150.0), "inches were read, it seems, 254 mm would do"),
        ((260, 0.26, 150, 0.15), "metres were read"),
        ((260, 2600.0, 150, 150.0), "a digit too many"),
        ((260, 150.0, 150, 260.0), "they are exchanged, it seems"),
        ((260, 1000.0, 150, 150.0), "read it again, in mm"),
        ((260, 0.0, 150, 150.0), "reading_x_mm is 0.0"),
        ((260, -260.0, 150, 150.0), "reading_x_mm is -260.0"),
        ((260, 260.0, 150, float("nan")), "reading_y_mm is nan"),
        ((260, float("inf"), 150, 150.0), "reading_x_mm is inf"),
        ((0, 260.0, 150, 150.0), "ruler_x_mm is 0"),
        ((260, 260.0, float("nan"), 150.0), "ruler_y_mm is nan"),
        ((260, 260.0, 20, 20.0), "measure over 25 mm or more"),
        ((260, 260.0, 150, 150.0, 0.0), "reading_std_mm is 0.0"),
        ((260, 260.0, 150, 150.0, float("nan")), "reading_std_mm is nan"),
        ((260, 260.0, 150, 150.0, 7.0), "reading_std_mm is 7.0"),
    ],
)
def test_senseless_readings_are_refused(call: tuple[float, ...], words: str) -> None:
    """Each with what it seems to be."""
    with pytest.raises(ValueError, match=words):
        print_scale(*call)
