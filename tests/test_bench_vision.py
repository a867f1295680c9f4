"""The vision benchmark: its own truth holds, and the finder's promises on a seeded few of its pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.vision.judge import bound_px
from benchmarks.vision.scenes import HARDSHIPS, Bend, Shot, good, light
from benchmarks.vision.vision import hardships, hostile

SIZE = (400, 300)


def test_the_drawn_line_lies_on_the_true_path() -> None:
    """The centroid across a level line, read straight off the drawn light."""
    shot = Shot(SIZE, Bend((30.0, 150.3), 0.0, 300.0), 4.0)
    drawn = light(shot) - light(shot, antenna=False)
    rows = (np.arange(SIZE[1])[:, None] * drawn).sum(axis=0)[40:320] / drawn.sum(axis=0)[40:320]
    np.testing.assert_allclose(rows, 150.3, atol=0.01)


def test_the_bound_of_a_line_that_can_be_worked_out() -> None:
    """No blur but the pixels', level line: σ over the root of the summed squared slopes, background and height free."""
    shot = good(np.random.default_rng(0), SIZE)
    shot = replace(shot, bend=Bend((30.0, 150.0), 0.0, 300.0), width_px=4.0)
    points = np.stack([np.arange(100.0, 104.0), np.full(4, 150.0)], axis=1)
    bound = bound_px(shot, points)
    profile = (light(shot) - light(shot, antenna=False))[130:171, 100]
    sigma = np.sqrt(light(shot)[130:171, 100] / 40.0 + 1.2**2 + 1.0 / 12.0)
    slopes_alone = 1.0 / np.sqrt(((np.gradient(profile) / sigma) ** 2).sum())
    assert np.ptp(bound) < 0.02 * bound[0]
    assert 0.9 * slopes_alone < bound[0] < 1.4 * slopes_alone


def test_good_pictures_reach_the_goals() -> None:
    """Bias, spread against the bound, predicted deviations, false points."""
    (row,) = hardships(6, 3, ("none",))
    assert row.found == 1.0
    assert abs(row.bias_px) < 0.01
    assert row.of_bound < 1.2
    assert 0.85 < row.of_sigma < 1.15
    assert row.false == 0.0
    assert row.kept > 0.97


QUICK = ("clutter", "shadow or reflection", "1.5 to 2 px wide")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK))
        for name in HARDSHIPS
        if name not in ("highlights", "sensor noise")
    ],
)
def test_deviations_stay_honest_under_a_hardship(name: str) -> None:
    (row,) = hardships(3, 5, (name,))
    assert row.found == 1.0
    assert abs(row.bias_px) < 0.03
    # a reflection within the profiles draws all of them aside alike, which none of them can know
    assert 0.7 < row.of_sigma < (2.0 if name == "shadow or reflection" else 1.35)
    assert row.false <= 0.005
    assert row.kept > 0.9


@pytest.mark.slow
def test_a_seeded_few_hard_pictures() -> None:
    """No exception, no NaN, and nothing confident where there is no antenna."""
    hard, empty = hostile(20, 7)
    assert hard.ok > 0.8
    assert hard.confident_false == 0.0
    assert empty.confident_false == 0.0


@pytest.mark.slow
def test_many_hard_pictures() -> None:
    hard, empty = hostile(2000, 8)
    assert hard.ok > 0.85
    assert hard.confident_false <= 0.005
    assert empty.confident_false <= 0.001
