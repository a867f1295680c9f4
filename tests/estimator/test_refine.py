"""A recording as one, by one camera or several: laws that hold whatever is recorded, and coverage over rigs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.estimator.setup import ACROSS, Setup, drawn_truth
from benchmarks.object.scenes import AXIS, CASES, CENTRE, PIN_M, RIGID, SETUP, Recorded, contacts, play
from benchmarks.recording import CELLS, bound_m, lengthened, measured, played, run
from estimator.recording import Refined, refine
from estimator.table.contacts import ContactTable, Measured
from vbaa_calib.rig import Rig
from vbaa_calib.session import KnownObject
from vbaa_calib.session.drift import DRIFTS
from vbaa_calib.simulate.scene.objects import TouchObject

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
        alone = refine(table.picked(np.array([row])), recorded.given, [lines[row]])
        assert not alone.reason
        assert off_in_deviations(alone.contacts, table.picked(np.array([row])), np.array([0])) < 0.1
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


def test_a_frame_that_does_not_belong_does_not_move_the_rest() -> None:
    recorded, table, lines, found = given()
    row = int(np.flatnonzero(found.refined)[20])
    bent = lines[row].points_px + np.linspace(0.0, 3.0, len(lines[row].points_px))[:, None] ** 2 * [0.0, 0.5]
    strange = [replace(each, points_px=bent) if index == row else each for index, each in enumerate(lines)]
    without = refine(table, recorded.given, strange)
    assert without.foreign[row] or off_in_deviations(without.contacts, found.contacts, np.array([row])) > 3.0
    rest = np.flatnonzero(found.refined & without.refined & (np.arange(len(table)) != row))
    assert off_in_deviations(found.contacts, without.contacts, rest).max() < 0.3


def test_what_bends_all_lines_alike_is_within_the_stated_deviation() -> None:
    """By as much as single lines scatter: with so many frames their noise is far less."""
    recorded, table, lines, _ = given()
    rig = replace(recorded.given, drift=replace(DRIFTS["lab"], line_px=0.02))
    plain = refine(table, rig, lines)
    for degree in (3, 4):
        term = np.polynomial.legendre.Legendre.basis(degree)
        bends = [
            0.02 * term(np.linspace(-1.0, 1.0, len(each.points_px)))[:, None] * np.array([0.0, 1.0]) for each in lines
        ]
        bent = [replace(each, points_px=each.points_px + bend) for each, bend in zip(lines, bends, strict=True)]
        found = refine(table, rig, bent).contacts
        off = (found.distance_m - plain.contacts.distance_m) / plain.contacts.distance_shared_std_m
        assert np.sqrt(np.mean(off[plain.refined] ** 2)) < 1.0


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


def test_another_rig_is_refused_and_the_contacts_come_back() -> None:
    recorded = recording(7)
    table, lines = contacts(recorded), measured(recorded)
    other = drawn_truth(CALIBRATED.with_covariance(64.0 * CALIBRATED.covariance), np.random.default_rng(1))
    found = refine(table, other.with_covariance(CALIBRATED.covariance), lines)
    assert found.reason
    assert found.contacts is table
    assert not found.refined.any()


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
    found = refine(table, off, measured(touched), KnownObject("pin", CENTRE, AXIS, 5e-5, PIN_M))
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
    assert all(0.9 < row.distance_covered < 0.99 for row in rows)
    assert all(0.9 < row.point_covered < 0.995 for row in rows)
    assert all(row.mu_covered == 1.0 for row in rows)


# the first looks along plane C's normal: pushes along it (ξ = 90°) leave its picture straight
SETUPS = [Setup("brown", tilt_rad, ACROSS, swing_m=0.06, real=True) for tilt_rad in (0.0, 1.0)]
PUSHED_AWAY = [stroke for case in CASES if case.name == "sphere" for stroke in case.strokes if stroke.press == "tilt"]


@cache
def shown() -> list[Recorded]:
    ball = TouchObject("sphere", CENTRE, AXIS, 0.03, 1.0, RIGID, 0.3)
    return [play(setup.rig(), ball, PUSHED_AWAY) for setup in SETUPS]


@cache
def seen(seed: int) -> tuple[list[Recorded], ContactTable, list[list[Measured]], Rig]:
    """The recording by both cameras of one calibration, what the first finds frame by frame, and the rig of both."""
    rng = np.random.default_rng((31, seed))
    first, other = (replace(setup, exact=False).rig() for setup in SETUPS)
    both = drawn_truth(replace(first, others={"other": other}), rng)
    several = [one.noisy(rng, rig) for one, rig in zip(shown(), both.cameras.values(), strict=True)]
    return several, contacts(several[0]), [measured(each) for each in several], both


@cache
def alone(seed: int) -> Refined:
    both, table, lines, _ = seen(seed)
    return refine(table, both[0].given, lines[0])


@cache
def together(seed: int) -> Refined:
    _, table, lines, rig = seen(seed)
    return refine(table, rig, joined(*lines))


def joined(one: list[Measured], other: list[Measured]) -> list[Measured]:
    return [replace(each, others={"other": seen_too}) for each, seen_too in zip(one, other, strict=True)]


@pytest.mark.parametrize("draws", [3, pytest.param(12, marks=pytest.mark.slow)])
def test_what_is_edge_on_to_one_camera_is_located_at_the_bound_by_two(draws: int) -> None:
    square, allowed, held = [], [], []
    for seed in range(draws):
        both, table, lines, _ = seen(seed)
        found, truth = together(seed), both[0].truth
        blind = np.flatnonzero(truth.in_contact & ~table.located)
        assert len(blind) > 10
        assert np.mean(found.refined[blind]) > 0.9
        rows = blind[found.refined[blind]]
        off = (found.contacts.point_world_m - truth.point_world_m)[rows]
        true = replace(both[1].true, covariance=both[1].given.covariance)
        bound = bound_m(found.contacts, both[0], joined(*lines), rows, true)
        std = found.contacts.distance_std_m[rows]
        square.append(np.sum(off**2, axis=1))
        allowed.append(bound**2)
        held.append(np.abs(found.contacts.distance_m[rows] - truth.distance_m[rows]) < 1.96 * std)
    assert np.sqrt(np.concatenate(square).mean() / np.concatenate(allowed).mean()) < 1.15
    assert np.concatenate(held).mean() > 0.9
