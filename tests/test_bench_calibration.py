"""The calibration benchmark: its rigs, its judge, its table."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.boards import draw, error_mm, rigs
from benchmarks.calibration.calibration import STYLES, run
from benchmarks.calibration.methods import INTERPRETERS, SOLVERS, solve_oracle, solve_with, versions


def test_the_judge_reports_a_wrong_lens_at_its_size() -> None:
    """A centre that is 2 px off moves every point on C by about 2 px; a pose from the jig takes that up."""
    truth = rigs()[1].camera
    assert error_mm(truth, truth) < 1e-9
    off = dataclasses.replace(truth, matrix=truth.matrix + np.array([[0, 0, 0], [0, 0, 2.0], [0, 0, 0]]))
    assert error_mm(off, truth) == pytest.approx(2.0 / 2800 * 400, rel=0.15)
    assert error_mm(off, truth, from_jig=True) < 0.1 * error_mm(off, truth)


def test_draws_are_seeded_and_as_spoilt_as_they_say() -> None:
    rig = rigs()[4]
    first, again, other = draw(rig, 3), draw(rig, 3), draw(rig, 4)
    np.testing.assert_array_equal(first.views[5].corners_px, again.views[5].corners_px)
    assert not np.array_equal(first.poses, other.poses)
    share = 1 - np.mean(np.concatenate(first.good + other.good))
    assert 0.035 < share < 0.065
    assert solve_oracle(first).matrix[0, 0] == pytest.approx(900.0, rel=2e-3)


def test_a_peer_is_driven_in_the_interpreter_that_has_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A lensboy of our own, which answers the true focal length and fails on the second draw."""
    (tmp_path / "lensboy.py").write_text(LENSBOY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv(INTERPRETERS, str(tmp_path / "python"))
    (tmp_path / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (tmp_path / "python").chmod(0o755)
    assert versions()["lensboy"] == f"3.1 ({tmp_path / 'python'})"
    draws = [draw(rigs()[3], seed) for seed in (51, 52)]
    first, second = solve_with("lensboy", sys.executable, draws)
    assert first.camera is not None
    np.testing.assert_array_equal(first.camera.parameters, [900, 901, 640, 360, *np.arange(5)])
    assert first.good_dropped == pytest.approx(8 / sum(len(view.ids) for view in draws[0].views))
    assert 0.0 <= first.seconds < 1.0
    assert second.camera is None
    assert "no luck" in second.failure


LENSBOY = """
from types import SimpleNamespace
import numpy as np
from types import SimpleNamespace as OpenCVConfig
__version__ = "3.1"
solved = 0
def Frame(ids, corners):
    return SimpleNamespace(ids=ids, corners=corners)
def calibrate_camera(points, frames, config):
    global solved
    solved += 1
    if solved == 3:
        raise RuntimeError("no luck")
    assert points.shape == (70, 3) and config.image_width == 1280 and config.included_distortion_coefficients.sum() == 5
    camera = SimpleNamespace(fx=900, fy=901, cx=640, cy=360, distortion_coeffs=np.arange(14.0))
    seen = [SimpleNamespace(inlier_mask=np.arange(len(frame.ids)) > 0) for frame in frames]
    return SimpleNamespace(camera_model=camera, frame_diagnostics=seen)
"""


@pytest.mark.slow
def test_the_table_holds_every_method_on_every_rig() -> None:
    rows = run(draws=1, seed=5)
    methods = {row.method for row in rows}
    assert methods == {*SOLVERS, "lensboy", "mrcal"} == set(STYLES)
    assert len(rows) == len(rigs()) * len(methods)
    for row in rows:
        assert row.error_mm is not None or row.note
        assert row.method != "oracle" or row.ratio == 1.0
    spoilt = {row.method: row for row in rows if "outliers" in row.rig}
    assert spoilt["OpenCV, default"].jig_ratio > 3 * spoilt["ours, lens given"].jig_ratio
    assert spoilt["ours, auto"].outliers_found == 1.0
