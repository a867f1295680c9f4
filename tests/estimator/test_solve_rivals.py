"""Vision alone, and what else would explain a frame: mirror images, and what tells them apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.scenes import Scenes
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from vbaa_calib.rig import Rig, WrenchSensor
from vbaa_calib.session import MomentSensor

from ..rod_scenes import RIG_STD, World, camera_pose
from .contact_scenes import RIG, answered, rubbed, scene_deviations

UPRIGHT = World(camera_pose(0.0)).rig(np.zeros(17))
TOWARDS_CLAMP = World(camera_pose(0.785, np.pi)).rig(np.zeros(17))
ACROSS = World(camera_pose(0.785, np.pi / 2)).rig(np.zeros(17))


def touched(rig: Rig, slope: float, count: int = 40, sigma_px: float = 0.1, seed: int = 0) -> Scenes:
    """Frames with noise at rolls of a third to two thirds of a right angle, to all four sides."""
    rng = np.random.default_rng(seed)
    roll = rng.uniform(0.5, 1.05, count)
    roll = np.where(np.arange(count) % 2 == 0, roll, -roll) + np.where(np.arange(count) % 4 < 2, 0.0, np.pi)
    return rubbed(rig, rng.uniform(0.35, 0.85, count), [slope] * count, 0.0, roll, sigma_px=sigma_px).noisy(rng)


def wrong_side(found: Contacts, given: Scenes) -> np.ndarray:
    """(B,) whether f_z is given out with the wrong sign, as if its sign were known."""
    away = np.abs(found.force_N[:, 2]) > 3.0 * found.force_std_N[:, 2]
    return away & (np.sign(found.force_N[:, 2]) != np.sign(given.force_N[:, 2]))


@pytest.mark.parametrize("slope", [3.0, 6.0])
def test_an_upright_camera_alone_does_not_know_the_side_at_small_slopes(slope: float) -> None:
    """The mirror image in the picture's plane looks the same: whatever is said must allow for both."""
    given = touched(UPRIGHT, slope)
    found = answered(given, blind=True)
    assert not wrong_side(found, given).any()
    off = scene_deviations(found, given)
    assert np.nanmax(np.abs(off), initial=0.0) < 4.5
    # the place is given, and what is given of f_z says little of it
    assert np.isfinite(off[:, 0]).mean() > 0.8
    sure = (found.status == "ok") & (np.abs(found.force_N[:, 2]) > 5.0 * found.force_std_N[:, 2])
    assert sure.mean() < 0.2


def test_mirror_images_that_fit_alike_leave_the_distance() -> None:
    """Only the force along the line of sight is empty, and the reason says so; distance and seen force are right."""
    given = touched(UPRIGHT, 9.0, 80)
    found = answered(given, blind=True)
    twins = np.flatnonzero([np.isfinite(one.distance_m) and "f_z not determined" in one.reason for one in found])
    assert len(twins) > 10
    assert np.isnan(found.force_N[twins][:, [0, 2]]).all()
    off = scene_deviations(found, given)[twins, :2]
    assert np.abs(off).max() < 4.5


@pytest.mark.parametrize(
    ("rig", "slope"), [(UPRIGHT, 15.0), (UPRIGHT, 20.0), (TOWARDS_CLAMP, 8.0), (TOWARDS_CLAMP, 20.0)]
)
def test_vision_alone_knows_the_side_at_large_slopes_or_inclined_along_the_antenna(rig: Rig, slope: float) -> None:
    given = touched(rig, slope)
    found = answered(given, blind=True)
    good = found.status == "ok"
    assert good.mean() > 0.85
    off = scene_deviations(found, given)[good]
    assert np.abs(off).max() < 4.5
    assert not wrong_side(found, given).any()
    assert (np.abs(found.force_N[good, 2]) > 2.5 * found.force_std_N[good, 2]).mean() >= 0.8


