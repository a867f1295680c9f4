"""Rigs and frames without a moment: places that perspective leaves open in one direction are given in the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.scenes import Scenes, elastica_shapes, push_for_slope, scenes
from benchmarks.estimator.setup import Setup
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from vbaa_calib.session import MomentSensor


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
