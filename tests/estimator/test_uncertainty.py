"""Deviations against sampling, and the evidence for contact against its own law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from estimator.contact.settings import ContactSettings
from estimator.solver.frames import Frames, frames_from_pixels
from estimator.solver.ladder import solve
from estimator.solver.linearised import linearised
from estimator.solver.numbers import FitNumbers
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays
from vbaa_calib.rig import Rig, Tip

from ..rod_scenes import LENGTH_M, RIG_STD, SIGMA_PX, Frame, World, camera_pose, frames, gravity_antenna, pushing

WORLD = World(camera_pose(0.7, 0.8))


def framed(several: Sequence[Frame], rig: Rig, friction: float = 0.0) -> Frames:
    """Frames as the solver takes them."""
    rig_arrays = RigArrays.from_rig(rig, friction)
    points = np.stack([seen.points_px for seen in several])
    readings = np.array([[seen.moment_Nm, np.nan] for seen in several])
    gravity = np.stack([gravity_antenna(seen.tilt_rad, rig.gravity_world_m_s2) for seen in several])
    tips = np.stack([seen.tip_px for seen in several])
    return frames_from_pixels(rig_arrays, points, np.full(points.shape[:2], SIGMA_PX), readings, tips, gravity)


def solved(several: Sequence[Frame], rig: Rig, model: str = "rod", friction: float = 0.0) -> FitNumbers:
    """The fits behind contacts."""
    return solve(framed(several, rig, friction), model)


def redrawn(exact: Frame, rng: np.random.Generator) -> Frame:
    """The same frame with other noise."""
    points = exact.points_px + rng.normal(0.0, SIGMA_PX, exact.points_px.shape)
    return replace(exact, points_px=points, moment_Nm=exact.moment_Nm + rng.normal(0.0, WORLD.sensor.std_Nm))


def quiet(contact: float, roll: float, tip_m: float, world: World = WORLD) -> Frame:
    """One frame without noise."""
    silent = replace(world, sensor=replace(world.sensor, std_Nm=1e-12))
    lateral = pushing(roll, tip_m, contact * LENGTH_M)
    rng = np.random.default_rng(0)
    return frames(silent, [contact * LENGTH_M], [lateral], [0.3], rng, sigma_px=0.0, points=200)[0]


def another(rig: Rig, world: World) -> Rig:
    """A rig that is what a world says."""
    return replace(
        rig,
        T_antenna_camera=world.T_antenna_camera,
        antenna=replace(rig.antenna, parameters=world.parameters),
        moment_sensor=world.sensor,
    )


def test_covariance_is_what_sampling_shows() -> None:
    """One contact under 120 draws of noise: the unknowns scatter as said, in every direction."""
    exact, rng = quiet(0.55, 0.6, 0.02), np.random.default_rng(1)
    rig = WORLD.rig(1e-6 * RIG_STD)
    several = [redrawn(exact, rng) for _ in range(120)]
    found = solved(several, rig)
    whole = np.linalg.inv(linearised(framed(several, rig), "rod", found.unknowns).information)
    drawn, said = found.unknowns[:, :3], whole[:, :3, :3].mean(axis=0)
    np.testing.assert_allclose(found.std.mean(axis=0)[:3], np.sqrt(np.diag(said)), rtol=0.03)
    assert np.trace(np.linalg.solve(said, np.cov(drawn.T))) / 3 == pytest.approx(1.0, abs=0.3)
    true = solved([exact], rig).unknowns[0, :3]
    off = drawn.mean(axis=0) - true
    assert off @ np.linalg.solve(said / 120, off) / 3 < 4.0


def test_the_rigs_part_is_what_other_rigs_show() -> None:
    """The same frame, with noise, on 40 rigs drawn from the covariance."""
    exact, rng = quiet(0.55, 0.6, 0.02), np.random.default_rng(2)
    std = 0.3 * RIG_STD
    believed = WORLD.rig(std)
    answers, said = [], []
    for _ in range(40):
        rig = another(believed, WORLD.moved(std * rng.normal(size=17)))
        one = solved([redrawn(exact, rng)], rig)
        units = np.array([1.0, *[RigArrays.from_rig(rig, 0.0).force_unit_N] * 2])
        answers.append(one.unknowns[0, :3] * units)
        said.append((one.std[0, :3] * units) ** 2)
    ratio = np.var(answers, axis=0) / np.mean(said, axis=0)
    assert ((ratio > 0.5) & (ratio < 1.7)).all(), ratio


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_the_rigs_table_is_its_derivative(friction: float) -> None:
    """Columns of the rig's table against moved rigs: picture, reading, contact point and force."""
    seen, rig = quiet(0.55, 0.6, 0.02), replace(WORLD.rig(RIG_STD), tip=Tip(1e-5, 3e-4, np.zeros(17)))
    at = framed([seen], rig, friction)
    rig_arrays, unknowns = at.rig_arrays, solved([seen], rig, friction=friction).unknowns
    here = linearised(at, "rod", unknowns)
    data = here.information[0] - np.diag(here.prior[0])
    size = np.sqrt(np.diag(data)[:, None] * np.diag(data))
    whole = rig.covariance_with_tip
    np.testing.assert_allclose(rig_arrays.axes @ rig_arrays.axes.T, whole, atol=1e-12 * whole.max())
    assert rig_arrays.axes.shape == (18, 18)
    for column in range(18):
        step = 0.02 * rig_arrays.axes[:, column]
        moved = framed([seen], rig.moved(step), friction)
        # the unit of force goes with the stiffness: the force itself is to stay
        scale = np.array([1.0, *[rig_arrays.force_unit_N / moved.rig_arrays.force_unit_N] * 2, 1.0])
        there = linearised(moved, "rod", unknowns * scale)
        at_rig = UNKNOWNS + column
        # where points lie on the curve, the normal equations' side goes as their information says
        side = there.side[0] - here.side[0]
        side[:UNKNOWNS] = there.side[0, :UNKNOWNS] * scale - here.side[0, :UNKNOWNS]
        limit = 0.03 * size[:, at_rig] + 0.02
        assert (np.abs(side / 0.02 + data[:, at_rig]) < limit).all()
        read = -(there.residual - here.residual) / 0.02
        by_rig = here.readings[..., at_rig]
        np.testing.assert_allclose(read, by_rig, atol=0.03 * np.abs(here.readings[..., UNKNOWNS:]).max() + 0.02)
        point_force = (there.point_force - here.point_force) / 0.02
        limits = 0.03 * np.abs(here.columns[..., UNKNOWNS:]).max(axis=-1) + 1e-9
        assert (np.abs(point_force - here.columns[..., at_rig]) < limits).all()


