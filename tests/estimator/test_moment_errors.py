"""A reading that is less certain than the sensor's noise counts for less, and the contact's deviations know it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from estimator.table.contacts import Measured

from ..rod_scenes import LENGTH_M, RIG_STD, SIGMA_PX, World, camera_pose, frames, pushing

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
