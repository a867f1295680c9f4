"""A recording as one: laws that hold whatever is recorded, and whether its deviations hold over rigs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.estimator.setup import ACROSS, LENGTH_M, drawn_truth
from benchmarks.object.scenes import AXIS, CASES, CENTRE, RIGID, SETUP, Recorded, contacts, play
from benchmarks.recording.recording import CELLS, PIN_M, PIN_STD_M, lengthened, measured, played, run
from estimator.object.estimate import estimate_object
from estimator.recording import Refined, refine
from estimator.recording.refined import begun
from estimator.recording.solve import solved
from estimator.table.contacts import ContactTable, Measured
from vbaa_calib.session import KnownObject
from vbaa_calib.simulate.scene.scene import camera_pose

FRAMES = 74
CALIBRATED = replace(SETUP, exact=False).rig()


def recording(seed: int, frames: int = FRAMES, off: float = 1.0) -> Recorded:
    """Two strokes on a cylinder; the rig is off by so many draws of its covariance."""
    rng = np.random.default_rng(seed)
    given = drawn_truth(CALIBRATED.with_covariance(off**2 * CALIBRATED.covariance), rng)
    return lengthened(played("cylinder", RIGID, 0.3), frames).noisy(rng, given.with_covariance(CALIBRATED.covariance))


@cache
def given() -> tuple[Recorded, ContactTable, list[Measured], Refined]:
    recorded = recording(5)
    table, lines = contacts(recorded), measured(recorded)
    return recorded, table, lines, refine(table, recorded.given, lines)


def off_in_deviations(one: ContactTable, other: ContactTable, rows: np.ndarray) -> np.ndarray:
    return np.abs(one.distance_m - other.distance_m)[rows] / one.distance_std_m[rows]


def test_one_frame_gets_its_own_answer() -> None:
    recorded, table, lines, _ = given()
    for row in np.flatnonzero(table.located)[4:40:12]:
        alone = refine(table.picked([row]), recorded.given, [lines[row]])
        assert not alone.reason
        assert off_in_deviations(alone.contacts, table.picked([row]), np.array([0])) < 0.1
        assert alone.contacts.distance_std_m == pytest.approx(table.distance_std_m[[row]], rel=0.05)


def test_own_and_shared_parts_add_up() -> None:
    """What is left without the shared part is what a rig that is known exactly would leave."""
    _, table, lines, found = given()
    exact = found.rig.with_covariance(1e-12 * found.rig.covariance)
    start = replace(table, friction_prior_rad=np.where(found.refined, 0.2, np.nan))
    alone = refine(start, exact, lines)
    rows = np.flatnonzero(found.refined & alone.refined & np.isfinite(found.contacts.distance_m))
    own = np.sqrt(found.contacts.distance_std_m**2 - found.contacts.distance_shared_std_m**2)[rows]
    known = np.sqrt(alone.contacts.distance_std_m**2 - alone.contacts.distance_shared_std_m**2)[rows]
    assert own == pytest.approx(known, rel=0.1)
    shared = found.contacts.point_shared_std_m[rows]
    assert (shared**2 <= np.einsum("bii->bi", found.contacts.covariance_world_m2[rows]) * (1 + 1e-9)).all()


@cache
def bowed_and_rolled() -> Recorded:
    """A strongly bowed antenna on a sphere, seen aslant by a rolled camera on a rig that is known three times worse."""
    rig = replace(SETUP, exact=False).rig()
    parameters = rig.antenna.parameters.copy()
    parameters[4:6] = 0.42, -0.31
    pose = camera_pose(1.05, ACROSS, np.pi / 2, 0.42, np.array([LENGTH_M / 2, 0.0, 0.0]))
    antenna = replace(rig.antenna, parameters=parameters)
    rig = replace(rig, T_antenna_camera=pose, antenna=antenna, covariance=9.0 * rig.covariance)
    sphere = next(case for case in CASES if case.name == "sphere")
    return replace(lengthened(play(rig, sphere.make(RIGID, 0.0), sphere.strokes[:2], points=500), 20), sigma_px=0.03)


@pytest.mark.parametrize("seed", [1, 11])
def test_steps_come_to_an_end_where_lines_err_more_than_stated(seed: int) -> None:
    """Neighbouring points err alike, so that frames scatter about as much as makes them trusted less."""
    played, rng = bowed_and_rolled(), np.random.default_rng(seed)
    true = drawn_truth(played.given, rng)
    recorded = played.noisy(rng, true.with_covariance(played.given.covariance))
    apart = np.subtract.outer(np.arange(500), np.arange(500)) / 15.0
    root = np.linalg.cholesky(np.exp(-0.5 * apart**2) + 1e-8 * np.eye(500))
    lines_px = recorded.centrelines_px + 0.016 * root @ rng.normal(size=recorded.centrelines_px.shape)
    recorded = replace(recorded, centrelines_px=lines_px)
    table = contacts(recorded)
    rows = np.flatnonzero(table.located)
    problem, start = begun(table, recorded.given, measured(recorded), rows, None)
    found = solved(problem, start, np.zeros(len(rows)))
    assert found.converged


def test_the_order_of_frames_does_not_matter() -> None:
    recorded, table, lines, _ = given()
    timeless = replace(table, time_s=np.full(len(table), np.nan))
    order = np.random.default_rng(0).permutation(len(table))
    first = refine(timeless, recorded.given, lines)
    other = refine(timeless.picked(order), recorded.given, [lines[row] for row in order])
    rows = np.flatnonzero(first.refined)
    back = other.contacts.picked(np.argsort(order))
    assert off_in_deviations(first.contacts, back, rows).max() < 0.05
    assert back.distance_std_m[rows] == pytest.approx(first.contacts.distance_std_m[rows], rel=1e-2)


def test_a_frame_that_does_not_belong_does_not_move_the_rest() -> None:
    recorded, table, lines, found = given()
    row = int(np.flatnonzero(found.refined)[20])
    bent = lines[row].points_px + np.linspace(0.0, 3.0, len(lines[row].points_px))[:, None] ** 2 * [0.0, 0.5]
    strange = [replace(each, points_px=bent) if index == row else each for index, each in enumerate(lines)]
    without = refine(table, recorded.given, strange)
    assert without.foreign[row] or off_in_deviations(without.contacts, found.contacts, np.array([row])) > 3.0
    rest = np.flatnonzero(found.refined & without.refined & (np.arange(len(table)) != row))
    assert off_in_deviations(found.contacts, without.contacts, rest).max() < 0.3


def test_a_stroke_with_another_camera_pose_is_named() -> None:
    """Of three, the last was recorded after the camera had been knocked."""
    recorded = recording(6, 111)
    table, lines = contacts(recorded), measured(recorded)
    late = recorded.stroke == 2
    lines = [replace(each, points_px=each.points_px + 2.0 * moved) for each, moved in zip(lines, late, strict=True)]
    found = refine(table, recorded.given, lines)
    assert found.foreign[late & table.located].mean() > 0.9 or found.reason
    kept = table.located & ~found.refined
    assert (found.contacts.distance_m[kept] == table.distance_m[kept]).all()


def test_a_zero_that_walks_is_named_and_the_contacts_come_back() -> None:
    recorded = recording(8, 111)
    walk = np.linspace(0.0, 20.0, len(recorded)) * recorded.true.moment_sensor.std_Nm
    walked = replace(recorded, moment_Nm=recorded.moment_Nm + walk)
    found = refine(contacts(walked), walked.given, measured(walked))
    assert "zero walks" in found.reason
    assert not found.refined.any()


def test_a_camera_that_turns_while_the_recording_lasts_is_allowed_for() -> None:
    recorded = recording(9, 111)
    aside = np.linspace(0.0, 0.03, len(recorded))[:, None, None] * np.array([0.3, 0.95])
    moved = replace(recorded, centrelines_px=recorded.centrelines_px + aside)
    still, found = (refine(contacts(each), each.given, measured(each)) for each in (recorded, moved))
    assert still.trend_p > 1e-3
    assert (found.trend_p < 1e-4 and found.notes) or found.reason
    rows = found.refined & recorded.truth.in_contact
    off = (found.contacts.distance_m - recorded.truth.distance_m)[rows] / found.contacts.distance_std_m[rows]
    assert np.sqrt(np.mean(off**2)) < 1.3


def test_another_rig_is_refused_and_the_contacts_come_back() -> None:
    recorded = recording(7)
    table, lines = contacts(recorded), measured(recorded)
    other = drawn_truth(CALIBRATED.with_covariance(64.0 * CALIBRATED.covariance), np.random.default_rng(1))
    found = refine(table, other.with_covariance(CALIBRATED.covariance), lines)
    assert found.reason
    assert found.contacts is table
    assert not found.refined.any()


def test_the_stiffness_is_known_better_than_frame_by_frame() -> None:
    """A rigid object's compliance is none, within its deviation."""
    recorded, table, _, found = given()
    framewise, refined = estimate_object(table, recorded.given, events=False).compliance, found.object.compliance
    assert refined.std_m_N < framewise.std_m_N
    assert abs(refined.compliance_m_N) < 3.0 * refined.std_m_N


