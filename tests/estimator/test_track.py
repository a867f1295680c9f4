"""What a recording's contacts say in time: first contact and loss, slip, and smoothing that sampling confirms."""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.estimator.setup import Setup
from estimator.cli.track import COLUMNS, configure
from estimator.cli.track import _run as run
from estimator.contact.common_errors import CommonErrors
from estimator.object.track import Event, Track, follow, smooth
from estimator.table.contacts import ContactRow, ContactTable
from estimator.table.files import write_contacts
from vbaa_calib.geometry import Kinematics

from ..csv_files import read_rows

RATE_HZ = 30.0
TILT_RAD = 0.2


def evidence(x: np.ndarray, common: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """(B,) half the squared size of a deflection x (B,) along one axis, a common error (3,) and noise in three."""
    whole = common + noise * rng.normal(size=(len(x), 3))
    whole[:, 0] += x
    return 0.5 * (whole**2).sum(axis=1)


def evidence_table(values: np.ndarray, *, deep: np.ndarray | None = None, start_s: float = 0.0) -> ContactTable:
    """Frames with this evidence (B,), in contact from 14 on and located from 100 on, with a force along `deep` (B,)."""
    rows = []
    for i, value in enumerate(values):
        row = {
            "frame": i,
            "time_s": start_s + i / RATE_HZ,
            "pan_rad": 3e-4 * i,
            "tilt_rad": TILT_RAD,
            "evidence": value,
        }
        if value < 14.0:
            rows.append(ContactRow(status="no_contact", **row))
        elif value < 100.0 or deep is None:
            rows.append(ContactRow(status="low_signal", in_contact=True, **row))
        else:
            place, force = np.array([0.15, 0.0, 0.0]), np.array([0.0, float(deep[i]), 0.0])
            points = {"point_antenna_m": place, "point_world_m": place, "covariance_world_m2": 1e-6 * np.eye(3)}
            forces = {"force_y_N": force[1], "force_y_std_N": 1.0, "force_z_N": 0.0, "force_z_std_N": 1.0}
            tangent = np.array([1.0, 0.0, 0.0])
            rows.append(located(distance_m=0.15, force_world_N=force, tangent_world=tangent, **points, **forces, **row))
    return ContactTable.from_rows(rows)


def located(**given: Any) -> ContactRow:
    """A located contact; of what is not given the deviations are small."""
    small = dict.fromkeys(("distance_std_m", "force_y_std_N", "force_z_std_N"), 1e-3)
    return ContactRow(**{"status": "ok", "in_contact": True, "tilt_rad": 0.0, "evidence": 1e4} | small | given)


@dataclass(frozen=True, eq=False)
class Rubbed:
    """A wire rubbing over a fixed plane z = 0: its contact walks along it, its own point slips. Truth of B frames."""

    time_s: np.ndarray
    point_m: np.ndarray
    tangent: np.ndarray
    distance_m: np.ndarray
    velocity_m_s: np.ndarray
    pan_rad: np.ndarray


def rubbed(
    longitudinal_m_s: np.ndarray, lateral_m_s: np.ndarray, walk_m_s: np.ndarray, pan_rad_s: float = 0.3
) -> Rubbed:
    """The wire lies in the plane, turned by the pan. v along it and across it (B,), and how fast the contact walks
    along the wire (B,).
    """
    time = np.arange(len(walk_m_s)) / RATE_HZ
    fine = np.linspace(0.0, time[-1], 40 * len(time) + 1)
    pan = pan_rad_s * fine
    tangent = np.column_stack([np.cos(pan), np.sin(pan), 0.0 * pan])
    across = np.column_stack([-np.sin(pan), np.cos(pan), 0.0 * pan])
    along, aside, walk = (np.interp(fine, time, each) for each in (longitudinal_m_s, lateral_m_s, walk_m_s))
    velocity = along[:, None] * tangent + aside[:, None] * across
    path = _summed(velocity + walk[:, None] * tangent, fine) + np.array([0.15, 0.0, 0.0])
    distance = 0.15 + _summed(walk[:, None], fine)[:, 0]
    at = np.searchsorted(fine, time - 1e-9)
    return Rubbed(time, path[at], tangent[at], distance[at], velocity[at], pan[at])


def _summed(rate: np.ndarray, time: np.ndarray) -> np.ndarray:
    middle = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(middle, axis=0)])


