"""The second half of `vbaa bench estimator`: hard cases, frames at random."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.estimator.hard import CASES, Hard, estimated, judged_at_random, resized, run
from benchmarks.estimator.setup import Setup
from benchmarks.waiting.frames import population


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
    frames = population(Setup().rig(), 5, 3).scenes
    length, large = frames.rig.antenna.length_m, resized(frames.rig, 1e3)
    twin = replace(frames, rig=large, moment_Nm=1e3 * frames.moment_Nm)
    ours, theirs = (estimated(Hard(each), "elastica").distance_m for each in (frames, twin))
    np.testing.assert_allclose(theirs / (1e3 * length), ours / length, rtol=1e-6)


def test_frames_at_random_are_never_wrong_with_confidence() -> None:
    rows = [judged_at_random(5, chunk, 16) for chunk in (0, 1)]
    assert [row.frames for row in rows] == [16, 16]
    assert sum(row.exceptions + row.nan + row.imagined + row.beyond for row in rows) == 0
    assert all(row.claimed > 0 for row in rows)
