"""Readings that are missing, uncertain or in another unit: what they cost, and what they must not."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.scenes import Scenes, elastica_shapes, push_for_slope, scenes
from benchmarks.estimator.setup import Setup
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from estimator.table.contacts import Measured
from vbaa_calib.session import MomentSensor

from ..rod_scenes import LENGTH_M, RIG_STD, SIGMA_PX, World, camera_pose, frames, pushing


def planar(sigma_px: float, count: int = 120) -> Scenes:
    """Contacts in plane C under an upright camera, with noise."""
    rng, rig = np.random.default_rng(1), Setup(exact=False).rig()
    distance = rig.antenna.length_m * rng.uniform(0.15, 0.95, count)
    slope = np.radians(rng.uniform(2.0, 20.0, count))
    size = push_for_slope(slope, distance, rig.antenna.stiffness_Nm2) * rng.choice([-1.0, 1.0], count)
    push = np.column_stack([size, 0.0 * size])
    return scenes(rig, distance, push, made_by=elastica_shapes, sigma_px=sigma_px).noisy(rng)


def deviations(found: Contacts, given: Scenes) -> np.ndarray:
    """(B, 3) errors of distance, f_y and f_z in their deviations; NaN where nothing is said."""
    distance = (found.distance_m - given.distance_m) / found.distance_std_m
    return np.column_stack([distance, ((found.force_N - given.force_N) / found.force_std_N)[:, 1:]])


@pytest.mark.parametrize(("sigma_px", "least"), [(0.05, 118), (0.5, 110)])
def test_planar_contacts_are_located_by_the_picture_alone(sigma_px: float, least: int) -> None:
    """Distance and the force across the line of sight in all but a few, f_z where it is known; none far off."""
    given = planar(sigma_px)
    found = given.estimated("auto", 0.2, moment_Nm=None)
    off = deviations(found, given)
    assert np.isfinite(off[:, :2]).all(axis=1).sum() >= least
    assert np.nanmax(np.abs(off)) < 5.0
    assert np.nanmean(np.abs(off[:, 0]) < 1.96) > 0.93
    # the covariance of the place holds the depth, too
    apart = (found.point_antenna_m - given.shapes.contact_m)[np.isfinite(found.distance_m)]
    inverse = np.linalg.inv(found.covariance_world_m2[np.isfinite(found.distance_m)])
    assert (np.einsum("bi,bij,bj->b", apart, inverse, apart) < 25.0).all()


def test_a_rig_without_a_sensor_is_one_whose_sensor_is_not_read() -> None:
    """Whatever is given as its readings."""
    given = planar(0.1, 24)
    covariance = given.rig.covariance.copy()
    covariance[15:17] = covariance[:, 15:17] = 0.0
    bare = replace(given.rig, moment_sensor=MomentSensor.none(), covariance=covariance)
    silent = given.estimated("auto", 0.2, moment_Nm=None)
    estimator = ContactEstimator(bare, friction=0.2)
    columns = (given.points_px, given.moment_Nm, given.pan_rad, given.tilt_rad)
    read = estimator.estimate_batch(*columns, sigma_px=0.1)
    unread = estimator.estimate_batch(columns[0], None, *columns[2:], sigma_px=0.1)
    for name in ("distance_m", "distance_std_m", "force_N", "force_std_N", "covariance_world_m2"):
        np.testing.assert_array_equal(getattr(read, name), getattr(unread, name))
        np.testing.assert_allclose(getattr(read, name), getattr(silent, name), rtol=5e-3, atol=1e-9)
    assert (read.status == silent.status).all()


WORLD = World(camera_pose(0.6, 1.0))


def seen(count: int) -> tuple[list[Measured], np.ndarray]:
    """Presses all along the antenna, and their true forces."""
    rng = np.random.default_rng(1)
    contact = rng.uniform(0.5, 0.9, count) * LENGTH_M
    lateral = [pushing(turn, 0.02, at).tolist() for turn, at in zip(rng.uniform(-3, 3, count), contact, strict=True)]
    several = frames(WORLD, contact.tolist(), lateral, [0.3] * count, rng, points=80)
    measured = [Measured(each.points_px, np.full(80, SIGMA_PX), each.moment_Nm, 0.0, 0.3) for each in several]
    return measured, np.array([each.force_N for each in several])


def estimated(several: list[Measured], error_Nm: float) -> Contacts:
    given = [replace(each, moment_errors_Nm=np.array([error_Nm, *np.zeros(5)])) for each in several]
    return ContactEstimator(WORLD.rig(0.25 * RIG_STD), jobs=1).measure_batch(given)


def test_from_the_reading_alone_to_the_picture_alone() -> None:
    several, _ = seen(12)
    found = [estimated(several, error_Nm) for error_Nm in (0.0, 2e-4, 1e-3, 1.0)]
    ok = np.all([np.isfinite(each.force_std_N[:, 2]) for each in found], axis=0)
    assert ok.sum() >= 5
    spread = np.array([each.force_std_N[ok, 2] for each in found])
    assert (np.diff(spread, axis=0) > -1e-3 * spread[:-1]).all()
    silent = estimated([replace(each, moment_Nm=np.nan) for each in several], 0.0)
    both = ok & np.isfinite(silent.force_std_N[:, 2])
    np.testing.assert_allclose(found[-1].force_std_N[both, 2], silent.force_std_N[both, 2], rtol=0.05)
    # the residual is the reading's, in N·m, whatever its weight
    by = 5e-3
    more = estimated([replace(each, moment_Nm=each.moment_Nm + by) for each in several], 1.0)
    changed = (more.moment_residual_Nm - found[-1].moment_residual_Nm)[both] * WORLD.sensor.gain
    np.testing.assert_allclose(changed, by, rtol=0.02)


@pytest.mark.parametrize("error_Nm", [2e-4, 1e-3])
def test_forces_are_off_by_what_they_say(error_Nm: float) -> None:
    several, force = seen(60)
    rng = np.random.default_rng(2)
    wrong = [replace(each, moment_Nm=each.moment_Nm + rng.normal(0.0, error_Nm)) for each in several]
    found = estimated(wrong, error_Nm)
    ok = found.status == "ok"
    off = (found.force_N[ok, 2] - force[ok, 2]) / found.force_std_N[ok, 2]
    assert ok.sum() >= 40
    assert np.mean(np.abs(off) < 2.0) > 0.85
    assert np.median(np.abs(off)) == pytest.approx(0.67, abs=0.25)
    # as if they were read without an error, they are much surer than they may be
    bold = estimated(wrong, 0.0)
    sure = ok & (bold.status == "ok")
    if sure.sum() > 10:
        assert np.mean(np.abs((bold.force_N - force)[sure, 2] / bold.force_std_N[sure, 2]) < 2.0) < 0.8


def test_uncertain_joint_angles_are_in_the_world_points_deviations() -> None:
    """With angles off by what is stated, world points are off by what that adds to their covariance."""
    several, _ = seen(60)
    rng, std_rad = np.random.default_rng(3), np.array([2e-3, 4e-3])
    off_rad = std_rad * rng.normal(size=(60, 2))
    wrong = [
        replace(each, pan_rad=each.pan_rad + pan, tilt_rad=each.tilt_rad + tilt, joint_errors_rad=std_rad)
        for each, (pan, tilt) in zip(several, off_rad, strict=True)
    ]
    true, found = estimated(several, 0.0), estimated(wrong, 0.0)
    ok = (true.status == "ok") & (found.status == "ok")
    assert ok.sum() >= 40
    moved = (np.sum((found.point_world_m - true.point_world_m) ** 2, axis=-1))[ok]
    added = np.trace(found.covariance_world_m2 - true.covariance_world_m2, axis1=1, axis2=2)[ok]
    assert np.mean(moved / added) == pytest.approx(1.0, abs=0.4)
    np.testing.assert_allclose(found.distance_std_m[ok], true.distance_std_m[ok], rtol=0.02)


linux = pytest.mark.skipif(sys.platform != "linux", reason="Linux alone reports the peak of memory")
