"""Ringing: flagged, joined, and its frequency told only where the frames can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.contact.motion import Beam
from estimator.object.track import follow
from estimator.object.track.events import frequency, ringing_events, ringing_frames
from estimator.table.contacts import ContactTable

from .track_tables import evidence_table

STEEL = Beam(0.24, 3.9e-3, 3.97e-3)


def ringing_table(rate_hz: float, pace_hz: float = 7.0, seconds: float = 2.0) -> ContactTable:
    """A pressed contact that swings from 0.5 s to 1.5 s; the frames near its turning points are flagged."""
    time = np.arange(int(seconds * rate_hz)) / rate_hz
    swings = (time > 0.5) & (time < 1.5)
    phase = np.sin(2.0 * np.pi * pace_hz * time) * swings
    x = 30.0 + 5.0 * phase + np.random.default_rng(0).normal(size=len(time))
    table = replace(evidence_table(0.5 * x**2), time_s=time)
    return replace(table, status=np.where(np.abs(phase) > 0.6, "not_quasistatic", "low_signal"))


def test_the_frequency_is_told_where_frames_are_many() -> None:
    table = ringing_table(60.0)
    (event,) = ringing_events(table, ringing_frames(table), STEEL)
    assert event.time_s == pytest.approx(0.5, abs=0.1)
    assert " 7." in event.words or " 6.9" in event.words
    assert "Hz" in event.words


def test_where_frames_are_too_few_that_is_said() -> None:
    table = ringing_table(15.0, pace_hz=4.0)
    (event,) = ringing_events(table, ringing_frames(table), STEEL)
    assert "too fast for 15 frames a second" in event.words


def test_following_flags_them_and_does_not_take_them_for_losses() -> None:
    table = ringing_table(60.0)
    track = follow(table)
    np.testing.assert_array_equal(track.ringing, ringing_frames(table))
    assert {event.kind for event in track.events} == {"first_contact", "ringing"}
    assert set(track.phase[track.ringing]) == {"unknown"}


@pytest.mark.parametrize("pace_hz", [3.1, 9.6, 13.0])
def test_a_line_is_found_within_its_deviation(pace_hz: float) -> None:
    off = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        time = np.sort(rng.uniform(0.0, 1.2, 50))
        found = frequency(
            time, np.sin(2.0 * np.pi * pace_hz * time + seed) + 0.3 * rng.normal(size=50) + 5.0 * time, 15.0
        )
        assert found is not None
        off.append((found[0] - pace_hz) / found[1])
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_noise_is_not_taken_for_a_line() -> None:
    found = [frequency(np.arange(40) / 30.0, np.random.default_rng(seed).normal(size=40), 15.0) for seed in range(200)]
    assert sum(each is not None for each in found) <= 3