@pytest.mark.parametrize("rig", [UPRIGHT, TOWARDS_CLAMP, ACROSS], ids=["upright", "clamp", "across"])
@pytest.mark.parametrize("slope", [4.0, pytest.param(10.0, marks=pytest.mark.slow), 20.0])
def test_vision_alone_is_never_confident_and_wrong(rig: Rig, slope: float) -> None:
    rng, count = np.random.default_rng(9), 40
    contact, roll = rng.uniform(0.2, 0.95, count), rng.uniform(-np.pi, np.pi, count)
    friction = rng.normal(0.0, 0.2, count)
    given = rubbed(rig, contact, [slope] * count, friction, roll).noisy(rng)
    found = answered(given, blind=True)
    off = np.abs(scene_deviations(found, given))[np.isfinite(found.distance_m)]
    # little bent, an antenna pushed towards the camera looks as if it were not
    assert len(off) > 0.6 * count
    assert np.nanmax(off) < 6.0
    assert (found.status == "failed").mean() <= 0.05
    assert np.isnan(found.moment_residual_Nm).all()


@pytest.mark.parametrize(
    ("rig", "least"), [(RIG, 0.93), (World(camera_pose(1.1, 1.0)).rig(0.25 * RIG_STD), 0.8)], ids=["usual", "inclined"]
)
def test_an_antenna_that_is_bent_far_is_found_from_small_deflections(rig: Rig, least: float) -> None:
    rng, count = np.random.default_rng(4), 60
    contact, slope = rng.uniform(0.3, 0.95, count), rng.uniform(60.0, 80.0, count)
    given = rubbed(rig, contact, slope, 0.0, rng.uniform(-np.pi, np.pi, count)).noisy(rng)
    found = answered(given)
    good = found.status == "ok"
    assert good.mean() > least
    assert np.abs(scene_deviations(found, given)[good]).max() < 4.5


def about_z(given: Scenes, rig: Rig) -> np.ndarray:
    """(B,) noise-free readings about z of straight parts and force: x·f_y − y·f_x, with the weight's share."""
    contact, force = given.shapes.contact_m, given.force_N
    weight = rig.antenna.mass_per_length_kg_m * given.touches.gravity_m_s2
    centre = given.shapes.points_m.mean(axis=1) * rig.antenna.length_m
    by_weight = centre[:, 0] * weight[:, 1] - centre[:, 1] * weight[:, 0]
    return contact[:, 0] * force[:, 1] - contact[:, 1] * force[:, 0] + by_weight


def test_a_second_sensor_does_what_the_first_one_would() -> None:
    """Camera from the side, 𝒟 near the xz plane: only the sensor about z tells which way the antenna leans to the
    camera."""
    second = MomentSensor(0.98, 1e-4, 2e-5)
    side = replace(
        World(camera_pose(np.pi / 2, np.pi / 2)).rig(np.zeros(17)), wrench_sensor=WrenchSensor.about_z(second)
    )
    rng, count = np.random.default_rng(2), 24
    roll = np.where(np.arange(count) % 2 == 0, 1.0, np.pi - 1.0) + rng.uniform(-0.3, 0.3, count)
    given = rubbed(side, rng.uniform(0.4, 0.85, count), [5.0] * count, 0.0, roll).noisy(rng)
    readings = second.gain * about_z(given, side) + second.offset_Nm + rng.normal(0.0, second.std_Nm, count)
    estimator, zeros = ContactEstimator(side), np.zeros(count)
    # the sensor about y feels f_z, which this camera sees by itself
    without = estimator.estimate_batch(given.points_px, given.moment_Nm, zeros, zeros, sigma_px=0.1)
    assert not (np.abs(without.force_N[:, 1]) > 20.0 * without.force_std_N[:, 1]).any()
    for moments in (given.moment_Nm, None):
        found = estimator.estimate_batch(given.points_px, moments, zeros, zeros, sigma_px=0.1, moments_z=readings)
        assert (found.status == "ok").all()
        off = scene_deviations(found, given)
        assert np.abs(off).max() < 4.0
        assert (np.abs(found.force_N[:, 1]) > 20.0 * found.force_std_N[:, 1]).all()
