"""Exponents against growth that is known, and each kind of work at its smallest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.growth.growth import Grown, Series, as_text, cost_of, fitted, follow, resident_MB

SIZES = [10, 30, 100, 300, 1000, 3000]


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0, 2.0, 3.0])
def test_a_power_is_found(exponent: float) -> None:
    found = fitted(SIZES, [7e-3 * size**exponent for size in SIZES])
    assert found.exponent == pytest.approx(exponent, abs=1e-12)
    assert found.std == pytest.approx(0.0, abs=1e-12)
    assert found.smallest == pytest.approx(300)
    np.testing.assert_allclose(found.at(np.array(SIZES, float)), 7e-3 * np.array(SIZES) ** exponent)


def test_what_every_call_costs_does_not_hide_the_growth() -> None:
    costs = [0.1 + 1e-6 * size**2 for size in SIZES]
    assert fitted(SIZES, costs).exponent > 1.0 > np.polyfit(np.log(SIZES), np.log(costs), 1)[0]


def test_the_deviation_is_what_sampling_shows() -> None:
    rng, truth = np.random.default_rng(0), 1.3
    found = [fitted(SIZES, np.exp(truth * np.log(SIZES) + 0.1 * rng.normal(size=6))) for _ in range(3000)]
    off = np.array([each.exponent - truth for each in found])
    assert abs(off.mean()) < 4 * off.std() / np.sqrt(len(off))
    # the upper half has one degree of freedom: the deviations' squares are right on average
    assert np.mean([each.std**2 for each in found]) == pytest.approx(off.var(), rel=0.12)


def test_too_few_sizes_say_nothing() -> None:
    for costs in ([1.0, 2.0, np.nan, np.nan], [0.0, 0.0, 1.0, 2.0], [-1.0, 1.0, 2.0, 0.0]):
        found = fitted([1, 2, 4, 8], costs)
        assert np.isnan(found.exponent)
        assert not found.worse_than(0.0)


@pytest.mark.skipif(not np.isfinite(resident_MB("VmHWM")), reason="the system does not tell")
def test_memory_that_is_taken_shows() -> None:
    held = cost_of(lambda: np.ones(5_000_000), 1)
    assert held.risen_MB == pytest.approx(40.0, abs=4.0)
    assert cost_of(lambda: None, 3).risen_MB < 2.0


def quadratic(size: int, seed: int) -> object:
    return lambda: np.ones((size, size)) @ np.ones(size) if seed >= 0 else None


def test_a_series_that_grows_too_fast_is_found_out() -> None:
    series = Series("squares", "rows", (1,), (1,), quadratic, "every row meets every other")
    grown = follow(series, [1000, 1500, 2200, 3300], 0, 2)
    assert grown.time.exponent > 1.0
    assert grown.memory.exponent == pytest.approx(2.0, abs=0.3)
    assert grown.worse
    assert not Grown(replace(series, time_exponent=9.0, memory_exponent=3.0), grown.sizes, grown.costs).worse
    assert "WORSE" in as_text([grown])
