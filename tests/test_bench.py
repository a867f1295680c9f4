"""`vbaa bench`: what each subject writes, and the goals on seeded parts of what its subjects measure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator import grid as estimator_grid
from benchmarks.estimator.grid import QUANTITIES
from benchmarks.estimator.hard import CASES, deviations, judged_at_random, resized
from benchmarks.estimator.hard import run as run_hard
from benchmarks.estimator.setup import Setup
from benchmarks.mistakes.rigs import KINDS, Kind, calibrated_rig
from benchmarks.suite import SUBJECTS
from benchmarks.vision.vision import hardships
from benchmarks.waiting.frames import population
from vbaa_calib.cli.main import main

from .lazy import Lazy

judge = Lazy("benchmarks.worlds.judge")
rigs = Lazy("benchmarks.worlds.rigs")
session = Lazy("benchmarks.worlds.session")


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SUBJECTS))
def test_every_subject_leaves_its_files_in_the_smallest_run(name: str, tmp_path: Path) -> None:
    least = str(SUBJECTS[name].least)
    assert main(["bench", name, "--quick", "--draws", least, "--out", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {*SUBJECTS[name].files, SUBJECTS[name].record}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_calibrations_err_as_much_as_they_state(kind: Kind) -> None:
    """Pose, antenna and sensor of 40 calibrations: χ² over its 17 degrees of freedom, each number's scatter over its
    stated one, and the share of 95 % intervals that contain the truth."""
    squares, pulls = [], []
    for seed in range(40):
        known = calibrated_rig(kind, seed)
        world, joint = known.world, known.joint
        truth = np.append(world.parameters, [world.gain, world.offset_Nm])
        step = np.append(joint.T_antenna_camera.tangent_from(world.T_antenna_camera), joint.parameters[6:] - truth)
        covariance = joint.covariance[:17, :17]
        squares.append(step @ np.linalg.solve(covariance, step))
        pulls.append(step / np.sqrt(np.diag(covariance)))
    assert abs(np.mean(squares) / 17 - 1.0) < 0.25
    assert np.all(np.abs(np.sqrt(np.mean(np.square(pulls), axis=0)) - 1.0) < 0.45)
    assert np.mean(np.abs(pulls) < 1.96) > 0.9


def test_good_pictures_reach_the_goals() -> None:
    """Bias, spread against the bound, predicted deviations, false points."""
    (row,) = hardships(6, 3, ("none",))
    assert row.found == 1.0
    assert abs(row.bias_px) < 0.01
    assert row.of_bound < 1.2
    assert 0.85 < row.of_sigma < 1.15
    assert row.false == 0.0
    assert row.kept > 0.97


def test_the_estimator_reaches_the_bound_on_a_part_of_the_grid() -> None:
    """One rig, 15 cells: squares of l, f_y and f_z over their bounds within what one run in 10,000 exceeds."""
    rows = estimator_grid.run(8, 0, lenses=("brown",), tilts_deg=(30.0,))
    assert all(row.without_numbers == 0.0 for row in rows)
    for quantity in QUANTITIES:
        squares = np.mean([row.of_bound**2 for row in rows if row.quantity == quantity])
        assert abs(squares - 1.0) < 4 * np.sqrt(2 / 120), quantity


def test_hard_cases_never_raise_and_keep_to_their_deviations() -> None:
    rows = run_hard(4, 1)
    assert [row.case for row in rows] == list(CASES)
    assert not [row.exception for row in rows if row.exception]
    numbered = {row.case: row.numbered for row in rows}
    blind = ("δ → 0", "all points in one place", "ξ = 90°, upright camera", "2 points")
    assert not any(numbered[name] for name in blind)
    assert all(numbered[name] == 1.0 for name in ("τ = 0", "40 % missing", "float32 pixels", "1000 times larger"))
    assert not [row.case for row in rows if max(row.l_max_std, row.f_max_std) >= 6.0]


def test_contacts_near_the_tip_are_as_uncertain_as_stated() -> None:
    """200 within 3 % of it, whether they are taken for the tip's or not: mean squares of their standardised errors."""
    frames = CASES["l → L"](200, np.random.default_rng(1))
    assert all(np.nanmean(off**2) < 1.25 for off in deviations(frames.estimated(), frames))


def test_size_does_not_matter() -> None:
    """The same noise on a rig 1000 times larger gives the same answer, in its own units."""
    frames = population(Setup().rig(), 5, 3)
    length, large = frames.rig.antenna.length_m, resized(frames.rig, 1e3)
    twin = replace(frames, rig=large, moment_Nm=1e3 * frames.moment_Nm)
    ours, theirs = (each.estimated("elastica").distance_m for each in (frames, twin))
    np.testing.assert_allclose(theirs / (1e3 * length), ours / length, rtol=1e-6)


def test_frames_at_random_are_never_wrong_with_confidence() -> None:
    rows = [judged_at_random(5, chunk, 16) for chunk in (0, 1)]
    assert [row.frames for row in rows] == [16, 16]
    assert sum(row.exceptions + row.nan + row.imagined + row.beyond for row in rows) == 0
    assert all(row.claimed > 0 for row in rows)


def test_a_small_world_on_the_whole_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It calibrates, and contacts are where they are, as far as is stated; nothing that is advised is followed."""
    monkeypatch.setattr("benchmarks.worlds.judge._followed", lambda *_: (np.nan, np.nan, np.nan))
    world = rigs.draw_world(0, 1)
    world = replace(
        world, boards=world.boards[:8], free=world.free[:3], loads=world.loads[:4], contacts=world.contacts[2:8]
    )
    found = judge.outcome(world, session.write_session(world, tmp_path / "session"), tmp_path / "session")
    assert found.calibrated < 2, found.words
    assert found.ours is not None
    assert found.true is not None
    assert len(found.ours.error_m) >= 3
    assert found.ours.silent == found.true.silent == 0
