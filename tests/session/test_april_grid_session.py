"""A session whose board is an AprilGrid: jig, sweep, lens, wizard; described there, or by Kalibr's target.yaml."""

from __future__ import annotations

import dataclasses
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from targets.board import AprilGrid
from vbaa_calib.calibrate.lens_from_views import solve_lens
from vbaa_calib.calibrate.pipeline import calibrate
from vbaa_calib.calibrate.report import rig_document
from vbaa_calib.detect.board.corners import detect_folder
from vbaa_calib.rig import Rig
from vbaa_calib.session import load_session
from vbaa_calib.simulate.scene.scene_file import load_scene

from ..made_once import made_once
from ..small_scene import simulated, small_scene

BOARD = AprilGrid("aprilgrid", 4, 3, 0.03, 0.3)
KALIBR = "{target_type: aprilgrid, tagCols: 4, tagRows: 3, tagSize: 0.03, tagSpacing: 0.3}"


def _simulated(folder: Path) -> None:
    scene = small_scene(noload=3, loads=(1, 3, 8, 9))
    scene |= {"board": BOARD.to_dict(), "sweep": True}
    shutil.rmtree(simulated(folder, scene) / "recording")


def written(folder: Path, board: str) -> Path:
    """The session, with another text for its board."""
    shutil.copytree(made_once("april_grid", _simulated) / "session", folder)
    text = (folder / "session.yaml").read_text().splitlines()
    text[1] = f"board: {board}"
    (folder / "session.yaml").write_text("\n".join(text) + "\n")
    return folder


def assert_true(rig: Rig) -> None:
    """Camera, lens and stiffness within four of the stated standard deviations."""
    scene = load_scene(made_once("april_grid", _simulated) / "scene.yaml")
    off = rig.T_antenna_camera.tangent_from(scene.T_antenna_camera)
    std = rig.covariance.diagonal()[:6] ** 0.5
    assert (abs(off) < 4.0 * std).all()
    assert std[3:].max() < 1e-3
    lens = np.array([scene.lens.matrix[i, j] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2))])
    assert (abs(rig.camera.parameters[:4] - lens) < 4.0 * rig.camera.covariance.diagonal()[:4] ** 0.5).all()
    antenna = rig.to_dict()["antenna"]
    true_Nm2 = scene.true.stiffness_factor * scene.antenna.stiffness_Nm2
    assert abs(antenna["stiffness_Nm2"] - true_Nm2) < 4.0 * antenna["stiffness_std_Nm2"]


def test_it_calibrates_also_as_kalibr_describes_it(tmp_path: Path) -> None:
    root = written(tmp_path / "session", "target.yaml")
    (root / "target.yaml").write_text(KALIBR)
    made = calibrate(load_session(root))
    assert_true(made.rig)
    assert [one.way for one in made.plane.estimates] == ["jig", "sweep"]
    document = rig_document(made, [], {})
    assert "target.yaml" in document["inputs_sha256"]
    assert document["quality"]["lens"]["board"] == BOARD.to_dict()


@pytest.mark.parametrize("off", [0.0, 0.003, -0.01])
def test_a_gap_that_is_another_is_named_with_its_size(off: float) -> None:
    """Of a tag; a hundredth is not seen by the search for the board, but by what the corners leave."""
    described = dataclasses.replace(BOARD, spacing=BOARD.spacing + off)
    views = detect_folder(made_once("april_grid", _simulated) / "session" / "intrinsics", described)
    found = [one for one in solve_lens(views, described).verdict.findings if one.name == "tag_spacing"]
    assert [one.severity for one in found] == ([] if not off else ["doubt" if abs(off) < 0.005 else "wrong"])
    for one in found:
        measured, std = (float(number) for number in re.findall(r"0\.\d+", one.words)[:2])
        assert abs(measured - BOARD.spacing) < max(4.0 * std, 2e-4)
