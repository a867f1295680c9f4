"""The estimator's accuracy benchmark: its tables say what is there, and on a part of them its goals are met."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.estimator import grid as estimator_grid
from benchmarks.estimator import rods as estimator_rods
from benchmarks.estimator.bound import QUANTITIES, estimate, truth
from benchmarks.estimator.grid import summary
from benchmarks.estimator.rods import POPULATIONS
from benchmarks.estimator.scenes import random_scenes


def test_the_estimator_reaches_the_bound_on_a_part_of_the_grid() -> None:
    """One rig, 15 cells: squares of l, f_y and f_z over their bounds within what one run in 10,000 exceeds."""
    rows = estimator_grid.run(8, 0, lenses=("brown",), tilts_deg=(30.0,))
    assert all(row.without_numbers == 0.0 for row in rows)
    for quantity in QUANTITIES:
        squares = np.mean([row.of_bound**2 for row in rows if row.quantity == quantity])
        assert abs(squares - 1.0) < 4 * np.sqrt(2 / 120), quantity


def test_the_estimator_is_not_biased_by_its_model_on_the_rod() -> None:
    rows = estimator_rods.run(40, 0, chosen=POPULATIONS[:1])
    assert rows[0].small_bias >= 0.95
    assert rows[0].location < 0.01
    assert rows[0].force < 0.02
    noiseless = random_scenes(POPULATIONS[0].setup.rig(), 3, np.random.default_rng(9))
    assert (np.abs(estimate(noiseless, "rod", 0.0).values - truth(noiseless))[:, 0] < 2e-4).all()


@pytest.mark.slow
def test_the_whole_grid_meets_its_goals() -> None:
    rows = estimator_grid.run(100, 3)
    assert not [row.cell for row in rows if row.left_out]
    assert np.mean([row.without_numbers for row in rows]) < 2e-3
    for line in summary(rows):
        # of 1620 numbers one in six hundred may lie beyond by noise alone
        assert line.clearly <= 2, line
        assert not {"of_bound": line.pooled > 1.02, "bias": abs(line.pooled) > 0.05}.get(line.measure, False), line


@pytest.mark.slow
@pytest.mark.parametrize("number", range(4))
def test_the_rod_meets_its_goals(number: int) -> None:
    (row,) = estimator_rods.run(400, 4, chosen=[POPULATIONS[number]])
    # the goal, less two standard errors of so many frames
    assert row.small_bias >= 0.98
    assert row.location <= 0.01
    assert row.force <= 0.02
    assert 0.92 < row.l_covered < 0.98
