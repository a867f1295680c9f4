"""Contacts from centrelines of the static rod: accuracy, honest deviations, and the borders of the library."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.rig import Rig

from ..rod_scenes import LENGTH_M, RIG_STD, SIGMA_PX, STIFFNESS_NM2, Frame, World, camera_pose, frames, pushing
from .contact_scenes import RIG, deviations, estimated, estimated_together, frame, point_nees


def mixed(rng: np.random.Generator, worlds: int, each: int) -> list[tuple[Rig, list[Frame]]]:
    """Frames over inclined cameras, joint tilts, distances and rolls, on rigs that are off as their covariance says."""
    result = []
    for _ in range(worlds):
        believed = World(camera_pose(np.radians(rng.uniform(0, 60)), rng.uniform(-np.pi, np.pi)))
        true = believed.moved(RIG_STD * rng.normal(size=17))
        contact, roll = rng.uniform(0.3, 0.95, each) * LENGTH_M, rng.uniform(-np.pi, np.pi, each)
        lateral = [
            pushing(turn, tip, at) for turn, tip, at in zip(roll, rng.uniform(0.006, 0.04, each), contact, strict=True)
        ]
        result.append((believed.rig(), frames(true, contact, lateral, rng.uniform(0, np.pi / 3, each), rng)))
    return result


def test_errors_are_what_the_deviations_say() -> None:
    """Camera 0–60° inclined, joints tilted 0–60°, l/L 0.3–0.95, any roll, 66 frames on 11 rigs."""
    scenes = mixed(np.random.default_rng(11), worlds=11, each=6)
    found = [
        pair for rig, seen in scenes for pair in zip(estimated_together(seen, rig, friction=0.0), seen, strict=True)
    ]
    contacts = [contact for contact, _ in found]
    good = [(contact, seen) for contact, seen in found if contact.status == "ok"]
    assert len(good) >= 60
    # whatever is not given out must say why
    silent = {contact.status for contact in contacts} - {"ok"}
    assert silent <= {"unobservable", "low_signal", "tip_contact"}
    squares = np.array([deviations(contact, seen) for contact, seen in good]) ** 2
    assert ((squares.mean(axis=0) > 0.5) & (squares.mean(axis=0) < 1.6)).all(), squares.mean(axis=0)
    assert 0.5 < np.array([point_nees(contact, seen) for contact, seen in good]).mean() < 1.6
    assert np.median([contact.distance_std_m for contact, _ in good]) < 1.5e-3


def test_one_contact_in_all_its_numbers() -> None:
    seen = frame()
    contact = estimated(seen)
    assert contact.status == "ok"
    assert contact.in_contact
    assert np.abs(deviations(contact, seen)).max() < 3.5
    assert contact.distance_m == pytest.approx(seen.distance_m, abs=1e-3)
    np.testing.assert_allclose(contact.force_N[1:], seen.force_N[1:], atol=0.02 * np.linalg.norm(seen.force_N))
    # along the antenna the force is what friction makes of it
    assert abs(contact.force_N[0] - seen.force_N[0]) < 3.0 * contact.force_std_N[0]
    slippery = estimated(seen, friction=0.0)
    np.testing.assert_allclose(slippery.force_N, seen.force_N, atol=0.02 * np.linalg.norm(seen.force_N))
    assert slippery.friction_angle_rad == 0.0
    np.testing.assert_allclose(contact.point_world_m, seen.contact_world_m, atol=1e-3)
    rotation = RIG.kinematics.T_world_antenna(0.0, seen.tilt_rad)
    np.testing.assert_allclose(rotation @ contact.point_antenna_m, contact.point_world_m, atol=1e-12)
    np.testing.assert_allclose(rotation.rotation @ contact.force_N, contact.force_world_N, atol=1e-12)
    # deflected along the force, by what the paper's beam says to first order
    beam = seen.force_N * seen.distance_m**3 / (3 * STIFFNESS_NM2)
    np.testing.assert_allclose(contact.deflection_m[1:], beam[1:], rtol=0.15)
    assert abs(contact.moment_residual_Nm) < 1e-4
    assert (np.linalg.eigvalsh(contact.covariance_world_m2) > 0).all()


@pytest.mark.parametrize(("contact", "roll"), [(0.3, -2.6), (0.6, 0.1), (0.95, -2.6)])
def test_large_deflections(contact: float, roll: float) -> None:
    """The tip is pushed 60 mm aside, slopes beyond 20°."""
    seen = frame(contact, roll, 0.06)
    result = estimated(seen)
    assert result.status == "ok"
    assert np.abs(deviations(result, seen)).max() < 4.0


def test_outliers_do_not_pull() -> None:
    """A fifth of the points lies anywhere within tens of pixels."""
    several = []
    for seed in range(8):
        seen = frame(roll=0.4 + seed, seed=seed)
        rng = np.random.default_rng(100 + seed)
        points = seen.points_px.copy()
        points[rng.permutation(len(points))[: len(points) // 5]] += rng.normal(0.0, 20.0, (len(points) // 5, 2))
        several.append(replace(seen, points_px=points))
    found = estimated_together(several)
    assert set(found.status) == {"ok"}
    assert np.mean([deviations(*pair) ** 2 for pair in zip(found, several, strict=True)]) < 2.5


def test_where_a_free_antenna_would_be_touched_is_not_searched() -> None:
    """Nothing holds that distance; the evidence for a contact stays that of three numbers fitted to noise."""
    found = estimated_together([frame(tip_m=0.0, seed=seed) for seed in range(100)])
    assert set(found.status) == {"no_contact"}
    assert found.numbers.converged.all()
    assert np.median(found.numbers.evaluations) <= 5
    assert 0.5 < found.evidence.mean() < 2.5


def test_rows_with_nan_are_left_out() -> None:
    seen = frame()
    points, sigma = seen.points_px.copy(), np.full(len(seen.points_px), SIGMA_PX)
    points[::7, 0], points[3::7, 1] = np.nan, np.inf
    sigma[::7] = np.nan
    kept = np.isfinite(points).all(axis=1)
    shuffled = np.random.default_rng(1).permutation(len(points))
    points, sigma, kept = points[shuffled], sigma[shuffled], kept[shuffled]
    with_nan = estimated(replace(seen, points_px=points), sigma_px=np.where(kept, SIGMA_PX, sigma))
    without = estimated(replace(seen, points_px=points[kept]))
    # other points are the first to be looked at, so that the descent begins elsewhere
    assert with_nan.distance_m == pytest.approx(without.distance_m, abs=0.1 * without.distance_std_m)
    nothing = estimated(replace(seen, points_px=np.full((50, 2), np.nan)))
    assert nothing.status == "no_antenna"


def test_a_reading_that_is_not_there_is_vision_alone() -> None:
    """None, and NaN as in a recording's table."""
    seen = frame()
    nothing, nan = (estimated(seen, moment=moment) for moment in (None, np.nan))
    assert nothing.status == "ok"
    assert np.isnan(nothing.moment_residual_Nm)
    assert nothing.distance_m == nan.distance_m
    assert nothing.force_std_N[2] > 2.0 * estimated(seen).force_std_N[2]
