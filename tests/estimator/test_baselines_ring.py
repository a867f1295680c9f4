"""The Dynamic Active Antenna on superposed modes that `vibrations` works out by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.paper.baselines import Answer, Press, Ring, Wire, run_method

from . import vibrations
from .presses import LENGTH_M, STIFFNESS_NM2, WIRE, ringing


def heard(ring: Ring, wire: Wire = WIRE) -> Answer:
    return run_method("Dynamic Active Antenna", Press(wire, ring=ring))


@pytest.mark.parametrize("contact", [0.15, 0.3, 0.5])
def test_the_distance_is_found_and_is_as_uncertain_as_stated(contact: float) -> None:
    rng = np.random.default_rng(int(100 * contact))
    found = [heard(ringing(contact, (4e-4,), 2e-5, rng)) for _ in range(24)]
    off = np.array([each.distance_m for each in found]) - contact * LENGTH_M
    stated = np.sqrt(np.mean([each.distance_std_m**2 for each in found]))
    assert abs(off.mean()) < 4.0 * stated / np.sqrt(24)
    assert off.std() == pytest.approx(stated, rel=0.4)
    assert stated < 2e-3


@pytest.mark.parametrize("second", [1e-4, 6e-4])
def test_a_second_mode_does_not_mislead_it(second: float) -> None:
    found = heard(ringing(0.4, (4e-4, second), 2e-5, np.random.default_rng(2)))
    assert found.distance_m == pytest.approx(0.4 * LENGTH_M, abs=2e-3)
    assert found.distance_std_m > heard(ringing(0.4, (4e-4,), 2e-5, np.random.default_rng(2))).distance_std_m


@pytest.mark.parametrize("contact", [0.72, 0.9])
def test_either_side_of_the_second_modes_node_rings_alike(contact: float) -> None:
    found = heard(ringing(contact, (4e-4,), 1e-5, np.random.default_rng(3)))
    assert np.isnan(found.distance_m)
    assert np.abs(found.candidates_m - contact * LENGTH_M).min() < 2e-3
    assert len(found.candidates_m) == 2
    assert "either side" in found.reason
    waves = [vibrations.modes(place / LENGTH_M, 1)[0][0] for place in found.candidates_m]
    assert waves[0] == pytest.approx(waves[1], rel=1e-6)


def test_stiffness_and_mass_count() -> None:
    ring = ringing(0.4, (4e-4,), 1e-6, np.random.default_rng(4))
    doubtful = replace(WIRE, stiffness_std_Nm2=0.04 * STIFFNESS_NM2)
    waves = [vibrations.modes(0.4 + step, 1)[0][0] for step in (-1e-4, 1e-4)]
    growth = 2.0 * (waves[1] - waves[0]) / (2e-4 * np.mean(waves)) / LENGTH_M  # d ln ω/dl
    assert heard(ring, doubtful).distance_std_m == pytest.approx(0.02 / growth, rel=0.02)
