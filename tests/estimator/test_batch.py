"""One frame, a batch, a recording, in any number of threads: the same answers."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.estimator.scenes import Scenes
from estimator import Contact, ContactEstimator, Measured

from ..rod_scenes import RIG_STD, SIGMA_PX, World, camera_pose
from .contact_scenes import RIG, WORLD, answered, deviations, frame, furthest, rubbed

STANDSTILL = 0.015
"""In standard deviations. A descent ends when a step promises less than 1e-4 of the cost, √(2·1e-4) of a deviation: two
that differ by rounding alone, or begin elsewhere, may end one step apart."""
SIGMA = 0.05


@cache
def scenes() -> Scenes:
    """24 frames over all rungs, with friction, weight, bow and noise."""
    rng, count = np.random.default_rng(5), 24
    contact, slope = rng.uniform(0.2, 0.98, count), rng.uniform(0.5, 30.0, count)
    roll, friction = rng.uniform(-3.0, 3.0, count), rng.normal(0.0, 0.2, count)
    contact[:3], slope[:3], roll[:3] = 0.6, (0.6, 33.0, 34.0), 0.4
    return rubbed(WORLD.rig(np.zeros(17)), contact, slope, friction, roll, sigma_px=SIGMA, points=120).noisy(rng)


@cache
def alone() -> list[Contact]:
    """Each frame by itself."""
    estimator, given = ContactEstimator(scenes().rig), scenes()
    return [
        estimator.estimate(points, moment=float(moment), pan=0.0, tilt=0.0, sigma_px=SIGMA)
        for points, moment in zip(given.points_px, given.moment_Nm, strict=True)
    ]


def test_a_frame_alone_is_a_frame_of_a_batch() -> None:
    order = np.random.default_rng(2).permutation(24)
    together = answered(scenes().picked(order))
    assert {contact.model for contact in alone()} >= {"linear", "elastica"}
    assert sum(contact.status == "ok" for contact in alone()) >= 20
    for index, many in zip(order, together, strict=True):
        assert furthest(alone()[index], many) == 0.0


def test_threads_change_no_bit() -> None:
    """40 frames are several threads' work; those of another order are, too."""
    given = scenes().picked(np.arange(40) % 24)
    first, *others = (answered(given, jobs=jobs).numbers for jobs in (1, 2, 3))
    assert len(set(first.rung)) > 1
    for other in others:
        for name in first.rows.dtype.names:
            np.testing.assert_array_equal(other.rows[name], first.rows[name], err_msg=name)


def test_ragged_lines_and_rows_of_nan() -> None:
    """Frames of their own lengths, padded by hand or not, with holes where a point is missing: as each by itself."""
    rng, given = np.random.default_rng(3), scenes()
    ragged, holes = [], np.full((8, 150, 2), np.nan)
    for row, points in zip(holes, given.points_px[:8], strict=True):
        kept = np.sort(rng.permutation(120)[: rng.integers(60, 120)])
        ragged.append(points[kept])
        row[np.sort(rng.permutation(150)[: len(kept)])] = points[kept]
    estimator, zeros = ContactEstimator(given.rig), np.zeros(8)
    by_line = estimator.estimate_batch(ragged, given.moment_Nm[:8], zeros, zeros, sigma_px=SIGMA)
    by_hole = estimator.estimate_batch(holes, given.moment_Nm[:8], zeros, zeros, sigma_px=SIGMA)
    for line, first, second, moment in zip(ragged, by_line, by_hole, given.moment_Nm, strict=False):
        one = estimator.estimate(line, moment=float(moment), pan=0.0, tilt=0.0, sigma_px=SIGMA)
        assert furthest(one, first) < STANDSTILL
        assert furthest(one, second) < STANDSTILL


def moving(count: int) -> tuple[World, list[Measured], list[float]]:
    """A contact that slides along the antenna, jumps, lets go and comes back: frames and true distances."""
    world = World(camera_pose(0.5, 0.7))
    contact = np.concatenate([np.linspace(0.45, 0.8, count // 2), np.linspace(0.3, 0.5, count - count // 2)])
    tips = np.where(np.arange(count) % 10 == 7, 1e-9, 0.015)
    measured = []
    for index, (at, tip) in enumerate(zip(contact, tips, strict=True)):
        seen = frame(float(at), 0.4 + 0.05 * index, float(tip), world, seed=index, points=100)
        sigma = np.full(100, SIGMA_PX)
        measured.append(Measured(seen.points_px, sigma, seen.moment_Nm, 0.0, seen.tilt_rad))
    return world, measured, contact.tolist()


@cache
def one_by_one() -> tuple[ContactEstimator, list[Measured], list[Contact]]:
    """A recording, and each of its frames by itself."""
    world, recording, _ = moving(12)
    estimator = ContactEstimator(world.rig(0.25 * RIG_STD))
    return estimator, recording, [estimator.measure(each) for each in recording]


@pytest.mark.parametrize("live", [False, True])
def test_a_recording_is_a_loop(live: bool) -> None:
    """Warm or cold, in chunks or one by one: the same answers in the same order."""
    estimator, recording, cold = one_by_one()
    warm = list(estimator.run(iter(recording), live=live))
    assert len(warm) == 12
    assert {contact.status for contact in warm} >= {"ok", "no_contact"}
    assert max(furthest(a, b) for a, b in zip(cold, warm, strict=True)) < STANDSTILL


def test_a_wrong_start_is_recovered_from() -> None:
    """The warm start is a guess: from the other end of the antenna, the answer is the same."""
    seen = frame(0.8)
    measured = Measured(seen.points_px, np.full(300, SIGMA_PX), seen.moment_Nm, 0.0, 0.3)
    estimator = ContactEstimator(RIG)
    cold = estimator.measure(measured)
    for start in ([0.2, 50.0, -80.0, 0.0], [0.95, -1.0, 1.0, 3.0], [0.5, np.nan, 0.0, 0.0]):
        assert furthest(cold, estimator.measure(replace(measured, start=np.array(start)))) < STANDSTILL
    assert np.abs(deviations(cold, seen)).max() < 4.0
