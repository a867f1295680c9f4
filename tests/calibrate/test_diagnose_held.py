"""Antennas that bend, clamps that slip, sensors and gravity that are not as noted: each injected, each named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.diagnose.session import session_diagnoses
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Still, gravity_antenna

from ..rod_scenes import GRAVITY_WORLD, LENGTH_M
from .still_faults import Faults, before, drawn_world, free_stills, hung_loads, observed, session, turned

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


def injected(seed: int, faults: Faults) -> list[Diagnosis]:
    """What is said of a session with a fault in it."""
    rng = np.random.default_rng(seed)
    world = drawn_world(rng)
    observations = observed(world, [*free_stills(), *hung_loads(rng)], rng, faults)
    return diagnosed(before(world, rng), observations)


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


@pytest.mark.parametrize("noted", [(0.0, 0.0, G), pytest.param((G, 0.0, 0.0), marks=pytest.mark.slow)])
def test_gravity_that_points_elsewhere_is_named(good, noted: tuple[float, float, float]) -> None:
    known, observations = good
    gravity = np.array(noted)
    found = diagnosed(known, regravitated(observations, gravity), gravity)
    assert found[0].name == "gravity_direction"
    assert "−z of the world" in found[0].words
    assert "-9.80665" in found[0].remedy


def test_gravity_whose_sag_a_bow_hides_is_named_by_the_moments() -> None:
    rng = np.random.default_rng(11)
    world = drawn_world(rng)
    observations = observed(world, [*free_stills(), *hung_loads(rng)], rng)
    found = diagnosed(before(world, rng), regravitated(observations, -GRAVITY_WORLD), -GRAVITY_WORLD)
    assert [one.name for one in found] == ["gravity_direction"]
    assert "look as if gravity pointed to −z" in found[0].words


JOINTS: dict[str, tuple[Callable[[Still], Still], str]] = {
    "degrees": (lambda still: replace(still, tilt_rad=np.rad2deg(still.tilt_rad)), "in degrees"),
    "radians twice": (lambda still: replace(still, tilt_rad=np.deg2rad(still.tilt_rad)), "into rad twice"),
    "exchanged": (lambda still: replace(still, pan_rad=still.tilt_rad, tilt_rad=still.pan_rad), "exchanged"),
    "tilt's sign": (lambda still: replace(still, tilt_rad=-still.tilt_rad), "the tilt turned the other way"),
}


@pytest.mark.parametrize("name", [pytest.param("degrees", marks=pytest.mark.slow), *list(JOINTS)[1:]])
def test_joints_that_are_noted_wrong_are_named(name: str) -> None:
    """The tilt's sign shows in how the weight pulls along the antenna: least of all."""
    rng = np.random.default_rng(5)
    world, (change, words) = drawn_world(rng), JOINTS[name]
    stills = [replace(still, pan_rad=0.1 * index) for index, still in enumerate(free_stills((0.0, 0.5, -0.5, 0.6)))]
    observations = observed(world, [*stills, *hung_loads(rng)], rng)
    wrong = [replace(one, still=change(one.still)) for one in observations]
    found = diagnosed(before(world, rng), regravitated(wrong, GRAVITY_WORLD))
    assert found[0].name == "joint_readings_wrong"
    assert words in found[0].words


def test_a_weightless_session_is_told_what_would_fit(good) -> None:
    known, observations = good
    found = diagnosed(known, regravitated(observations, np.zeros(3)), np.zeros(3))
    assert [one.name for one in found] == ["gravity_direction"]
    assert "-9.80665" in found[0].remedy


def test_a_clamp_that_slips_is_named() -> None:
    slipping = Faults(world=lambda index, world: turned(world, 0.012, -0.010) if index >= 3 else world)
    found = injected(21, slipping)
    assert [one.name for one in found] == ["clamp_slipped"]
    assert found[0].grave


@pytest.mark.slow
def test_a_kink_is_taken_for_nothing_else() -> None:
    """The model knows no kink: what is said is that the stills do not fit, not a wrong cause."""
    found = injected(0, Faults(kink=(0.4 * LENGTH_M, 0.03, 0.03)))
    assert [one.name for one in found] == ["stills_contradict"]


@pytest.mark.slow
def test_clean_sessions_raise_nothing() -> None:
    said = [injected(seed, Faults()) for seed in range(100, 150)]
    assert sum(map(bool, said)) <= 1, said
