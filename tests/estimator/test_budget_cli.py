"""`vbaa budget`: tables, files, figure, and what it refuses."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.cli.budget import configure, run
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

from .budget_draws import correlated_rig

ONE = ("--distance", "140", "--force-y", "60", "--force-z", "-40")


def arguments(*words: str | Path) -> argparse.Namespace:
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--force", action="store_true")
    configure(parser)
    return parser.parse_args([str(word) for word in words])


def written(path: Path, rig: Rig | None = None) -> Path:
    path.write_text(json.dumps((correlated_rig() if rig is None else rig).to_dict()))
    return path


def test_the_whole_antenna(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = written(tmp_path / "rig.json")
    result = run(arguments(rig, "-o", tmp_path / "budget.json", "--figure", tmp_path / "budget.png"))
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    assert result["asked"] == 144
    for name in ("distance_m", "force_y_N", "force_z_N", "point_m"):
        causes = result["results"][name]["causes"]
        assert sum(cause["share"] for cause in causes.values()) == pytest.approx(1.0)
        assert result["results"][name]["improve_first"] in causes
    whole = json.loads((tmp_path / "budget.json").read_text())
    assert whole["schema"] == "vbaa.budget/1"
    assert len(whole["by_contact"]) == result["contacts"]
    mean = np.mean([contact["std"]["distance_m"] ** 2 for contact in whole["by_contact"]])
    assert np.sqrt(mean) == pytest.approx(result["results"]["distance_m"]["std"])
    one = whole["by_contact"][0]
    parts = [part["point_m"] ** 2 for part in one["by_cause"].values()]
    assert np.sqrt(sum(parts)) == pytest.approx(one["std"]["point_m"])
    picture = cv2.imread(str(tmp_path / "budget.png"))
    assert picture is not None
    assert picture.std() > 10.0
    assert "counted as exact: clamp give, joint axes" in capsys.readouterr().err


def test_one_contact(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a rig without a lens; and of one without errors."""
    rig = written(tmp_path / "rig.json", correlated_rig(lens=False))
    result = run(arguments(rig, *ONE, "--tilt", "20", "--figure", tmp_path / "one.svg"))
    assert result["contacts"] == 1
    assert result["tilt_rad"] == pytest.approx(np.radians(20.0))
    assert (tmp_path / "one.svg").read_text().startswith("<?xml")
    assert "without the lens" in capsys.readouterr().err
    exact = replace(correlated_rig(lens=False), covariance=np.zeros((17, 17)))
    path = written(tmp_path / "exact.json", exact)
    result = run(arguments(path, *ONE, "--friction", "0", "--figure", tmp_path / "exact.png"))
    assert "says that the whole rig is exact" in capsys.readouterr().err
    assert result["improve_first"]["of_calibration"] is None


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("--distance -5 --force-y 50 --force-z 0", "not on the antenna"),
        ("--distance 140 --force-y 1e300 --force-z 0", "bends the antenna further"),
        ("--distance 140 --force-y 0 --force-z 0", "no numbers"),
        ("--distance 140 --force-y 0.0001 --force-z 0", "no numbers"),
        ("--tilt nan", "--tilt is nan"),
    ],
)
def test_what_makes_no_sense_is_refused(words: str, what: str, tmp_path: Path) -> None:
    """Beside `tests/hostile`."""
    with pytest.raises(InputError, match=what):
        run(arguments(written(tmp_path / "rig.json"), *words.split()))
