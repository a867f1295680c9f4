"""A rig calibrated again and again: what stays is left in peace, what drifts or scatters is named."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from benchmarks.estimator.setup import Setup
from vbaa_calib.cli.main import main
from vbaa_calib.core.files import read_json, write_json
from vbaa_calib.rig import Rig
from vbaa_calib.rig.over_time import FALSE_ALARM, over_time

from .small_scene import small_rig

TRUE = Setup(exact=False).rig()
STD = np.sqrt(np.diag(TRUE.covariance))
DAYS = np.array([0.0, 7.0, 15.0, 30.0, 61.0, 90.0])


def calibrated(rng: np.random.Generator, moved: np.ndarray) -> list[Rig]:
    """Of rigs that have moved by (N, P) deviations, calibrations with the errors that they state."""
    noise = rng.multivariate_normal(np.zeros(len(STD)), TRUE.covariance, len(moved))
    return [TRUE.moved(step) for step in STD * moved + noise]


def test_what_stays_is_left_in_peace() -> None:
    """Not one of so many rigs in more than the share of false alarms, within what chance allows."""
    draws, still = 150, np.zeros((len(DAYS), len(STD)))
    found = [over_time(calibrated(np.random.default_rng(seed), still), DAYS) for seed in range(draws)]
    for name in ("scatters", "drifts"):
        alarms = sum(bool(getattr(one, name).any()) for one in found)
        assert alarms <= FALSE_ALARM * draws + 4.0 * np.sqrt(FALSE_ALARM * draws)
    unbiased = np.mean([(one.mean - one.values.mean(axis=0))[: len(STD)] / STD for one in found], axis=0)
    assert np.abs(unbiased).max() < 0.1


def test_a_drift_and_a_scatter_are_named_and_measured() -> None:
    moved = np.zeros((len(DAYS), len(STD)))
    moved[:, 3] = 0.4 * DAYS
    moved[:, 14] = 20.0 * np.array([1.0, -1.0, 0.5, -0.2, 1.2, -1.0])
    slopes = []
    for seed in range(30):
        found = over_time(calibrated(np.random.default_rng(seed), moved), DAYS)
        assert found.drifts[3]
        assert found.scatters[14]
        assert not found.drifts[14]
        assert found.between_std[14] == pytest.approx(np.std(moved[:, 14], ddof=1) * STD[14], rel=0.3)
        slopes.append((found.slope_per_day[3] - 0.4 * STD[3]) / found.slope_std_per_day[3])
    assert abs(np.mean(slopes)) < 4.0 / np.sqrt(30)
    assert 0.6 < np.std(slopes) < 1.4


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Sessions whose rigs are there already are not calibrated again; a broken one is named, the rest goes on."""
    rigs = tmp_path / "rigs"
    rigs.mkdir()
    document = read_json(small_rig() / "rig.json")
    paths = []
    for day in range(1, 6):
        path = tmp_path / f"2026-03-0{day}_bench"
        shutil.copytree(small_rig() / "session", path)
        paths.append(str(path))
        drifted = document | {"moment_sensor": document["moment_sensor"] | {"offset_Nm": 1e-3 * day}}
        write_json(rigs / f"{path.name}.json", drifted)
    (Path(paths[1]) / "session.yaml").write_text("nonsense")
    assert main(["calibrate", *reversed(paths), "-o", str(rigs), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["drift"] == ["moment_offset_Nm"]
    assert list(said["failed"]) == ["2026-03-02_bench"]
    assert said["dates"] == [f"2026-03-0{day} 00:00" for day in (1, 3, 4, 5)]
    assert "moment offset drifts" in (rigs / "over_time.html").read_text()
    assert (rigs / "over_time.csv").read_text().count("moment_offset_Nm") == 4
    undated = shutil.copytree(small_rig() / "session", tmp_path / "undated")
    assert main(["calibrate", paths[0], str(undated), "-o", str(rigs)]) == 2
    table = tmp_path / "dates.csv"
    table.write_text(f"session,date\n{paths[0]},2026-03-01\n{undated},yesterday\n")
    assert main(["calibrate", str(table), "-o", str(rigs)]) == 2
