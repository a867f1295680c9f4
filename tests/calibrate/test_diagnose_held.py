"""Antennas that bend, clamps that slip, sensors and gravity that are not as noted: each injected, each named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.diagnose.session import _session_diagnoses as session_diagnoses
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import gravity_antenna

from ..rod_scenes import GRAVITY_WORLD
from .still_faults import before, drawn_world, free_stills, hung_loads, observed, session

G = 9.80665


@pytest.fixture(scope="module")
def good() -> tuple[Prior, list[Observation]]:
    """A session in which nothing is wrong but what a ruler and a balance always are."""
    rng = np.random.default_rng(0)
    world = drawn_world(rng)
    return before(world, rng), observed(world, [*free_stills(), *hung_loads(rng)], rng)


def diagnosed(known: Prior, observations: list[Observation], gravity: np.ndarray = GRAVITY_WORLD) -> list[Diagnosis]:
    found = session_diagnoses(session(gravity), Kinematics(), observations, known)
    return [one for one in found if one.severity != "note"]


def reread(observations: list[Observation], sensor: Callable[[int, float], float]) -> list[Observation]:
    return [
        replace(one, still=replace(one.still, moment_Nm=sensor(index, one.still.moment_Nm)))
        for index, one in enumerate(observations)
    ]


SENSORS: dict[str, tuple[Callable[[int, float], float], str, str]] = {
    "sign": (lambda index, read: -read, "sensor_sign", "wrong sign"),
    "not connected": (lambda index, read: 0.0, "sensor_not_connected", "all 8 moment readings"),
    "noise": (lambda index, read: 2e-5 * np.sin(7.0 * index), "sensor_not_connected", "do not follow"),
    "pounds times inches": (lambda index, read: 8.8507 * read, "sensor_unit", "lbf·in"),
    "kilonewton metres": (lambda index, read: 1e-3 * read, "sensor_unit", "kN·m"),
    "micronewton metres": (lambda index, read: 1e6 * read, "sensor_unit", "µN·m"),
    # or a gain of its own: both are named
    "pounds times feet": (lambda index, read: 0.73756 * read, "sensor_gain", "lbf·ft"),
    "less noise than stated": (lambda index, read: 1e-7 * np.sin(7.0 * index), "sensor_not_connected", "do not follow"),
    "sign and millinewtons": (lambda index, read: -1e3 * read, "sensor_sign", "mN·m"),
    "millinewton metres": (lambda index, read: 1e3 * read, "sensor_unit", "mN·m"),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (number > 3)) for number, name in enumerate(SENSORS)]
)
def test_a_sensor_that_is_wrong_is_named(good, name: str) -> None:
    known, observations = good
    sensor, called, words = SENSORS[name]
    read = reread(observations, sensor)
    found = diagnosed(known, read)
    assert found[0].name == called
    assert words in found[0].words


def regravitated(observations: list[Observation], gravity_world: np.ndarray) -> list[Observation]:
    pulls = gravity_antenna(Kinematics(), gravity_world, [one.still for one in observations])
    return [replace(one, gravity_m_s2=pull) for one, pull in zip(observations, pulls, strict=True)]


def test_gravity_whose_sag_a_bow_hides_is_named_by_the_moments() -> None:
    rng = np.random.default_rng(11)
    world = drawn_world(rng)
    observations = observed(world, [*free_stills(), *hung_loads(rng)], rng)
    found = diagnosed(before(world, rng), regravitated(observations, -GRAVITY_WORLD), -GRAVITY_WORLD)
    assert [one.name for one in found] == ["gravity_direction"]
    assert "look as if gravity pointed to −z" in found[0].words
