"""Slips in the jig's pose are named by where the free antenna lies, of rigs drawn widely; clean sessions pass."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.diagnose.jig import jig_diagnoses

from .jig_slips import SLIPS, drawn_rig, mistaken, reported

SHOWN_BY_LOADS = ("sign of z", "x and z")
"""A clamp's angle makes up for a shift along the line of sight, until loads bend the antenna."""


@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(4, 14))])
@pytest.mark.parametrize("slip", ["in cm", "sign of y", "half a turn about its middle"])
def test_a_slip_is_named(slip: str, seed: int) -> None:
    _named(slip, seed)


@pytest.mark.slow
@pytest.mark.parametrize("slip", SLIPS)
def test_every_slip_is_named(slip: str) -> None:
    for seed in range(14, 18):
        _named(slip, seed)


def _named(slip: str, seed: int) -> None:
    rng = np.random.default_rng((7, seed))
    evidence = reported(drawn_rig(rng), rng)
    name, change = SLIPS[slip]
    found = jig_diagnoses(mistaken(evidence, change))
    assert [one.name for one in found] == [name] or (not found and slip in SHOWN_BY_LOADS), found
    assert all(one.grave for one in found)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 40))])
def test_a_jig_that_is_right_is_not_blamed(seed: int) -> None:
    rng = np.random.default_rng((8, seed))
    assert jig_diagnoses(reported(drawn_rig(rng), rng)) == []