def rubbed_table(
    truth: Rubbed,
    rng: np.random.Generator,
    along_m: float = 5e-4,
    across_m: float = 3e-5,
    common_m: np.ndarray | None = None,
    friction: float = 0.0,
) -> ContactTable:
    """What an estimator would make of it: the distance's error moves the point along the wire, other noise across it.

    `common_m` (3,) moves all points; `friction` leans the force across the wire, against the slip.
    """
    rows = []
    common = np.zeros(3) if common_m is None else common_m
    for i in range(len(truth.time_s)):
        tangent = truth.tangent[i]
        normal = np.array([0.0, 0.0, 1.0])
        across = np.cross(normal, tangent)
        off = along_m * rng.normal()
        point = truth.point_m[i] + common + off * tangent
        point = point + across_m * (rng.normal() * across + rng.normal() * normal)
        covariance = along_m**2 * np.outer(tangent, tangent)
        covariance += across_m**2 * (np.outer(across, across) + np.outer(normal, normal))
        slip = float(truth.velocity_m_s[i] @ across)
        force = 0.1 * (normal - friction * np.sign(slip) * across)
        rotation = Kinematics().T_world_antenna(float(truth.pan_rad[i]), 0.0).rotation
        in_antenna = rotation.T @ force
        rows.append(
            located(
                frame=i,
                time_s=float(truth.time_s[i]),
                distance_m=float(truth.distance_m[i]) + off,
                distance_std_m=along_m,
                force_y_N=in_antenna[1],
                force_z_N=in_antenna[2],
                point_antenna_m=rotation.T @ point,
                point_world_m=point,
                covariance_world_m2=covariance,
                force_world_N=force,
                tangent_world=tangent,
                pan_rad=float(truth.pan_rad[i]),
            )
        )
    return ContactTable.from_rows(rows)


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


COUNT = 60


def known(table: ContactTable, common_m: float = 1e-3) -> CommonErrors:
    """A calibration whose error moves all points alike, the table's covariance being noise alone."""
    modes = np.tile(common_m * np.eye(3), (len(table), 1, 1))
    nothing = np.zeros_like(modes)
    return CommonErrors(modes, nothing, nothing, table.covariance_world_m2)


def track_of(truth: Rubbed, seed: int = 0, **noise) -> tuple[ContactTable, Track]:
    table = rubbed_table(truth, np.random.default_rng(seed), **noise)
    return table, follow(table, shared=known(table))


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


@pytest.mark.parametrize(
    ("motion", "phase"), [((0.0, 0.0, 0.0), "sticking"), ((9e-3, 0.0, 5e-3), "sliding"), ((0, 0, 0.02), "rolling")]
)
def test_steady_motions_have_their_names(motion: tuple[float, float, float], phase: str) -> None:
    _, track = track_of(rubbed(*(np.full(COUNT, each) for each in motion)), along_m=1e-4)
    names, counts = np.unique(track.phase, return_counts=True)
    assert names[np.argmax(counts)] == phase
    assert counts.max() >= 0.9 * COUNT


def stick_slip() -> Rubbed:
    aside = np.where((np.arange(COUNT) >= 20) & (np.arange(COUNT) < 40), 15e-3, 0.0)
    return rubbed(np.zeros(COUNT), aside, np.zeros(COUNT))


def test_slip_begins_and_ends_where_it_does() -> None:
    _, track = track_of(stick_slip())
    (start,), (end,) = of(track, "slip_start"), of(track, "slip_end")
    assert abs(start.time_s - 19.5 / RATE_HZ) < 3.0 * start.time_std_s + 0.05
    assert abs(end.time_s - 39.5 / RATE_HZ) < 3.0 * end.time_std_s + 0.05
    assert set(track.phase[24:36]) == {"sliding"}
    assert set(track.phase[:15]) == {"sticking"} == set(track.phase[45:])
    assert start.delay_s > 0.0
    assert "slip" in start.words


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
    rows = read_rows(tmp_path / "track.csv")
    assert tuple(rows[0]) == COLUMNS
    assert {row["phase"] for row in rows} >= {"sliding", "sticking"}
    assert float(rows[30]["slip_m_s"]) == pytest.approx(15e-3, rel=0.1)
    assert rows[30]["ringing"] == "false"


RIG = Setup(real=True, exact=True).rig()
COUNT_SMOOTH = 50


def swaying() -> Rubbed:
    """It never rests, and never stops slipping."""
    sizes, paces = (5e-3, 6e-3, 8e-3), (9.0, 14.0, 11.0)
    along, aside, walk = (
        size * np.sin(np.arange(COUNT_SMOOTH) / pace) for size, pace in zip(sizes, paces, strict=True)
    )
    return rubbed(along, 0.012 + aside, walk)


def seen(truth: Rubbed, seed: int) -> tuple[ContactTable, CommonErrors]:
    """A table whose covariances hold a common error that moves all points alike, and what is shared."""
    table = rubbed_table(truth, np.random.default_rng(seed))
    modes = np.tile(2e-3 * np.eye(3), (COUNT_SMOOTH, 1, 1))
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
