"""Deviations against sampling, and the evidence for contact against its own law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator import ContactEstimator, Measured
from estimator.fit import evaluated
from estimator.scene import by_rig, rig_axes
from estimator.uncertainty import evidence, spread
from estimator.verdict import CONTACT_EVIDENCE, Solved
from vbaa_calib.rig import Rig

from ..rod_scenes import LENGTH_M, RIG_STD, SIGMA_PX, Frame, World, camera_pose, frames, pushing

WORLD = World(camera_pose(0.7, 0.8))


def solved(seen: Frame, rig: Rig, model: str = "rod") -> Solved:
    """The fit behind a contact."""
    sigma = np.full(len(seen.points_px), SIGMA_PX)
    result = ContactEstimator(rig, model).solve(Measured(seen.points_px, sigma, seen.moment_Nm, 0.0, seen.tilt_rad))
    assert result is not None
    return result


def redrawn(exact: Frame, rng: np.random.Generator) -> Frame:
    """The same frame with other noise."""
    points = exact.points_px + rng.normal(0.0, SIGMA_PX, exact.points_px.shape)
    return replace(exact, points_px=points, moment_Nm=exact.moment_Nm + rng.normal(0.0, WORLD.sensor.std_Nm))


def quiet(contact: float, roll: float, tip_m: float, world: World = WORLD) -> Frame:
    """One frame without noise."""
    silent = replace(world, sensor=replace(world.sensor, std_Nm=0.0))
    lateral = pushing(roll, tip_m, contact * LENGTH_M)
    rng = np.random.default_rng(0)
    return frames(silent, [contact * LENGTH_M], [lateral], [0.3], rng, sigma_px=0.0, points=200)[0]


def test_covariance_is_what_sampling_shows() -> None:
    """One contact under 60 draws of noise: the unknowns scatter as said, in every direction."""
    exact, rng = quiet(0.55, 0.6, 0.02), np.random.default_rng(1)
    rig = WORLD.rig(1e-6 * RIG_STD)
    fits = [solved(redrawn(exact, rng), rig) for _ in range(60)]
    drawn = np.array([one.fit.unknowns for one in fits])
    said = np.mean([one.spread.covariance for one in fits], axis=0)
    assert np.trace(np.linalg.solve(said, np.cov(drawn.T))) / 3 == pytest.approx(1.0, abs=0.35)
    true = solved(exact, rig).fit.unknowns
    off = drawn.mean(axis=0) - true
    assert off @ np.linalg.solve(said / 60, off) / 3 < 4.0


def test_the_rigs_part_is_what_other_rigs_show() -> None:
    """The same frame, without noise, on 40 rigs drawn from the covariance."""
    exact, rng = quiet(0.55, 0.6, 0.02), np.random.default_rng(2)
    std = 0.3 * RIG_STD
    believed = WORLD.rig(std)
    answers, said = [], []
    for _ in range(40):
        other = WORLD.moved(std * rng.normal(size=17))
        rig = replace(
            believed,
            T_antenna_camera=other.T_antenna_camera,
            antenna=replace(believed.antenna, parameters=other.parameters),
            moment_sensor=other.sensor,
        )
        one = solved(redrawn(exact, rng), rig)
        answers.append(one.fit.unknowns * np.array([1.0, *[one.fit.scene.force_unit_N] * 2]))
        said.append(np.diag(one.spread.covariance) * np.array([1.0, *[one.fit.scene.force_unit_N**2] * 2]))
    ratio = np.var(answers, axis=0) / np.mean(said, axis=0)
    assert ((ratio > 0.5) & (ratio < 1.7)).all(), ratio


def test_the_rigs_table_is_its_derivative() -> None:
    """Columns of `by_rig` against moved rigs."""
    seen = quiet(0.55, 0.6, 0.02)
    rig = WORLD.rig(RIG_STD)
    one = solved(seen, rig)
    scene = replace(one.fit.scene, rig_table=None)
    table, axes = by_rig(scene, one.fit.unknowns), rig_axes(rig)
    np.testing.assert_allclose(axes @ axes.T, rig.covariance, atol=1e-12 * rig.covariance.max())
    at = evaluated(scene, one.fit.unknowns).residuals
    for column in range(17):
        step = 0.02 * axes[:, column]
        other = WORLD.moved(step)
        moved = replace(
            rig,
            T_antenna_camera=other.T_antenna_camera,
            antenna=replace(rig.antenna, parameters=other.parameters),
            moment_sensor=other.sensor,
        )
        # the unit of force goes with the stiffness: the force itself is to stay
        unknowns = one.fit.unknowns * np.array(
            [1.0, *[scene.force_unit_N / replace(scene, rig=moved).force_unit_N] * 2]
        )
        change = (evaluated(replace(scene, rig=moved), unknowns).residuals - at) / 0.02
        np.testing.assert_allclose(change, table[:, column], atol=0.03 * np.abs(table).max() + 0.02)


def test_what_is_known_exactly_has_no_axis() -> None:
    std = RIG_STD.copy()
    std[[0, 7, 15]] = 0.0
    axes = rig_axes(WORLD.rig(std))
    assert np.isfinite(axes).all()
    np.testing.assert_array_equal(axes[[0, 7, 15]], 0.0)


def test_evidence_without_contact_follows_its_law() -> None:
    """χ²₃/2: mean and variance 1.5, a little more since the distance means nothing without a force. 50 free frames."""
    rng, found = np.random.default_rng(3), []
    for _ in range(50):
        believed = World(camera_pose(rng.uniform(0.0, 1.0), rng.uniform(-np.pi, np.pi)))
        true = believed.moved(RIG_STD * rng.normal(size=17))
        seen = frames(true, [0.1], np.zeros((1, 2)), [rng.uniform(0, 1)], rng, points=150)[0]
        found.append(evidence(solved(seen, believed.rig()).reference))
    assert 1.0 < np.mean(found) < 2.2
    assert 0.6 < np.var(found) < 3.5
    assert min(found) > -0.01
    assert max(found) < 0.7 * CONTACT_EVIDENCE


def test_evidence_grows_with_the_square_of_the_deflection() -> None:
    rig = WORLD.rig(RIG_STD)
    small, large = (evidence(solved(quiet(0.6, 0.6, tip), rig).reference) for tip in (5e-4, 1e-3))
    assert large == pytest.approx(4 * small, rel=0.25)
    assert small > CONTACT_EVIDENCE


def test_a_clamp_that_is_known_badly_weakens_the_evidence() -> None:
    seen = quiet(0.6, 0.6, 5e-4)
    loose = RIG_STD * np.where(np.arange(17) < 14, 20.0, 1.0)
    assert evidence(solved(seen, WORLD.rig(loose)).reference) < 0.5 * evidence(solved(seen, WORLD.rig()).reference)


def test_an_upright_camera_leaves_nothing_to_test_the_moment_with() -> None:
    """Inclined, the picture knows f_z by itself and the moment's misfit is its own; upright, the moment is fitted."""
    small = 0.05 * RIG_STD
    inclined, upright = (
        solved(quiet(0.6, 0.8, 0.03, world), world.rig(small)).spread.moment_std
        for world in (World(camera_pose(1.0, 0.3)), World(camera_pose(0.0)))
    )
    assert inclined > 2 * upright
    assert upright < 0.1


def test_an_unknown_that_nothing_holds_is_infinite() -> None:
    one = solved(quiet(0.6, 0.6, 0.02), WORLD.rig())
    blind = replace(one.fit, jacobian=one.fit.jacobian * ([0.0] + [1.0] * 19))
    assert np.isinf(spread(blind).covariance).all()
