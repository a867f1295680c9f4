"""The whole way on every bundled scene, by the commands that a user types, against the goals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.cli.main import main
from viz.cli.demo import SCENES

HARD = [pytest.param(name, marks=pytest.mark.slow) for name in SCENES[1:]]


@pytest.fixture(scope="module", params=[SCENES[0], *HARD])
def demo(request, tmp_path_factory) -> Path:
    """A finished demo's folder."""
    out = tmp_path_factory.mktemp("demo") / request.param
    assert main(["demo", "--scene", request.param, "--out", str(out)]) == 0
    return out


def test_reaches_the_goals(demo: Path) -> None:
    """Contact point, distance, force, direction, stiffness and focal length, and no frame dropped or misjudged."""
    summary = json.loads((demo / "summary.json").read_text())
    assert summary["contact_point_rmse_m"] <= 1.5e-3
    assert summary["distance_rmse_m"] <= 0.02 * 0.24
    assert summary["force_rmse_relative"] <= 0.08
    assert summary["direction_rmse_rad"] <= np.radians(4)
    assert summary["stiffness_relative_error"] <= 0.02
    assert summary["focal_relative_error"] <= 0.005
    assert summary["frames_ok"] == summary["frames"]
    assert all(np.isfinite(value) for value in summary.values() if isinstance(value, float))


def test_predicted_uncertainty_is_honest(demo: Path) -> None:
    """The mean squared error over its predicted variance, per degree of freedom, is neither blind nor timid."""
    assert 0.1 < json.loads((demo / "summary.json").read_text())["nees"] < 2.5
