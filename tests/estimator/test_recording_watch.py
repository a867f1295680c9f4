"""Frames of a recording as witnesses: what they say together, and how many of them are kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.mistakes.recordings import Recording, clean_recording
from benchmarks.mistakes.rigs import KINDS
from benchmarks.waiting.recordings import write_recording
from estimator import RecordingVerdict
from estimator.diagnose.changes import CHANGES, axes_of, fitted
from estimator.diagnose.consequences import with_unused
from estimator.diagnose.evidence import Case, Recorded
from estimator.diagnose.watch import RecordingWatch
from estimator.table.contacts import Measured
from estimator.table.overview import Overview
from vbaa_calib.cli.main import main
from vbaa_calib.session import Frame

from ..rod_scenes import RIG_STD, World, camera_pose, frames, pushing
from .contact_scenes import answered, rubbed


@cache
def clean() -> Recording:
    return clean_recording(KINDS[0], 0)


def watched(recording: Recording) -> RecordingWatch:
    watch = RecordingWatch(recording.rig)
    for measured in recording.frames:
        watch.push(measured)
    return watch


@cache
def witnesses() -> Recorded:
    return watched(clean()).recorded()


def test_the_pictures_know_the_moments() -> None:
    """Frames that are fitted without their moments predict these within their standard deviations."""
    recorded = witnesses()
    silent = recorded.with_readings(readings_Nm=np.full_like(recorded.batch.readings_Nm, np.nan))
    expected, std = silent.fit.moments
    read = recorded.batch.readings_Nm[:, 0]
    off = (read - expected) / np.hypot(std, recorded.rig.moment_sensor.std_Nm)
    known = np.isfinite(std)
    assert known.sum() >= 10
    assert np.abs(off[known]).max() < 5.0
    assert (off[known] ** 2).mean() < 4.0


def test_two_rigs_are_two_parts() -> None:
    """Frames whose rig changes on the way cost what both parts cost by themselves."""
    recorded = witnesses()
    other = recorded.rig.moved(np.eye(len(axes_of(recorded.rig, CHANGES)[0]))[0] * 1e-3)
    both, first = recorded.with_rig(other, 12).fit, np.arange(len(recorded)) < 12
    before = recorded.picked(np.flatnonzero(first)).fit.cost
    after = recorded.with_rig(other).picked(np.flatnonzero(~first)).fit.cost
    assert both.cost == pytest.approx(np.concatenate([before, after]), rel=1e-9)
    rows = np.arange(6, 20)
    assert recorded.with_rig(other, 12).picked(rows).fit.cost == pytest.approx(both.cost[rows], rel=1e-9)


def test_a_contact_that_slides_to_and_fro_is_no_delay(tmp_path: Path) -> None:
    write_recording(tmp_path, 2000, 40, 3)
    rig, out = tmp_path / "rig.json", tmp_path / "contacts.csv"
    assert main(["estimate", str(tmp_path), "--rig", str(rig), "-o", str(out), "--no-report"]) == 0


@pytest.mark.parametrize("name", ["picture_moved", "antenna_bent", "other_stiffness", "moment_zero"])
def test_a_change_is_found_with_its_value(name: str) -> None:
    """A rig that is noted otherwise than it was is found as far off as it is."""
    recorded = witnesses()
    row = next(one for one in CHANGES if one.name == name)
    axes, which = axes_of(recorded.rig, [row])
    steps = np.full(len(which[0]), -1.0)
    case = Case.of(recorded.with_rig(recorded.rig.moved(axes @ steps)), axes_of(recorded.rig, CHANGES)[0])
    found = fitted(case, row, axes)
    assert found is not None
    std = np.sqrt(np.diag(found.covariance))
    assert found.log_odds > 20.0
    assert (np.abs(found.steps + steps) < 5.0 * std + 0.05).all()


@pytest.mark.parametrize(("direction_rad", "swell_m"), [(0.3, 0.03), (1.0, 0.015)])
def test_moments_a_row_late_are_named_though_every_frame_fits(direction_rad: float, swell_m: float) -> None:
    """Each picture allows a mirror image, and in most frames the neighbour's moment fits about as well."""
    world, turn = World(camera_pose(0.5, 2.6)), 1.1 * np.arange(40)
    sizes = np.where(turn < 4.0, 0.0, 0.045 + swell_m * np.sin(turn))
    pushes = [pushing(direction_rad, size, 0.15) for size in sizes]
    several = frames(world, [0.15] * 40, pushes, [0.1] * 40, np.random.default_rng(0), sigma_px=0.1)
    for late, named in ((0, []), (1, ["moment_late"])):
        watch = RecordingWatch(world.rig(0.25 * RIG_STD))
        for row, one in enumerate(several):
            read = several[max(row - late, 0)].moment_Nm, 0.0, one.tilt_rad
            watch.push(Measured(one.points_px, np.full(300, 0.1), *read, time_s=0.1 * row))
        assert [one.name for one in watch.verdict().verdict.findings if one.severity != "note"] == named


