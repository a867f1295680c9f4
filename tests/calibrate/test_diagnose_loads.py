"""Rows of loads.csv with every slip: named before the solve where they are impossible, else by their pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.diagnose.session import session_diagnoses
from vbaa_calib.diagnose.typed_loads import typed_load_diagnoses
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Load

from ..rod_scenes import LENGTH_M
from .still_faults import NOMINAL, before, drawn_world, free_stills, hung_loads, observed, session

G = 9.80665


def scaled(factor: float) -> Callable[[Load], Load]:
    return lambda load: replace(load, force_y_N=factor * load.force_y_N, force_z_N=factor * load.force_z_N)


def exchanged(load: Load) -> Load:
    return replace(load, force_y_N=load.force_z_N, force_z_N=load.force_y_N)


def from_tip(load: Load) -> Load:
    return replace(load, distance_m=LENGTH_M - load.distance_m)


SLIPS: dict[str, tuple[Callable[[Load], Load], str]] = {
    "grams": (scaled(1e3 / G), "in grams"),
    "kilograms": (scaled(1 / G), "in kilograms"),
    "millinewtons": (scaled(1e3), "in millinewtons"),
    "pounds": (scaled(1 / 4.4482), "in pounds"),
    "inches": (lambda load: replace(load, distance_m=load.distance_m / 0.0254), "in inches"),
    "sign": (scaled(-1.0), "with its sign turned round"),
    "exchanged": (exchanged, "with y and z exchanged"),
    "from the tip": (from_tip, "from the tip"),
    "a tenth": (lambda load: replace(load, distance_m=0.1 * load.distance_m), "a decimal place too small"),
}


@pytest.fixture(scope="module")
def good() -> tuple[Prior, list[Observation]]:
    """A session in which nothing is wrong but what a ruler and a balance always are."""
    rng = np.random.default_rng(11)
    world = drawn_world(rng)
    return before(world, rng), observed(world, [*free_stills(), *hung_loads(rng)], rng)


def renoted(observations: list[Observation], slip: Callable[[Load], Load], which: frozenset[int]) -> list[Observation]:
    """The same pictures with other rows for some of the loads, counted from 0."""
    found, index = [], -1
    for one in observations:
        if isinstance(one.still, Load):
            index += 1
            found.append(replace(one, still=slip(one.still)) if index in which else one)
        else:
            found.append(one)
    return found


ONE, ALL = frozenset({1}), frozenset(range(5))
QUICK = (("grams", ONE), ("exchanged", ALL), ("from the tip", ONE))


@pytest.mark.parametrize(
    ("name", "rows"),
    [*QUICK, *(pytest.param(name, rows, marks=pytest.mark.slow) for name in SLIPS for rows in (ONE, ALL))],
)
def test_a_slip_is_named_with_its_row_and_the_value_that_fits(good, name: str, rows: frozenset[int]) -> None:
    known, observations = good
    slip, how = SLIPS[name]
    wrong = renoted(observations, slip, rows)
    found = [one for one in session_diagnoses(session(), Kinematics(), wrong, known) if one.severity != "note"]
    assert len(found) == 1
    assert how in found[0].words
    assert found[0].grave
    if len(rows) == 1:
        assert "row 2 (loads_001.png)" in found[0].words
        true = next(one.still for one in observations if one.still.image and one.still.image.name == "loads_001.png")
        assert isinstance(true, Load)
        value = true.distance_m if "distance" in found[0].name else true.force_y_N
        cells = [float(part.split("→")[1].split(",")[0]) for part in found[0].remedy.split(": ")[1].split(", ")]
        # a kilogram is 9.81 N, a slip of the decimal point 10
        assert cells[0] == pytest.approx(value, rel=0.03)
    else:
        assert "all 5 rows" in found[0].words


def test_rows_that_are_right_raise_nothing(good) -> None:
    known, observations = good
    found = session_diagnoses(session(), Kinematics(), observations, known)
    assert [one for one in found if one.severity != "note"] == []


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
