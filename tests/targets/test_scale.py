"""The scale of a print from two readings: what it says, how sure it is, what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from targets.board import BoardSpec
from targets.print_scale import print_scale, rescaled

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


def test_axes_that_differ_are_a_stretched_board() -> None:
    """Beyond the readings' doubt and beyond what matters."""
    scale = print_scale(260, 260.0, 150, 148.5)
    assert scale.differs
    assert scale.aspect == pytest.approx(1 / 0.99 - 1)
    board = rescaled(SPEC, scale)
    x, y = (board.square_m * (1.0 + sign * 0.5 * board.stretch) for sign in (1, -1))
    assert (x, y) == pytest.approx((SPEC.square_m, 0.99 * SPEC.square_m), rel=1e-6)
    assert board.stretch_std == pytest.approx(scale.aspect_std, rel=0.01)
    assert BoardSpec(**board.to_dict()) == board
    readings = (150, 150.0, 150, 149.6)
    assert not print_scale(*readings).differs
    assert print_scale(*readings, 0.03).differs, "a caliper sees what a ruler does not"
    assert not print_scale(150, 150.0, 150, 149.865, 0.005).differs, "too little to matter"


def test_the_board_as_it_was_printed() -> None:
    """Squares and markers follow the scale, the mount does not; rulers weigh by the square of their length."""
    board = rescaled(SPEC, print_scale(260, 252.2, 150, 145.5))
    assert (board.square_m, board.marker_m) == pytest.approx((0.020 * 0.97, 0.015 * 0.97), abs=1e-9)
    assert (board.thickness_m, board.squares_x, board.dictionary) == (0.003, 11, "DICT_4X4_100")
    assert print_scale(200, 200.0, 100, 100.3).scale == pytest.approx((4 * 1.0 + 1 * 1.003) / 5)
