"""Rows of loads.csv with every slip: named before the solve where they are impossible, else by their pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.diagnose.typed_loads import typed_load_diagnoses
from vbaa_calib.session import Load

from .still_faults import NOMINAL, hung_loads

G = 9.80665


def scaled(factor: float) -> Callable[[Load], Load]:
    return lambda load: replace(load, force_y_N=factor * load.force_y_N, force_z_N=factor * load.force_z_N)


ONE, ALL = frozenset({1}), frozenset(range(5))


@pytest.mark.parametrize(
    ("change", "name", "words"),
    [
        (scaled(1e3 / G), "load_force_unit", "in grams"),
        (lambda load: replace(load, distance_m=15.0), "load_distance_unit", "in centimetres"),
        (lambda load: replace(load, distance_m=150.0), "load_distance_unit", "in millimetres"),
        (scaled(1e-3), "load_too_small", "newtons"),
    ],
)
def test_typed_loads_that_are_impossible_are_named(change: Callable[[Load], Load], name: str, words: str) -> None:
    loads = [change(load) for load in hung_loads(np.random.default_rng(1))]
    (found,) = typed_load_diagnoses(loads, NOMINAL)
    assert found.name == name
    assert "all 5 rows" in found.words
    assert words in found.remedy
