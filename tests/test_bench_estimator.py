"""The estimator's benchmarks: scenes, bounds and pictures as they claim, and on a part of them their goals are met."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator import grid as estimator_grid
from benchmarks.estimator import rods as estimator_rods
from benchmarks.estimator.bound import QUANTITIES, bound, estimate, truth
from benchmarks.estimator.grid import summary
from benchmarks.estimator.hard import CASES, Hard, estimated, judged_at_random, resized, run
from benchmarks.estimator.rods import POPULATIONS
from benchmarks.estimator.scenes import (
    elastica_shapes,
    push_for_deflection,
    push_for_slope,
    random_scenes,
    rod_shapes,
    rolled,
    scenes,
)
from benchmarks.estimator.setup import ACROSS, RIG_STD, Setup
from benchmarks.waiting.frames import population

UPRIGHT = Setup("none").rig()


def test_towards_the_clamp_is_the_papers_inclined_camera() -> None:
    """Eq. (24): a point at height z is seen where a point of plane C at x + z·tan φ is."""
    tilt = 0.4
    rig = Setup("none", tilt).rig()
    points = np.array([[0.12, 0.0, 1e-5], [0.12 + 1e-5 * np.tan(tilt), 0.0, 0.0]])
    raised, shifted = rig.camera.project(rig.T_antenna_camera.inverse() @ points)[0]
    np.testing.assert_allclose(raised, shifted, atol=1e-6)


def test_elastica_and_rod_agree_on_a_weightless_antenna() -> None:
    """They share no code; slopes up to 35°, every roll, friction."""
    frames = random_scenes(UPRIGHT, 60, np.random.default_rng(0), made_by=elastica_shapes, friction_std_rad=0.2)
    again = scenes(UPRIGHT, frames.distance_m, frames.touches.push_N, frames.touches.friction_rad, made_by=rod_shapes)
    np.testing.assert_allclose(again.shapes.points_m, frames.shapes.points_m, atol=2e-8)
    np.testing.assert_allclose(again.force_N, frames.force_N, atol=1e-7)
    np.testing.assert_allclose(again.moment_Nm, frames.moment_Nm, atol=1e-8)
    np.testing.assert_allclose(again.shapes.tangent, frames.shapes.tangent, atol=1e-6)


@pytest.mark.parametrize("made_by", [elastica_shapes, rod_shapes])
def test_the_force_lies_at_the_friction_angle_and_the_antenna_keeps_its_length(made_by) -> None:
    rig = Setup("brown", 0.5, real=made_by is rod_shapes, swing_m=0.1).rig()
    frames = random_scenes(rig, 40, np.random.default_rng(1), made_by=made_by, friction_std_rad=0.2)
    size = np.linalg.norm(frames.force_N, axis=1)
    np.testing.assert_allclose(size, np.linalg.norm(frames.touches.push_N, axis=1), rtol=1e-9)
    along = (frames.force_N * frames.shapes.tangent).sum(axis=1) / size
    np.testing.assert_allclose(np.arcsin(-along), frames.touches.friction_rad, atol=1e-8)
    np.testing.assert_allclose(
        np.arctan2(frames.force_N[:, 2], frames.force_N[:, 1]),
        np.arctan2(frames.touches.push_N[:, 1], frames.touches.push_N[:, 0]),
        atol=1e-9,
    )
    spacing = np.linalg.norm(np.diff(frames.shapes.points_m, axis=1), axis=2)
    np.testing.assert_allclose(spacing, 0.24 / 200, rtol=1e-4)


def test_the_moment_of_a_real_antenna_holds_its_weight() -> None:
    """A push of nothing leaves the weight's: about half the length times the weight, of the sign of l·f_z."""
    rig = Setup(real=True).rig()
    frames = scenes(rig, np.full(2, 0.1), np.zeros((2, 2)), made_by=rod_shapes, tilt_rad=np.array([0.0, np.pi / 2]))
    weight = 0.24 * rig.antenna.mass_per_length_kg_m * 9.80665
    assert frames.moment_Nm[0] == pytest.approx(-0.12 * weight, rel=0.02)
    assert abs(frames.moment_Nm[1]) < 0.05 * abs(frames.moment_Nm[0])
    np.testing.assert_array_equal(frames.force_N, 0.0)


def test_the_bound_is_the_design_papers() -> None:
    """sd(l)/l = K_l·(σ/δ_c)/√N of small deflections under an upright camera, with the clamp known."""
    reach = np.array([0.1, 0.25, 0.5, 0.75, 0.9, 1.0])
    distance, deflection = reach * 0.24, 1e-3 * reach**2
    frames = scenes(UPRIGHT, distance, rolled(push_for_deflection(deflection, distance, 3.9e-3), 0.0))
    metres_per_px = UPRIGHT.T_antenna_camera.translation_m[2] / UPRIGHT.camera.matrix[0, 0]
    unit = 0.1 * metres_per_px / deflection / np.sqrt(200)
    std = bound(frames).std
    np.testing.assert_allclose(std[:, 0] / distance / unit, [4.33, 4.98, 6.78, 10.84, 16.43, 22.98], rtol=3e-3)
    force = frames.force_N[:, 1]
    np.testing.assert_allclose(std[:, 1] / force / unit, [8.44, 9.29, 11.59, 16.69, 23.66, 31.75], rtol=3e-3)
    # nothing but the moment holds f_z here
    np.testing.assert_allclose(std[:, 2], 2e-5 / distance, rtol=1e-2)


