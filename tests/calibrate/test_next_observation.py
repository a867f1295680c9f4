"""Which load next: the predicted uncertainty is that of a further solve, ruler and balance included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import EXACT, Observation, Prior
from vbaa_calib.calibrate.guide.next_observation import _antenna_rows, _predicted, _unseen, load_progress
from vbaa_calib.geometry import Kinematics

from ..rod_scenes import World
from .still_faults import WEIGHED, Faults, before, drawn_world, free_stills, hung_loads, observed, session, solved

MASSES_KG = (0.002, 0.005, 0.008)
TRUE_READINGS = Faults(ruler_std_m=0.0, balance_std=0.0)
LOG_STIFFNESS = 12


@pytest.fixture(scope="module")
def free() -> tuple[World, Prior, list[Observation], BundleAdjustment]:
    """A rig of which the free antenna alone was seen."""
    rng = np.random.default_rng(3)
    world = drawn_world(rng)
    observations, known = observed(world, free_stills(), rng), before(world, rng, EXACT)
    return world, known, observations, solved(observations, known)


@pytest.fixture(scope="module")
def loaded(free) -> tuple[list[Observation], BundleAdjustment]:
    """The same with four loads to all sides."""
    world, known, seen, _ = free
    rng = np.random.default_rng(4)
    seen = [*seen, *observed(world, hung_loads(rng, 4), rng, TRUE_READINGS)]
    return seen, solved(seen, known)


def test_the_first_load_is_suggested_and_brings_what_was_predicted(free) -> None:
    world, known, seen, joint = free
    progress = load_progress(joint, session(), MASSES_KG, Kinematics())
    assert not progress.enough
    assert progress.now["total"] == pytest.approx(progress.now["noise"], rel=1e-6)
    assert progress.now["noise"] == pytest.approx(np.sqrt(joint.covariance[LOG_STIFFNESS, LOG_STIFFNESS]))
    assert any("3 more loads" in words for words in progress.missing)
    load, forecast, words = progress.suggestion
    assert load.force_y_N == pytest.approx(0.0, abs=1e-12)
    assert min(abs(load.force_z_N + 9.80665 * mass) for mass in MASSES_KG) < 1e-9
    assert f"{1e3 * load.distance_m:.0f} mm" in words
    rng = np.random.default_rng(5)
    after = solved([*seen, *observed(world, [load], rng, TRUE_READINGS)], known)
    std = np.sqrt(after.covariance[LOG_STIFFNESS, LOG_STIFFNESS])
    assert std == pytest.approx(forecast, rel=0.25)
    assert std < 0.5 * progress.now["noise"]


def test_the_forecast_of_all_parameters_is_that_of_a_further_solve(free, loaded) -> None:
    """Of a free antenna at another tilt and of a load: the whole covariance, with nothing more and with both."""
    world, known, _, _ = free
    seen, _ = loaded
    known = replace(known, readings=WEIGHED)
    joint = solved(seen, known)
    none = np.zeros((0, joint.problem.size))
    np.testing.assert_allclose(joint.forecast(none), joint.covariance, rtol=1e-6, atol=1e-20)
    further = [*free_stills([0.7]), *hung_loads(np.random.default_rng(8), 1)]
    pulls = session().gravity_antenna(further)
    wanted = [_unseen(frame, pull) for frame, pull in zip(further, pulls, strict=True)]
    placed = _predicted(joint, wanted)
    rows = np.vstack(_antenna_rows(joint, [*placed.values()]))
    after = solved([*seen, *observed(world, further, np.random.default_rng(9), TRUE_READINGS)], known)
    expected, found = (np.sqrt(np.diag(each)) for each in (after.covariance, joint.forecast(rows)))
    assert len(placed) == 2
    assert (found < 0.97 * np.sqrt(np.diag(joint.covariance))).any()
    np.testing.assert_allclose(found, expected, rtol=0.15)
