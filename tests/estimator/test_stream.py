"""A recording in order: what swings is named, what rests is not, and nothing waits when it must not."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from benchmarks.estimator.scenes import Scenes, rod_shapes, rolled, scenes
from estimator import Contact, ContactEstimator, Measured

from .contact_scenes import WORLD

RATE_HZ, SWING_HZ, COUNT = 60.0, 5.0, 48
RIG = WORLD.rig(np.zeros(17))


@cache
def touched(swing_N: float) -> Scenes:
    """The antenna held at 140 mm by a force that swings: its shapes are static, its inertia is what they would need."""
    size = 0.06 + swing_N * np.sin(2.0 * np.pi * SWING_HZ * np.arange(COUNT) / RATE_HZ)
    return scenes(RIG, np.full(COUNT, 0.14), rolled(size, 0.5), made_by=rod_shapes, sigma_px=0.02).noisy(
        np.random.default_rng(2)
    )


def recorded(given: Scenes, timed: bool = True) -> Iterator[Measured]:
    for index, points in enumerate(given.points_px):
        time = index / RATE_HZ if timed else np.nan
        moment = float(given.moment_Nm[index])
        yield Measured(points, np.full(len(points), given.sigma_px), moment, 0.0, 0.0, time_s=time)


def run(swing_N: float, timed: bool = True, live: bool = False) -> list[Contact]:
    return list(ContactEstimator(RIG).run(recorded(touched(swing_N), timed), live=live))


@pytest.mark.parametrize("live", [False, True])
def test_rest_is_not_taken_for_motion(live: bool) -> None:
    assert {contact.status for contact in run(0.0, live=live)} == {"ok"}


@pytest.mark.parametrize("live", [False, True])
def test_a_swing_is_named_where_inertia_is_largest(live: bool) -> None:
    """4 mm at 5 Hz: 4 m/s², two fifths of gravity."""
    found = run(0.02, live=live)
    moving = np.array([contact.status == "not_quasistatic" for contact in found])
    assert len(found) == COUNT
    assert moving.sum() >= COUNT // 3
    assert set(np.array([contact.status for contact in found])[~moving]) == {"ok"}
    contact = found[int(np.flatnonzero(moving)[0])]
    assert "swings" in contact.reason
    assert "mm off" in contact.reason
    assert contact.in_contact
    assert np.isnan(contact.distance_m)
    # at the turning points, a quarter and three quarters of a period in, it is there; half way between, it is not
    phase = (np.arange(COUNT) * SWING_HZ / RATE_HZ) % 0.5
    assert moving[np.isclose(phase, 0.25)][1:-1].mean() > 0.7 if not live else moving.any()
    assert moving[np.isclose(phase, 0.0)][1:-1].mean() < 0.3 if not live else moving.any()
