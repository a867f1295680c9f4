"""docs/limits.md: what nothing in a frame's answer tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.shapes import elastica_shapes
from estimator import ContactEstimator

from .contact_scenes import answered, rubbed, scene_deviations
from .test_theory_tables import rig_of


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0])
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_wrong_stiffness_hides(factor: float, tilt_deg: float) -> None:
    """What is seen of the force follows EI, what is read does not; the distance hardly moves, all is called well."""
    rig = rig_of(tilt_deg)
    given = rubbed(rig, [0.4, 0.6, 0.8], [8.0] * 3, 0.0, 0.6, made_by=elastica_shapes)
    parameters = rig.antenna.parameters + np.log(factor) * (np.arange(9) == 6)
    wrong = ContactEstimator(replace(rig, antenna=replace(rig.antenna, parameters=parameters)))
    found = wrong.estimate_batch(given.points_px, given.moment_Nm, given.pan_rad, given.tilt_rad, sigma_px=0.1)
    assert (found.status == "ok").all()
    np.testing.assert_allclose(found.force_N[:, 1] / given.force_N[:, 1], factor, rtol=0.08)
    np.testing.assert_allclose(found.force_N[:, 2] / given.force_N[:, 2], 1.0, rtol=0.08)
    np.testing.assert_allclose(found.distance_m, given.distance_m, rtol=0.01)


def test_without_a_reading_a_wrong_stiffness_is_a_wrong_force_only() -> None:
    rig = rig_of(30.0)
    given = rubbed(rig, [0.4, 0.6, 0.8], [20.0] * 3, 0.0, 0.6, made_by=elastica_shapes)
    parameters = rig.antenna.parameters + np.log(2.0) * (np.arange(9) == 6)
    wrong = ContactEstimator(replace(rig, antenna=replace(rig.antenna, parameters=parameters)))
    found = wrong.estimate_batch(given.points_px, None, given.pan_rad, given.tilt_rad, sigma_px=0.1)
    np.testing.assert_allclose(found.distance_m, given.distance_m, rtol=2e-3)
    np.testing.assert_allclose(found.force_N[:, 1:] / given.force_N[:, 1:], 2.0, rtol=0.03)


@pytest.mark.slow
def test_neighbours_that_err_together() -> None:
    """A correlation of 0.5 between neighbours: as if of each three points there were one, so √3 off in deviations."""
    rng, count, off, loud = np.random.default_rng(6), 200, [], []
    for together in (0.0, 0.5):
        reach, slope, roll = rng.uniform(0.3, 0.8, count), rng.uniform(6.0, 20.0, count), rng.uniform(-0.9, 0.9, count)
        given = rubbed(rig_of(), reach, slope, 0.0, roll, made_by=elastica_shapes)
        noise = rng.normal(size=given.points_px.shape)
        for index in range(1, noise.shape[1]):
            noise[:, index] = together * noise[:, index - 1] + np.sqrt(1 - together**2) * noise[:, index]
        found = answered(replace(given, points_px=given.points_px + 0.1 * noise), "elastica", friction=0.0)
        off.append(float(np.sqrt(np.nanmean(scene_deviations(found, given)[:, 0] ** 2))))
        loud.append(float(np.mean(found.numbers.second_gain > 18.0)))
        print(f"correlation {together}: l off by {off[-1]:.2f} deviations rms, second force in {100 * loud[-1]:.1f} %")
    np.testing.assert_allclose(off, [1.0, 3.0**0.5], rtol=0.15)
    assert max(loud) < 0.03
