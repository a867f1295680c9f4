"""The estimator's accuracy benchmark: its tables say what is there, and on a part of them its goals are met."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.estimator import grid as estimator_grid
from benchmarks.estimator import rods as estimator_rods
from benchmarks.estimator.bound import QUANTITIES, Estimates, bound, estimate, quality, standard_errors, truth
from benchmarks.estimator.grid import summary
from benchmarks.estimator.rods import POPULATIONS
from benchmarks.estimator.scenes import Scenes, random_scenes
from benchmarks.estimator.setup import Setup

UPRIGHT = Setup("none").rig()


def test_quality_of_errors_that_are_known() -> None:
    rng = np.random.default_rng(6)
    errors = rng.normal(0.3, 1.0, 200_000)
    numbers = quality(errors, np.ones(len(errors)), 2.0)
    assert numbers.of_bound == pytest.approx(np.sqrt(1.09) / 2, rel=0.01)
    assert numbers.bias == pytest.approx(0.3, abs=0.01)
    assert numbers.covered == pytest.approx(0.9404, abs=0.002)
    assert np.isnan(quality(errors[:1], np.ones(1), 1.0).of_bound)
    each = [quality(rng.normal(size=100), np.ones(100), 1.0) for _ in range(2000)]
    expected = standard_errors(100)
    for name in ("of_bound", "bias", "covered"):
        assert np.std([getattr(one, name) for one in each]) == pytest.approx(getattr(expected, name), rel=0.1)


def made_up(skew: float = 0.0, silent: float = 0.0):
    """An efficient estimator that needs no picture: errors by the bound, plus a skew of so many deviations."""

    def answer(frames: Scenes, model: str, friction_std_rad: float) -> Estimates:
        rng = np.random.default_rng(7)
        which, back = np.unique(
            np.column_stack([frames.distance_m, frames.touches.push_N]), axis=0, return_index=True, return_inverse=True
        )[1:]
        std = bound(frames.picked(which), friction_std_rad).std[back.reshape(-1)]
        values = truth(frames) + std * (rng.normal(size=std.shape) + skew)
        values[rng.random(len(values)) < silent] = np.nan
        status = np.where(np.isfinite(values[:, 0]), "ok", "low_signal")
        return Estimates(values, std, np.column_stack([np.zeros(len(std)), values[:, 1:]]), status, status)

    return answer


def test_the_grid_finds_an_efficient_estimator_efficient(monkeypatch) -> None:
    monkeypatch.setattr(estimator_grid, "estimate", made_up())
    rows = estimator_grid.run(300, 0, tilts_deg=(60.0,))
    assert len(rows) == 3 * 15 * len(QUANTITIES)
    lines = summary(rows)
    assert len(lines) == 9
    assert [line.clearly for line in lines] == [0] * 9
    assert all(line.met for line in lines)
    for line in lines:
        expected = {"of_bound": 1.0, "bias": 0.0, "covered": 0.95}[line.measure]
        assert abs(line.pooled - expected) < 4.5 * line.pooled_error, line


def test_the_grid_finds_a_skew_and_silence(monkeypatch) -> None:
    monkeypatch.setattr(estimator_grid, "estimate", made_up(skew=0.5, silent=0.25))
    rows = estimator_grid.run(800, 0, lenses=("none",), tilts_deg=(30.0,))
    assert np.mean([row.without_numbers for row in rows]) == pytest.approx(0.25, abs=0.03)
    lines = summary(rows)
    assert [line.pooled for line in lines if line.measure == "bias"] == pytest.approx([0.5] * 3, abs=0.05)
    assert [line.pooled for line in lines if line.measure == "of_bound"] == pytest.approx([np.sqrt(1.25)] * 3, abs=0.05)
    assert not any(line.met for line in lines if line.measure == "bias")


def test_the_estimator_reaches_the_bound_on_a_part_of_the_grid() -> None:
    """One rig, 15 cells: squares of l, f_y and f_z over their bounds within what one run in 10,000 exceeds."""
    rows = estimator_grid.run(8, 0, lenses=("brown",), tilts_deg=(30.0,))
    assert all(row.without_numbers == 0.0 for row in rows)
    for quantity in QUANTITIES:
        squares = np.mean([row.of_bound**2 for row in rows if row.quantity == quantity])
        assert abs(squares - 1.0) < 4 * np.sqrt(2 / 120), quantity


def test_the_estimator_is_not_biased_by_its_model_on_the_rod() -> None:
    rows = estimator_rods.run(40, 0, chosen=POPULATIONS[:1])
    assert rows[0].small_bias is not None
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
    assert row.small_bias is not None
    # the goal, less two standard errors of so many frames
    assert row.small_bias >= 0.98
    assert row.location <= 0.01
    assert row.force <= 0.02
    assert 0.92 < row.l_covered < 0.98