def test_the_antennas_end_tells_the_cameras_distance() -> None:
    """Rigs whose camera is too near or far by 3 mm: the end, known to 0.3 mm, tells most of it."""
    rng, std = np.random.default_rng(5), RIG_STD.copy()
    std[3:6] = 3e-3
    off: dict[bool, list[float]] = {False: [], True: []}
    said: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(24):
        true = WORLD.moved(std * rng.normal(size=17))
        seen = frames(true, [0.6 * LENGTH_M], [pushing(0.4, 0.02, 0.6 * LENGTH_M)], [0.3], rng, points=150)
        # a longer antenna would do as well
        length = Tip(0.0, 3e-4, np.zeros(17))
        for tip in (None, length):
            one = solved(seen, replace(WORLD.rig(std), tip=tip))
            off[tip is not None].append(one.unknowns[0, 0] * LENGTH_M - seen[0].distance_m)
            said[tip is not None].append(float(one.std[0, 0]) * LENGTH_M)
    for values in (off, said):
        alone, with_tip = (np.sqrt(np.mean(np.square(values[seen]))) for seen in (False, True))
        assert with_tip < 0.75 * alone
    for seen in (False, True):
        assert 0.6 < np.sqrt(np.mean((np.array(off[seen]) / said[seen]) ** 2)) < 1.5


def test_evidence_without_contact_follows_its_law() -> None:
    """χ²₃/2: mean and variance 1.5, a little more since the distance means nothing without a force. 72 free frames."""
    rng, found = np.random.default_rng(3), []
    for _ in range(8):
        believed = World(camera_pose(rng.uniform(0.0, 1.0), rng.uniform(-np.pi, np.pi)))
        true = believed.moved(RIG_STD * rng.normal(size=17))
        seen = frames(true, [0.1] * 9, np.zeros((9, 2)), rng.uniform(0, 1, 9), rng, points=150)
        found += solved(seen, believed.rig(), friction=0.2).evidence.tolist()
    assert 1.0 < np.mean(found) < 2.2
    assert 0.6 < np.var(found) < 3.5
    assert min(found) > -0.01
    assert max(found) < 0.7 * ContactSettings.contact_evidence
