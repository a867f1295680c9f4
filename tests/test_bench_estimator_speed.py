"""The second half of `vbaa bench estimator`: speed against error, hard cases, frames at random."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.estimator import hard as estimator_hostile
from benchmarks.estimator import speed as estimator_speed
from benchmarks.estimator.hard import CASES, Hard, estimated, resized, run
from benchmarks.estimator.speed import PARTS, at_shares, baselines, one_contact, population


@cache
def flat() -> estimator_speed.Judged:
    return population(40, 3, 0.0)


def test_baselines_pick_the_parts_they_are_named_after_and_stay_off_the_bound() -> None:
    frames = flat().scenes
    for name, ends in PARTS.items():
        arclength = frames.arclength_m[at_shares(frames, ends)]
        beyond = arclength > frames.distance_m[:, None]
        expected = {"two curved points": (0, 0), "two straight points": (1, 1), "one of each": (0, 1)}[name]
        assert (beyond == np.array(expected, bool)).all()
    every = np.arange(len(frames))
    for solve in baselines(frames, np.random.default_rng(1)).values():
        off = flat().errors(solve(every))
        assert np.isfinite(off).mean() > 0.9
        assert 1.5 < np.sqrt(np.nanmean(off**2)) < 60.0
        np.testing.assert_array_equal(solve(every[5:6]), solve(every)[5:6])


def test_the_loop_is_a_fair_one() -> None:
    """SciPy's loop reaches the bound too: within the scatter of so few frames."""
    off = flat().errors(np.array([one_contact(flat().scenes, index)[0] for index in range(30)]))
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4


def test_hard_cases_never_raise_and_keep_to_their_deviations() -> None:
    rows = run(4, 1)
    assert [row.case for row in rows] == list(CASES)
    assert not [row.exception for row in rows if row.exception]
    by_case = {row.case: row for row in rows}
    for name in ("δ → 0", "all points in one place", "ξ = 90°, upright camera", "2 points"):
        assert by_case[name].numbered == 0.0
    for name in ("τ = 0", "40 % missing", "float32 pixels", "1000 times larger", "1000 times smaller"):
        row = by_case[name]
        assert row.numbered == 1.0
    for row in rows:
        assert max(row.l_max_std or 0.0, row.f_max_std or 0.0) < 6.0, row.case


def test_size_does_not_matter() -> None:
    """The same noise on a rig 1000 times larger gives the same answer, in its own units."""
    frames = flat().scenes.picked(np.arange(5))
    length, large = frames.rig.antenna.length_m, resized(frames.rig, 1e3)
    twin = replace(frames, rig=large, moment_Nm=1e3 * frames.moment_Nm)
    ours, theirs = (estimated(Hard(each), "elastica").distance_m for each in (frames, twin))
    np.testing.assert_allclose(theirs / (1e3 * length), ours / length, rtol=1e-6)


FEW = 16
"""Frames of a chunk: of these a third is claimed, and some have no reading."""
_found = cache(lambda chunk: estimator_hostile.estimated_at_random(estimator_hostile.replay(5, chunk, FEW)))
"""What the estimator makes of a chunk, once for all tests."""


def judged(monkeypatch: pytest.MonkeyPatch, chunk: int, change=lambda found: found) -> estimator_hostile.HostileRow:
    """A chunk's row, the estimator's answers changed before they are judged."""
    monkeypatch.setattr(estimator_hostile, "estimated_at_random", lambda _: change(_found(chunk)))
    return estimator_hostile.judged_at_random(5, chunk, FEW)


def test_hostile_frames_are_replayed_and_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    _found(0), _found(1)
    rows = [judged(monkeypatch, chunk) for chunk in (0, 1)]
    assert [row.frames for row in rows] == [FEW, FEW]
    assert sum(row.exceptions + row.nan + row.imagined + row.beyond for row in rows) == 0
    assert all(row.claimed > 0 for row in rows)
    first, again = (estimator_hostile.replay(5, 0, FEW) for _ in range(2))
    np.testing.assert_array_equal(first.scenes.points_px, again.scenes.points_px)
    np.testing.assert_array_equal(first.readings_Nm, again.readings_Nm)


def test_hostile_counts_what_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """Contacts moved by ten deviations are found out, and so is a NaN."""
    _found(0)
    before = judged(monkeypatch, 0)
    after = judged(
        monkeypatch,
        0,
        lambda found: replace(
            found,
            distance_m=found.distance_m + 10.0 * found.distance_std_m,
            force_N=np.where(np.arange(3) == 2, np.nan, found.force_N),
        ),
    )
    assert after.claimed == before.claimed
    assert after.nan == after.claimed
    assert after.beyond == after.claimed - after.imagined
