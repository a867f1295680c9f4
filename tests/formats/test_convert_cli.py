"""`vbaa convert`: what it writes, what it says is lost, and what it refuses."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vbaa_calib.camera import Camera
from vbaa_calib.cli import convert as convert_cli
from vbaa_calib.convert import FORMATS
from vbaa_calib.rig import Rig

from ..calibrate.checked_rigs import rig_of, scene


def convert(*words: str | Path) -> dict[str, Any]:
    """What the command line does with these words."""
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--force", action="store_true")
    convert_cli.configure(parser)
    return convert_cli.run(parser.parse_args([str(word) for word in words]))


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """A rig.json with five coefficients and a whole covariance."""
    (tmp_path / "rig.json").write_text(json.dumps(rig_of(scene()).to_dict()))
    return tmp_path / "rig.json"


@pytest.mark.parametrize("name", ["ros", "opencv", "mrcal", "colmap"])
def test_a_rig_there_and_back(name: str, rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = convert(rig, "--to", name, "-o", tmp_path / "theirs")
    said = capsys.readouterr()
    assert said.out == ""
    assert out["from"] == "vbaa"
    assert len(out["lost"]) == said.err.count("lost  ") == (2 if name == "mrcal" else 3)
    assert any("antenna" in words for words in out["lost"])
    assert "the covariance of the lens" in out["lost"]
    assert out["pose"] == (name == "mrcal")
    back = convert(tmp_path / "theirs", "-o", tmp_path / "camera.json")
    assert (back["from"], back["to"]) == (name, "vbaa")
    ours, again = Rig.load(rig), Camera.load(tmp_path / "camera.json")
    np.testing.assert_array_equal(again.matrix, ours.camera.matrix)
    np.testing.assert_array_equal(again.distortion[:5], ours.camera.distortion)
    assert again.covariance is None
    if name == "mrcal":
        pose = FORMATS["vbaa"].read(tmp_path / "camera.json", None).T_reference_camera
        assert pose is not None
        np.testing.assert_allclose(pose.matrix, ours.T_antenna_camera.matrix, atol=1e-14)