def test_nothing_is_known_better_than_the_rig_allows() -> None:
    _, table, _, found = given()
    rows = found.refined
    assert (found.contacts.distance_std_m[rows] < 1.05 * table.distance_std_m[rows]).all()
    left = found.rig.covariance
    assert (np.diag(left) <= np.diag(found.calibrated.covariance) * (1 + 1e-9)).all()


def test_a_pin_at_a_known_place_recalibrates() -> None:
    rng = np.random.default_rng(3)
    wide = CALIBRATED.with_covariance(9.0 * CALIBRATED.covariance)
    off = drawn_truth(wide, rng).with_covariance(CALIBRATED.covariance)
    touched = lengthened(played("pin", RIGID, 0.1), 148).noisy(rng, off)
    table = contacts(touched)
    found = refine(table, off, measured(touched), KnownObject("pin", CENTRE, AXIS, PIN_STD_M, PIN_M))
    assert not found.reason
    right = found.refined & touched.truth.in_contact
    before, after = (
        np.sqrt(np.mean((each.distance_m - touched.truth.distance_m)[right] ** 2)) for each in (table, found.contacts)
    )
    assert after < 0.1 * before


@pytest.mark.parametrize(("draws", "cells"), [(1, [1]), pytest.param(10, [1, 6], marks=pytest.mark.slow)])
def test_intervals_hold_over_rigs(draws: int, cells: list[int]) -> None:
    rows = run(draws, 4, [CELLS[cell] for cell in cells])
    assert all(row.ratio < 0.65 for row in rows)
    assert all(0.9 < row.distance_held < 0.99 for row in rows)
    assert all(0.9 < row.point_held < 0.995 for row in rows)
    assert all(row.mu_held == 1.0 for row in rows)