def test_what_is_known_less_well_widens_the_bound() -> None:
    exact = random_scenes(Setup("brown", 0.5, swing_m=0.1).rig(), 12, np.random.default_rng(5), made_by=elastica_shapes)
    least = bound(exact).std
    assert (bound(exact, friction_std_rad=0.2).std >= least * (1 - 1e-9)).all()
    assert (bound(exact, friction_std_rad=0.2).std[:, 0] > 1.01 * least[:, 0]).any()
    np.testing.assert_allclose(bound(exact, friction_std_rad=1e-6).std, least, rtol=1e-6)
    certain = replace(exact, rig=replace(exact.rig, covariance=1e-12 * np.diag(RIG_STD**2)))
    np.testing.assert_allclose(bound(certain).std, least, rtol=1e-4)
    rough = replace(exact, rig=replace(exact.rig, covariance=np.diag(RIG_STD**2)))
    assert (bound(rough).std[:, :2] > least[:, :2]).all()


def test_friction_is_told_by_steep_antennas_alone() -> None:
    """What a light push has along the antenna bends nothing: the force stays as uncertain as the prior of its angle."""
    distance = np.full(2, 0.12)
    pushed = rolled(push_for_slope(np.array([0.05, 0.6]), distance, 3.9e-3), 0.5)
    frames = scenes(Setup("none", 0.5, ACROSS, swing_m=0.1).rig(), distance, pushed)
    size = np.linalg.norm(frames.force_N, axis=1)
    light, steep = bound(frames, friction_std_rad=0.2).force_std / size
    assert light == pytest.approx(0.2, rel=0.05)
    assert steep < 0.18
    assert (bound(frames).force_std / size < [0.05, 0.01]).all()


def test_a_plane_seen_edge_on_has_no_bound() -> None:
    """A camera in the plane of bending sees a straight line, whatever touches; the moment alone does not hold l."""
    rig = Setup("none", np.radians(60.0), ACROSS).rig()
    frames = scenes(rig, np.array([0.12, 0.12]), rolled(np.array([0.05, 0.05]), np.radians([30.0, -30.0])))
    edge_on, ordinary = bound(frames).std[:, 0]
    assert ordinary < 0.05 * 0.12
    assert edge_on > 0.12


def test_the_estimator_reaches_the_bound_on_a_part_of_the_grid() -> None:
    """One rig, 15 cells: squares of l, f_y and f_z over their bounds within what one run in 10,000 exceeds."""
    rows = estimator_grid.run(8, 0, lenses=("brown",), tilts_deg=(30.0,))
    assert all(row.without_numbers == 0.0 for row in rows)
    for quantity in QUANTITIES:
        squares = np.mean([row.of_bound**2 for row in rows if row.quantity == quantity])
        assert abs(squares - 1.0) < 4 * np.sqrt(2 / 120), quantity


def test_the_estimator_is_not_biased_by_its_model_on_the_rod() -> None:
    rows = estimator_rods.run(40, 0, chosen=POPULATIONS[:1])
    assert rows[0].small_bias >= 0.95
    assert rows[0].location < 0.01
    assert rows[0].force < 0.02
    noiseless = random_scenes(POPULATIONS[0].setup.rig(), 3, np.random.default_rng(9))
    assert (np.abs(estimate(noiseless, "rod", 0.0).values - truth(noiseless))[:, 0] < 2e-4).all()


@pytest.mark.slow
def test_the_whole_grid_meets_its_goals() -> None:
    rows = estimator_grid.run(100, 3)
    assert not [row.cell for row in rows if row.left_out]
    assert np.mean([row.without_numbers for row in rows]) < 2e-3
    for line in summary(rows):
        # of 1620 numbers one in six hundred may lie beyond by noise alone
        assert line.clearly <= 2, line
        assert not {"of_bound": line.pooled > 1.02, "bias": abs(line.pooled) > 0.05}.get(line.measure, False), line


@pytest.mark.slow
@pytest.mark.parametrize("number", range(4))
def test_the_rod_meets_its_goals(number: int) -> None:
    (row,) = estimator_rods.run(400, 4, chosen=[POPULATIONS[number]])
    # the goal, less two standard errors of so many frames
    assert row.small_bias >= 0.98
    assert row.location <= 0.01
    assert row.force <= 0.02
    assert 0.92 < row.l_covered < 0.98


def test_hard_cases_never_raise_and_keep_to_their_deviations() -> None:
    rows = run(4, 1)
    assert [row.case for row in rows] == list(CASES)
    assert not [row.exception for row in rows if row.exception]
    by_case = {row.case: row for row in rows}
    for name in ("δ → 0", "all points in one place", "ξ = 90°, upright camera", "2 points"):
        assert by_case[name].numbered == 0.0
    for name in ("τ = 0", "40 % missing", "float32 pixels", "1000 times larger", "1000 times smaller"):
        row = by_case[name]
        assert row.numbered == 1.0
    for row in rows:
        assert max(row.l_max_std or 0.0, row.f_max_std or 0.0) < 6.0, row.case


def test_size_does_not_matter() -> None:
    """The same noise on a rig 1000 times larger gives the same answer, in its own units."""
    frames = population(Setup().rig(), 5, 3).scenes
    length, large = frames.rig.antenna.length_m, resized(frames.rig, 1e3)
    twin = replace(frames, rig=large, moment_Nm=1e3 * frames.moment_Nm)
    ours, theirs = (estimated(Hard(each), "elastica").distance_m for each in (frames, twin))
    np.testing.assert_allclose(theirs / (1e3 * length), ours / length, rtol=1e-6)


def test_frames_at_random_are_never_wrong_with_confidence() -> None:
    rows = [judged_at_random(5, chunk, 16) for chunk in (0, 1)]
    assert [row.frames for row in rows] == [16, 16]
    assert sum(row.exceptions + row.nan + row.imagined + row.beyond for row in rows) == 0
    assert all(row.claimed > 0 for row in rows)
