"""A recording in order: what swings is named, what rests is not, and nothing waits when it must not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.estimator.scenes import Scenes, rod_shapes, rolled, scenes
from estimator import Contact, ContactEstimator, Measured
from estimator.contact import recording
from vbaa_calib.detect.whisker.centreline import NOTHING
from vbaa_calib.session import Frame

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


def test_pictures_are_judged_for_motion_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was seen in each picture goes through the same stream; a picture without an antenna keeps its own words."""
    lost = 20
    seen = [
        recording.Detection(NOTHING if index == lost else NOTHING.with_verdict("ok", ""), measured)
        for index, measured in enumerate(recorded(touched(0.02)))
    ]
    seen[lost] = replace(
        seen[lost], measured=replace(seen[lost].measured, points_px=np.empty((0, 2)), sigma_px=np.empty(0))
    )
    monkeypatch.setattr(recording, "read_own", lambda _, path: path)
    monkeypatch.setattr(recording, "first_look", lambda _, frame, picture, ground: SimpleNamespace(frame=frame))
    monkeypatch.setattr(recording, "_in_order", lambda _, glances: glances)
    monkeypatch.setattr(recording, "_detections", lambda _, glances: (seen[each.frame.frame] for each in glances))
    frames = [Frame(None, 0.0, 0.0, 0.0, frame=index, time_s=index / RATE_HZ) for index in range(COUNT)]
    found = list(recording.estimate_pictures(ContactEstimator(RIG), frames))
    assert [item.frame.frame for item in found] == list(range(COUNT))
    assert sum(item.contact.status == "not_quasistatic" for item in found) >= COUNT // 3
    assert (found[lost].contact.status, found[lost].contact.reason) == ("no_antenna", NOTHING.reason)
