"""Slip against a wire whose motion is known: velocities within their deviations, phases only where they can be told."""

from __future__ import annotations

import argparse
import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.cli.track import COLUMNS, configure
from estimator.cli.track import _run as run
from estimator.contact.common_errors import CommonErrors
from estimator.object.track import Event, Track, follow
from estimator.table.contacts import ContactTable
from estimator.table.files import write_contacts

from .track_tables import RATE_HZ, Rubbed, rubbed, rubbed_table

COUNT = 60


def known(table: ContactTable, common_m: float = 1e-3) -> CommonErrors:
    """A calibration whose error moves all points alike, the table's covariance being noise alone."""
    modes = np.tile(common_m * np.eye(3), (len(table), 1, 1))
    nothing = np.zeros_like(modes)
    return CommonErrors(modes, nothing, nothing, table.covariance_world_m2)


def track_of(truth: Rubbed, seed: int = 0, **noise) -> tuple[ContactTable, Track]:
    table = rubbed_table(truth, np.random.default_rng(seed), **noise)
    return table, follow(table, shared=known(table))


def steady(along: float, aside: float, walk: float) -> Rubbed:
    return rubbed(*(np.full(COUNT, each) for each in (along, aside, walk)))


@pytest.mark.parametrize("shared", [True, False])
def test_velocities_are_worth_what_they_say(shared: bool) -> None:
    """Against sampling, along and across; a common error of 3 mm does not count."""
    truth, off = rubbed(*(amplitude * np.sin(np.arange(COUNT) / 30.0) for amplitude in (4e-3, 6e-3, 8e-3))), []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        table = rubbed_table(truth, rng, common_m=3e-3 * rng.normal(size=3))
        track = follow(table, shared=known(table) if shared else None)
        away = track.slip_velocity_m_s - truth.velocity_m_s
        axes = np.stack([truth.tangent, np.cross([0.0, 0.0, 1.0], truth.tangent)], axis=1)
        parts = np.einsum("bki,bi->bk", axes, away)
        covariance = axes @ track.slip_covariance_m2_s2 @ np.swapaxes(axes, 1, 2)
        off.append(parts / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))
    along, across = np.sqrt(np.mean(np.square(off), axis=(0, 1)))
    assert along < 1.3  # it counts for the antenna's radius as well, which this wire does not have
    assert 0.7 < across < 1.3


def test_the_parts_are_along_the_tip_and_along_normal_times_tangent() -> None:
    _, track = track_of(steady(5e-3, -8e-3, 3e-3))
    inner = slice(5, -5)
    assert np.median(track.longitudinal_m_s[inner]) == pytest.approx(5e-3, abs=3e-4)
    assert np.median(track.lateral_m_s[inner]) == pytest.approx(-8e-3, abs=3e-4)
    size = np.linalg.norm(track.slip_velocity_m_s, axis=1)
    np.testing.assert_allclose(size, np.hypot(track.longitudinal_m_s, track.lateral_m_s), rtol=1e-6)


def test_friction_that_leans_the_force_does_not_take_from_the_slip() -> None:
    """μ = 0.6 across the wire leans the force by 31°: the slip itself tells the plane of contact."""
    _, track = track_of(steady(0.0, 10e-3, 0.0), friction=0.6)
    assert np.median(np.abs(track.lateral_m_s[5:-5])) == pytest.approx(10e-3, rel=0.02)


@pytest.mark.parametrize(
    ("motion", "phase"),
    [
        ((0.0, 0.0, 0.0), "sticking"),
        ((9e-3, 0.0, 5e-3), "sliding"),
        ((0, 0, 0.02), "rolling"),
    ],
)
def test_steady_motions_have_their_names(motion: tuple[float, float, float], phase: str) -> None:
    _, track = track_of(steady(*motion), along_m=1e-4)
    names, counts = np.unique(track.phase, return_counts=True)
    assert names[np.argmax(counts)] == phase
    assert counts.max() >= 0.9 * COUNT


def test_what_is_too_uncertain_is_left_open() -> None:
    """0.5 mm across, 30 times a second, do not tell a slip of 4 mm/s, nor that there is none."""
    for aside in (0.0, 4e-3):
        _, track = track_of(steady(0.0, aside, 0.0), across_m=1e-3)
        assert np.mean(track.phase == "touching") > 0.9
        assert np.isfinite(track.slip_std_m_s).all()


def stick_slip() -> Rubbed:
    aside = np.where((np.arange(COUNT) >= 20) & (np.arange(COUNT) < 40), 15e-3, 0.0)
    return rubbed(np.zeros(COUNT), aside, np.zeros(COUNT))


def of(track: Track, kind: str) -> list[Event]:
    return [event for event in track.events if event.kind == kind]


def test_slip_begins_and_ends_where_it_does() -> None:
    _, track = track_of(stick_slip())
    (start,), (end,) = of(track, "slip_start"), of(track, "slip_end")
    assert abs(start.time_s - 19.5 / RATE_HZ) < 3.0 * start.time_std_s + 0.05
    assert abs(end.time_s - 39.5 / RATE_HZ) < 3.0 * end.time_std_s + 0.05
    assert set(track.phase[24:36]) == {"sliding"}
    assert set(track.phase[:15]) == {"sticking"} == set(track.phase[45:])
    assert start.delay_s > 0.0
    assert "slip" in start.words


def test_without_tangents_slip_is_not_made_up() -> None:
    table, _ = track_of(steady(0.0, 10e-3, 0.0))
    track = follow(replace(table, tangent_world=np.full((COUNT, 3), np.nan)))
    assert set(track.phase) == {"touching"}
    assert np.isnan(track.slip_velocity_m_s).all()
    assert any("tangents" in note for note in track.notes)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_short_contacts_and_clocks_that_stand_still_are_no_trouble(count: int) -> None:
    table, _ = track_of(steady(0.0, 1e-2, 0.0))
    track = follow(table.picked(slice(count)))
    assert len(track.phase) == count
    assert np.isfinite(track.slip_std_m_s).all() == (count == 3)
    still = replace(table, force_world_N=np.zeros((COUNT, 3)), time_s=np.zeros(COUNT))
    assert set(follow(still).phase) == {"touching"}


def written(path: Path, table: ContactTable) -> Path:
    write_contacts(path, list(table.rows()))
    return path


def arguments(*words: str | Path) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("--force", action="store_true")
    configure(parser)
    return parser.parse_args([str(word) for word in words])


def test_events_and_frames_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    contacts = written(tmp_path / "contacts.csv", track_of(stick_slip())[0])
    result = run(arguments(contacts, "-o", tmp_path / "track.csv"))
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    kinds = [event["kind"] for event in result["events"]]
    assert kinds == ["first_contact", "slip_start", "slip_end"]
    assert result["events"][0]["time_s"] is None
    assert sum(result["phases"].values()) == result["frames"] == COUNT
    said = capsys.readouterr().err
    assert "the contact begins to slip" in said
    assert "is undetermined" in said
    with (tmp_path / "track.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == COLUMNS
    assert {row["phase"] for row in rows} >= {"sliding", "sticking"}
    assert float(rows[30]["slip_m_s"]) == pytest.approx(15e-3, rel=0.1)
    assert rows[30]["ringing"] == "false"