@pytest.mark.parametrize(("kind", "seed"), [(1, 28), (0, 88)])
def test_pictures_are_exchanged_where_both_places_gain(kind: int, seed: int) -> None:
    """Not where strokes follow each other without a free frame, and pictures leap by themselves."""
    recording, order = clean_recording(KINDS[kind], seed, free=False), np.arange(60)
    assert watched(recording).verdict().verdict.severity != "wrong"
    order[[25, 40]] = 40, 25
    names = ("points_px", "sigma_px", "tip_px")
    pictures = [{name: getattr(recording.frames[row], name) for name in names} for row in order.tolist()]
    frames = [replace(one, **own) for one, own in zip(recording.frames, pictures, strict=True)]
    found = watched(replace(recording, frames=frames)).verdict()
    assert (found.verdict.findings[0].name, found.rows) == ("pictures_exchanged", {25, 40})


@pytest.mark.parametrize("kind", [0, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("moment_rounded", lambda read, std: 30.0 * std * np.round(read / (30.0 * std))),
        ("moment_kept", lambda read, _: np.repeat(read[::3], 3)),
        ("moment_saturated", lambda read, _: np.minimum(read, np.sort(read)[-4])),
        ("moment_stuck", lambda read, _: np.where(np.arange(len(read)) % 7, read, 0.0)),
        ("moment_noise", lambda read, _: read[np.random.default_rng(0).permutation(len(read))]),
    ],
)
def test_moments_of_a_poor_converter_are_named(name: str, kind: int, change: Callable[..., np.ndarray]) -> None:
    """Few digits, fewer readings than pictures, the end of a range in four rows, gaps, and moments of other rows."""
    recording = clean_recording(KINDS[kind], 4, free=False)
    found = watched(changed(recording, change)).verdict().verdict
    assert (found.findings[0].name, found.severity) == (name, "wrong")


@pytest.mark.parametrize(("kind", "seed"), [(0, 102), pytest.param(2, 102, marks=pytest.mark.slow)])
def test_moments_that_are_rounded_to_their_noise_are_as_good(kind: int, seed: int) -> None:
    recording = clean_recording(KINDS[kind], seed, 150)
    assert (
        watched(changed(recording, lambda read, std: std * np.round(read / std))).verdict().verdict.severity != "wrong"
    )


def changed(recording: Recording, change: Callable[..., np.ndarray]) -> Recording:
    """The recording with other moments, by those that were read and their noise's standard deviation."""
    read = np.array([one.moment_Nm for one in recording.frames])
    moments = change(read, recording.rig.moment_sensor.std_Nm).tolist()
    frames = [replace(one, moment_Nm=own) for one, own in zip(recording.frames, moments, strict=True)]
    return replace(recording, frames=frames)


@pytest.mark.parametrize(("assumed_rad", "doubted"), [(0.2, True), (0.5, False)])
def test_more_friction_than_allowed_for_is_doubted(assumed_rad: float, doubted: bool) -> None:
    """Of a recording; each frame by itself is only improbable."""
    signs = np.where(np.arange(30) % 2, 1.0, -1.0)
    given = rubbed(World(camera_pose(0.0)).rig(0.25 * RIG_STD), np.linspace(0.5, 0.8, 30), [30.0] * 30, 0.5 * signs)
    overview = Overview()
    for row, contact in enumerate(answered(given, friction=assumed_rad)):
        overview.add_readings(Frame(None, 0.0, 0.0, None, row, time_s=0.1 * row), contact=contact)
    findings = with_unused(RecordingVerdict(), overview.unused, overview.frames).verdict.findings
    assert overview.unused["friction_known"] > 20
    assert ["--friction" in one.remedy for one in findings] == [True] * doubted
