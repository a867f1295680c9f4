"""The wizard with a lens that is known: no pictures for it, and the rig is the one that the lens leads to."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vbaa_calib.camera import Camera
from vbaa_calib.core.files import read_json
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.scene.scene_file import load_scene

from .small_session import answers, answers_file, call, expect_line, rendered


@pytest.mark.slow
def test_a_known_lens_takes_the_place_of_its_pictures(tmp_path: Path) -> None:
    source, session, file = tmp_path / "pictures", tmp_path / "session", tmp_path / "camera.json"
    shutil.copytree(rendered(), source, ignore=shutil.ignore_patterns("intrinsics"))
    scene = load_scene(rendered().parent / "scene.yaml")
    # of pictures twice as large
    whole = tuple(2 * side for side in scene.lens.image_size)
    matrix = np.array([[2.0, 0.0, 0.5], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]]) @ scene.lens.matrix
    true = Camera(scene.lens.model, whole, matrix, scene.lens.distortion)
    std = np.array([1.0, 1.0, 1.0, 1.0, 1e-3, 3e-3, 1e-4, 1e-4])
    given = answers(source)
    for name in ("camera_distance_mm", "camera_inclination_deg"):
        del given[name]
    told = answers_file(tmp_path / "answers.yaml", given)
    file.write_text("{}")
    expect_line(call(session, "--answers", told, "--camera", file), "camera.json")
    expect_line(call(session, "--answers", told, "--camera", file, "--binning", "half"), "binning")
    assert not session.exists()
    expect_line(call(session, "--answers", told, "--rectified"), "there is none")
    file.write_text(json.dumps(replace(true, covariance=np.diag(std**2)).to_dict()))
    code, said = call(session, "--answers", told, "--camera", file, "--binning", 2)
    assert code == 0, said
    document = read_json(session / "rig.json")
    assert document["quality"]["given_lens"]["file"] == "camera.json"
    assert not (session / "intrinsics").exists()
    rig = Rig.load(session / "rig.json")
    off = rig.T_antenna_camera.tangent_from(scene.T_antenna_camera)
    assert (abs(off) < 4.0 * rig.covariance.diagonal()[:6] ** 0.5).all()
