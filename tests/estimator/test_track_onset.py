"""First contact and loss: seldom imagined, early, with a time that is worth what it says; and ringing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.contact.motion import Beam
from estimator.object.track import Event, Track, follow
from estimator.object.track.follow import frequency, ringing_events, ringing_frames
from estimator.table.contacts import ContactTable

from .track_tables import RATE_HZ, evidence, evidence_table

EXACT, OFF = (np.zeros(3), 1.0), (np.array([0.7, -1.1, 0.5]), 0.5)
"""Common error and noise of the free antenna, in the deviations that the evidence counts in."""


def depth(count: int, first: float, rate: float) -> np.ndarray:
    """(B,) a deflection that grows from frame `first` on by so much a frame."""
    return np.clip(np.arange(count) - first, 0.0, None) * rate


def of(track: Track, kind: str) -> list[Event]:
    return [event for event in track.events if event.kind == kind]


@pytest.mark.parametrize(
    ("frames", "seed", "most"), [(3000, 1, 0), pytest.param(120_000, 2, 12, marks=pytest.mark.slow)]
)
def test_the_free_antenna_is_seldom_taken_for_a_contact(frames: int, seed: int, most: int) -> None:
    """Half of the recordings by a rig that is off by a draw."""
    rng, alarms = np.random.default_rng(seed), 0
    for number in range(frames // 300):
        noise = 1.0 if number % 2 else float(rng.uniform(0.1, 0.9))
        common = np.sqrt(1.0 - noise**2) * rng.normal(size=3)
        alarms += len(of(follow(evidence_table(evidence(np.zeros(300), common, noise, rng))), "first_contact"))
    assert alarms <= most


@pytest.mark.parametrize(("common", "noise"), [pytest.param(*EXACT, marks=pytest.mark.slow), OFF])
def test_a_slow_approach_is_seen_before_a_single_frame_tells_it(common: np.ndarray, noise: float) -> None:
    rng, early = np.random.default_rng(4), []
    for _ in range(5):
        values = evidence(depth(120, 60.0, 0.2), common, noise, rng)
        found = of(follow(evidence_table(values)), "first_contact")
        early.append(int(np.argmax(values >= 14.0)) - found[0].frame)
        assert len(found) == 1
        assert found[0].frame >= 60
    assert np.mean(early) > (1.0 if noise == 1.0 else 2.0)


def test_a_fast_approach_is_told_by_its_first_frame_and_timed_between_frames() -> None:
    rng = np.random.default_rng(5)
    x = depth(80, 50.6, 400.0)
    track = follow(evidence_table(evidence(x, *EXACT, rng), deep=x + rng.normal(size=80)))
    (event,) = of(track, "first_contact")
    assert event.frame == 51
    assert abs(event.time_s - 50.6 / RATE_HZ) < 4.0 * event.time_std_s < 0.02
    assert event.delay_s == pytest.approx(51 / RATE_HZ - event.time_s)
    assert "first contact at" in event.words
    assert set(track.phase[:50]) == {"free"}
    assert "free" not in track.phase[52:]


@pytest.mark.slow
def test_the_time_of_first_contact_is_worth_what_it_says() -> None:
    """Against sampling, the common error in any direction, the approach a little uneven."""
    rng, off = np.random.default_rng(6), []
    for number in range(24):
        common, noise = (np.zeros(3), 1.0) if number % 2 else (rng.normal(size=3) * 0.8, 0.6)
        first, rate = 60.0 + rng.uniform(), float(10.0 ** rng.uniform(-0.3, 2.5))
        late = np.clip(np.arange(100) - first, 0.0, None)
        x = rate * late * (1.0 + 0.005 * rng.normal() * late)
        table = evidence_table(evidence(x, common, noise, rng), deep=np.abs(x + rng.normal(size=100)))
        (event,) = of(follow(table), "first_contact")
        off.append((event.time_s - first / RATE_HZ) / event.time_std_s)
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.4
    assert np.max(np.abs(off)) < 4.5


def test_a_loss_is_timed_backwards() -> None:
    rng = np.random.default_rng(7)
    x = depth(120, 40.3, 3.0)
    x = np.minimum(x, np.clip(80.7 - np.arange(120), 0.0, None) * 3.0)
    track = follow(evidence_table(evidence(x, *EXACT, rng)))
    (event,) = of(track, "loss")
    assert abs(event.time_s - 80.7 / RATE_HZ) < 4.0 * event.time_std_s
    assert 0.0 <= event.delay_s < 0.15
    assert set(track.phase[84:]) == {"free"}
    assert len(of(track, "first_contact")) == 1


def with_status(table: ContactTable, rows: slice, status: str) -> ContactTable:
    return replace(table, status=np.where(np.isin(np.arange(len(table)), np.r_[rows]), status, table.status))


@pytest.mark.parametrize("status", ["no_antenna", "not_quasistatic"])
def test_frames_that_tell_nothing_are_neither_free_nor_in_contact(status: str) -> None:
    rng = np.random.default_rng(8)
    table = evidence_table(evidence(np.zeros(90), *EXACT, rng))
    track = follow(with_status(table, slice(30, 40), status))
    assert set(track.phase[30:40]) == {"unknown"}
    assert not of(track, "first_contact") + of(track, "loss")


def test_after_a_long_gap_the_beginning_is_not_made_up() -> None:
    rng = np.random.default_rng(9)
    x = np.where(np.arange(120) < 80, 0.0, 30.0)
    track = follow(with_status(evidence_table(evidence(x, *EXACT, rng)), slice(50, 80), "no_antenna"))
    (event,) = of(track, "first_contact")
    assert np.isnan(event.time_s)


def test_without_evidence_the_instant_lies_between_two_frames() -> None:
    table = evidence_table(evidence(depth(60, 30.0, 100.0), *EXACT, np.random.default_rng(10)))
    track = follow(replace(table, evidence=np.full(60, np.nan)))
    (event,) = of(track, "first_contact")
    assert event.time_s == pytest.approx(30.5 / RATE_HZ)
    assert event.time_std_s == pytest.approx(1.0 / RATE_HZ / np.sqrt(12.0))
    assert any("evidence" in note for note in track.notes)


def test_a_base_that_moves_in_steps_lands_between_two_frames() -> None:
    """Its forces grow slowly afterwards, and run back to a zero that free frames contradict."""
    noise, common = 1.0, np.zeros(3)
    x = np.where(np.arange(80) >= 51, 900.0 + 40.0 * (np.arange(80) - 51), 0.0)
    table = evidence_table(evidence(x, common, noise, np.random.default_rng(7)), deep=x)
    event = of(follow(table), "first_contact")[0]
    sound = (table.time_s[50], table.time_s[51])
    assert sound[0] < event.time_s < sound[1]
    assert event.time_std_s > 0.2 / RATE_HZ


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
    few = ringing_table(15.0, pace_hz=4.0)
    (event,) = ringing_events(few, ringing_frames(few), STEEL)
    assert "too fast for 15 frames a second" in event.words


@pytest.mark.parametrize("pace_hz", [3.1, 13.0])
def test_a_line_is_found_within_its_deviation(pace_hz: float) -> None:
    off = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        time = np.sort(rng.uniform(0.0, 1.2, 50))
        found = frequency(
            time, np.sin(2.0 * np.pi * pace_hz * time + seed) + 0.3 * rng.normal(size=50) + 5.0 * time, 15.0
        )
        off.append((found[0] - pace_hz) / found[1])
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_noise_is_not_taken_for_a_line() -> None:
    found = [frequency(np.arange(40) / 30.0, np.random.default_rng(seed).normal(size=40), 15.0) for seed in range(200)]
    assert sum(each is not None for each in found) <= 3
