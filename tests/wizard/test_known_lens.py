"""The wizard with a lens that is known: no pictures for it, and the rig is the one that the lens leads to."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from vbaa_calib.core.files import read_json
from vbaa_calib.rig import Rig

from ..small_scene import small_rig
from .small_session import answers, answers_file, call, expect_line, rendered


def test_a_known_lens_takes_the_place_of_its_pictures(tmp_path: Path) -> None:
    source, session, file = tmp_path / "pictures", tmp_path / "session", tmp_path / "camera.json"
    shutil.copytree(rendered(), source, ignore=shutil.ignore_patterns("intrinsics"))
    usual = Rig.load(small_rig() / "rig.json")
    given = answers(source)
    for name in ("camera_distance_mm", "camera_inclination_deg"):
        del given[name]
    told = answers_file(tmp_path / "answers.yaml", given)
    file.write_text("{}")
    expect_line(call(session, "--answers", told, "--camera", file), "camera.json")
    assert not session.exists()
    file.write_text(json.dumps(usual.camera.to_dict()))
    code, said = call(session, "--answers", told, "--camera", file)
    assert code == 0, said
    document = read_json(session / "rig.json")
    assert document["quality"]["given_lens"]["file"] == "camera.json"
    assert not (session / "intrinsics").exists()
    rig = Rig.load(session / "rig.json")
    off = rig.T_antenna_camera.tangent_from(usual.T_antenna_camera)
    assert (abs(off) < 4.0 * (rig.covariance.diagonal()[:6] + usual.covariance.diagonal()[:6]) ** 0.5).all()
