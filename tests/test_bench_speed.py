"""`vbaa bench speed`: its frames and rivals are fair, both trees get the same, and a tree agrees with itself."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator.baselines import PARTS, at_shares, baselines, one_contact
from benchmarks.estimator.setup import Setup
from benchmarks.speed.frames import Judged, as_measured, population
from benchmarks.speed.speed import Job, both
from benchmarks.speed.trees import HERE, ROOT, Tree, Worker, older
from vbaa_calib.core.errors import InputError


@cache
def exact() -> Judged:
    return population(Setup().rig(), 40, 3)


def test_baselines_pick_the_parts_they_are_named_after_and_stay_off_the_bound() -> None:
    frames = exact().scenes
    for name, ends in PARTS.items():
        arclength = frames.arclength_m[at_shares(frames, ends)]
        beyond = arclength > frames.distance_m[:, None]
        expected = {"two curved points": (0, 0), "two straight points": (1, 1), "one of each": (0, 1)}[name]
        assert (beyond == np.array(expected, bool)).all()
    every = np.arange(len(frames))
    for solve in baselines(frames, np.random.default_rng(1)).values():
        off = exact().errors(solve(every))
        assert np.isfinite(off).mean() > 0.9
        assert 1.5 < np.sqrt(np.nanmean(off**2)) < 60.0
        np.testing.assert_array_equal(solve(every[5:6]), solve(every)[5:6])


def test_the_loop_is_a_fair_one() -> None:
    """SciPy's loop reaches the bound too: within the scatter of so few frames."""
    off = exact().errors(np.array([one_contact(exact().scenes, index)[0] for index in range(30)]))
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4


@pytest.mark.slow
def test_a_tree_agrees_with_itself(tmp_path: Path) -> None:
    """Frames of a calibrated rig, lens and all, go to two workers of this tree: the same answers, near the bound."""
    rig = as_measured(Setup(tilt_rad=0.5, real=True, exact=False).rig())
    rig = rig.with_covariance(np.diag(np.append(np.diag(rig.covariance), [0.04] * 4 + [1e-8] * 4)))
    judged = population(rig, 12, 0, 0.2, 50)
    with Worker(HERE) as one, Worker(Tree("again", HERE.python, ROOT)) as other:
        job = Job("calibrated", "batch", "batch", rig, judged.given, judged=judged)
        row = both(job, {"this tree": one, "again": other}, 1, tmp_path)
    assert (row.statuses, row.answered) == ((), 1.0)
    assert (row.l_apart_most, row.force_apart_most) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert row.of_bound == pytest.approx(row.of_bound_before)
    assert row.of_bound is not None
    assert 0.4 < row.of_bound < 1.8


def test_a_commit_that_is_not_there_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(InputError, match="no-such-commit"):
        older("no-such-commit")
    assert not list(tmp_path.iterdir())
