"""Smoothing: nearer to the truth, with covariances that sampling confirms, and never across a break."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.setup import Setup
from estimator.contact.common_errors import CommonErrors
from estimator.object.track import follow, smooth
from estimator.object.track.smooth import _kalman_smooth, _smoothable_pieces, _walk_intensity
from estimator.table.contacts import ContactTable

from .track_tables import Rubbed, rubbed, rubbed_table

RIG = Setup(real=True, exact=True).rig()
COUNT = 50


def swaying() -> Rubbed:
    """It never rests, and never stops slipping."""
    sizes, paces = (5e-3, 6e-3, 8e-3), (9.0, 14.0, 11.0)
    along, aside, walk = (size * np.sin(np.arange(COUNT) / pace) for size, pace in zip(sizes, paces, strict=True))
    return rubbed(along, 0.012 + aside, walk)


def seen(truth: Rubbed, seed: int) -> tuple[ContactTable, CommonErrors]:
    """A table whose covariances hold a common error that moves all points alike, and what is shared."""
    table = rubbed_table(truth, np.random.default_rng(seed))
    modes = np.tile(2e-3 * np.eye(3), (COUNT, 1, 1))
    shared = CommonErrors(modes, 0.0 * modes, 0.0 * modes, table.covariance_world_m2)
    return replace(table, covariance_world_m2=table.covariance_world_m2 + 4e-6 * np.eye(3)), shared


def test_smoothed_points_are_nearer_and_worth_what_they_say() -> None:
    """Without a common error in the points, so that what is left is the own part: its normalised error squared is 1."""
    truth, raw, left, normalised, distances = swaying(), [], [], [], []
    for seed in range(12):
        table, shared = seen(truth, seed)
        found = smooth(table, RIG, shared)
        away = found.point_world_m - truth.point_m
        own = found.covariance_world_m2 - 4e-6 * np.eye(3)
        normalised.append(np.einsum("bi,bij,bj->b", away, np.linalg.inv(own), away) / 3.0)
        raw.append(((table.point_world_m - truth.point_m) ** 2).sum())
        left.append((away**2).sum())
        distances.append((found.distance_m - truth.distance_m) / found.distance_std_m)
    assert np.sum(left) < 0.4 * np.sum(raw)
    assert 0.7 < np.mean(normalised) < 1.35
    assert 0.7 < np.std(distances) < 1.3


def test_the_calibrations_part_is_untouched() -> None:
    table, shared = seen(swaying(), 1)
    found = smooth(table, RIG, shared)
    smallest = np.linalg.eigvalsh(found.covariance_world_m2)[:, 0]
    assert (smallest >= 4e-6 * (1.0 - 1e-9)).all()
    before, after = (np.trace(each.covariance_world_m2, axis1=1, axis2=2) for each in (table, found))
    assert (after < before).all()


def test_world_and_antenna_frame_stay_one_point() -> None:
    table, shared = seen(swaying(), 2)
    found = smooth(table, RIG, shared)
    rotation, origin = RIG.kinematics.world_antenna(found.pan_rad, found.tilt_rad)
    np.testing.assert_allclose(
        np.einsum("bij,bj->bi", rotation, found.point_antenna_m) + origin, found.point_world_m, atol=1e-12
    )
    np.testing.assert_allclose(
        np.einsum("bij,bj->bi", rotation, np.column_stack([np.zeros(COUNT), found.force_y_N, found.force_z_N])),
        found.force_world_N,
        atol=1e-6,
    )


def test_a_break_is_not_smoothed_over() -> None:
    aside = np.where(np.arange(COUNT) >= 25, 15e-3, 0.0)
    truth = rubbed(np.zeros(COUNT), aside, np.zeros(COUNT))
    table, shared = seen(truth, 3)
    track = follow(table, RIG, shared)
    several = _smoothable_pieces(table, track)
    assert len(several) == 2
    assert abs(several[1][0] - 25) <= 3
    step = np.where(np.arange(COUNT) >= several[1][0], 0.01, 0.0)[:, None] * [0.0, 0.0, 1.0]
    points = {"point_world_m": table.point_world_m + step, "point_antenna_m": table.point_antenna_m + step}
    before, after = (smooth(each, RIG, shared, track) for each in (table, replace(table, **points)))
    np.testing.assert_array_equal(before.point_world_m[several[0]], after.point_world_m[several[0]])
    assert (before.point_world_m[several[1]] != after.point_world_m[several[1]]).any()


def test_without_a_walk_the_smoother_is_the_straight_line() -> None:
    """By another route: with no random walk it is the weighted least-squares line, covariance included."""
    rng = np.random.default_rng(5)
    time, variance = np.sort(rng.uniform(0.0, 1.0, 15)), rng.uniform(0.5, 2.0, 15)
    values = 3.0 - 2.0 * time + np.sqrt(variance) * rng.normal(size=15)
    found, left = _kalman_smooth(time, values[:, None], variance[:, None, None], np.zeros(1))
    design = np.column_stack([np.ones(15), time])
    covariance = np.linalg.inv(design.T @ (design / variance[:, None]))
    expected = design @ covariance @ design.T @ (values / variance)
    np.testing.assert_allclose(found[:, 0], expected, rtol=2e-2, atol=2e-2)
    np.testing.assert_allclose(left[:, 0, 0], np.diag(design @ covariance @ design.T), rtol=2e-2)


def test_the_walk_is_found_again() -> None:
    rng, found = np.random.default_rng(6), []
    for _ in range(10):
        speed = np.cumsum(np.sqrt(2.0 * 0.001) * rng.normal(size=10_000))
        path = np.cumsum(0.001 * speed)[::50]
        found.append(_walk_intensity(0.05 * np.arange(200), path + 0.02 * rng.normal(size=200), np.full(200, 4e-4)))
    assert np.median(found) == pytest.approx(2.0, rel=0.35)
