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


@pytest.mark.skipif(not np.isfinite(resident_MB("VmHWM")), reason="the system does not tell")
def test_memory_that_is_taken_shows() -> None:
    held = cost_of(lambda: np.ones(5_000_000), 1)
    assert held.risen_MB == pytest.approx(40.0, abs=4.0)
    assert cost_of(lambda: None, 3).risen_MB < 2.0


def quadratic(size: int, seed: int) -> object:
    return lambda: np.ones((size, size)) @ np.ones(size) if seed >= 0 else None


@pytest.mark.slow
def test_a_series_that_grows_too_fast_is_found_out() -> None:
    series = Series("squares", "rows", (1,), (1,), quadratic, "every row meets every other")
    grown = follow(series, [1000, 1500, 2200, 3300], 0, 2)
    assert grown.time.exponent > 1.0
    assert grown.memory.exponent == pytest.approx(2.0, abs=0.3)
    assert grown.worse
    assert not Grown(replace(series, time_exponent=9.0, memory_exponent=3.0), grown.sizes, grown.costs).worse
    assert "WORSE" in as_text([grown])
