"""Two contacts at once are found out and placed; one contact is never taken for two."""

from __future__ import annotations

import re

import numpy as np
import pytest

from estimator import Contact, ContactEstimator
from estimator.contact.contacts import Contacts

from ..beam import superposed_deflection
from ..rod_scenes import LENGTH_M, RIG_STD, STIFFNESS_NM2, World, camera_pose
from ..rod_scenes import seen as pictured
from .contact_scenes import STRAIGHT, WORLD, answered, rubbed, withheld

SIGMA_PX = 0.1
POINTS = 200
LIGHT = World(camera_pose(0.6, 1.0), STRAIGHT)
RIGS = {"exact": LIGHT.rig(np.zeros(17), np.zeros(3)), "usual": LIGHT.rig(0.25 * RIG_STD, np.zeros(3))}


def twice_touched(
    first: float, second: float, share: float, slope_deg: float, rig: str = "exact", roll: float = 0.4, seed: int = 0
) -> Contact:
    """Two forces in one plane on the paper's beam, the second this part of the first; its slope at the second."""
    at = np.array([first, second]) * LENGTH_M
    forces = np.array([1.0, share])
    forces *= 2.0 * STIFFNESS_NM2 * np.tan(np.radians(slope_deg)) / (forces * at**2).sum()
    x = (np.arange(POINTS) + 0.5) / POINTS * LENGTH_M
    aside = superposed_deflection(x, at, forces, STIFFNESS_NM2)
    points = np.stack([x, aside * np.cos(roll), aside * np.sin(roll)], axis=1)
    rng, sensor = np.random.default_rng(seed), LIGHT.sensor
    pixels = pictured(LIGHT.T_antenna_camera, points) + rng.normal(0.0, SIGMA_PX, (POINTS, 2))
    moment = sensor.gain * float(at @ forces) * np.sin(roll) + sensor.offset_Nm + rng.normal(0.0, sensor.std_Nm)
    return ContactEstimator(RIGS[rig]).estimate(pixels, moment=moment, pan=0.0, tilt=0.0, sigma_px=SIGMA_PX)


def places_mm(contact: Contact) -> list[float]:
    """The places that the reason names."""
    found = re.search(r"two contacts explain it better, near (\d+) and (\d+) mm", contact.reason)
    return [] if found is None else [float(place) for place in found.groups()]


@pytest.mark.parametrize("rig", ["usual", pytest.param("exact", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("first", "second", "share"), [(0.5, 0.75, 0.5), (0.5, 0.75, 1.0), (0.3, 0.9, 0.2), (0.5, 0.95, 0.3)]
)
def test_two_contacts_are_named(first: float, second: float, share: float, rig: str) -> None:
    """At 15° and 0.1 px: no numbers, but two places, of which one lies between the two or near one of them."""
    contact = twice_touched(first, second, share, 15.0, rig)
    assert contact.status == "failed"
    assert contact.in_contact
    assert withheld(contact)
    near, far = places_mm(contact)
    assert 0.0 < near < far <= 1e3 * LENGTH_M
    assert near < 1e3 * LENGTH_M * second
    assert far > 1e3 * LENGTH_M * first


@pytest.mark.parametrize("share", [-0.5, pytest.param(-0.3, marks=pytest.mark.slow)])
def test_opposed_contacts_are_no_contact_either(share: float) -> None:
    contact = twice_touched(0.33, 0.83, share, 10.0)
    assert contact.status == "failed"
    assert withheld(contact)


@pytest.mark.parametrize(("first", "second", "share"), [(0.5, 0.6, 0.5), (0.7, 0.8, 1.0)])
def test_what_cannot_be_told_apart_lies_in_between(first: float, second: float, share: float) -> None:
    """Stated as a limit: a tenth of the length apart at small slopes, two look like one."""
    contact = twice_touched(first, second, share, 5.0)
    assert contact.status == "ok"
    slack = 3.0 * contact.distance_std_m
    assert first * LENGTH_M - slack < contact.distance_m < second * LENGTH_M + slack


def once_touched(count: int, seed: int, incline: float, azimuth: float, std: float) -> Contacts:
    """Frames of one contact each, with friction: bent a little and much, near the clamp and far."""
    rng = np.random.default_rng(seed)
    contact, slope = rng.uniform(0.15, 0.95, count), rng.uniform(2.0, 28.0, count)
    friction = np.clip(rng.normal(0.0, 0.2, count), -0.7, 0.7)
    rig = World(camera_pose(incline, azimuth)).rig(std * RIG_STD)
    scenes = rubbed(rig, contact, slope, friction, rng.uniform(-3.1, 3.1, count), sigma_px=SIGMA_PX)
    return answered(scenes.noisy(rng))


@pytest.mark.parametrize("std", [0.0, 0.25])
@pytest.mark.parametrize(("incline", "azimuth"), [(0.0, 0.0), (0.8, np.pi)])
def test_one_contact_is_never_two(incline: float, azimuth: float, std: float) -> None:
    found = once_touched(150, 0, incline, azimuth, std)
    assert not [one.reason for one in found if "two contacts" in one.reason]
    assert (found.status == "ok").mean() > 0.9


def test_a_knocked_rig_is_not_called_two_contacts() -> None:
    """The rig's own uncertainty takes up what it can: camera and antenna drawn from their covariance."""
    rng = np.random.default_rng(5)
    for _ in range(4):
        true = WORLD.moved(RIG_STD * rng.normal(size=17)).rig(np.zeros(17))
        contact, slope = rng.uniform(0.3, 0.9, 10), rng.uniform(5.0, 25.0, 10)
        scenes = rubbed(true, contact, slope, 0.0, rng.uniform(-1, 1, 10), given=WORLD.rig(RIG_STD)).noisy(rng)
        assert not [one.reason for one in answered(scenes) if "two contacts" in one.reason]
