"""A further camera: calibrated like the first, by pictures of its own, and joined with it in one rig."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from vbaa_calib.core.files import read_json, read_yaml
from vbaa_calib.rig import Rig
from vbaa_calib.wizard.questions import BY_KEY
from vbaa_calib.wizard.store import Store

from ..cli.test_several_cameras import two_cameras
from ..csv_files import read_rows, write_rows
from .small_session import answers_file, answers_with, call


def pictures_of(session: Path, camera: str, folder: Path) -> Path:
    """One camera's pictures and tables of a session of several, as its program would leave them."""
    for name in ("intrinsics", "plane", "noload", "loads"):
        shutil.copytree(session / name / camera, folder / name)
    for name in ("noload", "loads"):
        rows = []
        for row in read_rows(session / name / f"{name}.csv"):
            others = {key: value for key, value in row.items() if not key.startswith("image_")}
            rows.append({"image": Path(row[f"image_{camera}"]).name} | others)
        write_rows(folder / name / f"{name}.csv", rows)
    return folder


def test_two_cameras_come_into_one_rig(tmp_path: Path) -> None:
    """Without anybody there the second one's session goes on by itself; the antenna is known better than by either, and
    both cameras are where they are."""
    made = two_cameras()
    board = read_yaml(made / "session" / "session.yaml")["board"]
    size_m = board["square_m"] * board["squares_x"], board["square_m"] * board["squares_y"]
    session, right = tmp_path / "session", tmp_path / "session" / "cameras" / "right"
    known = {}
    for name in ("left", "right"):
        source = pictures_of(made / "session", name, tmp_path / name)
        known[name] = answers_with(made / "session" / "session.yaml", size_m, source)
        known[name] |= {"jig_translation_mm": [36, 60, -8], "jig_turn_deg": [0, 0, 0], "jig_std_mm": 0.2}
    with Store(right) as own:
        own.answer({key: BY_KEY[key].read(value) for key, value in known["right"].items()})
    first = answers_file(tmp_path / "left.yaml", known["left"])
    code, said = call(session, "--answers", first, "--another-camera", "right")
    assert code == 0, said
    rig, truth = Rig.load(session / "rig.json"), read_json(made / "session" / "truth.json")
    assert list(rig.cameras) == ["camera", "right"]
    for name, one in zip(("left", "right"), rig.cameras.values(), strict=True):
        off_m = one.T_antenna_camera.translation_m - truth["cameras"][name]["T_antenna_camera"]["translation_m"]
        assert (np.abs(off_m) < 4.0 * np.sqrt(np.diag(one.covariance)[3:6])).all(), name
    alone = Rig.load(right / "rig.json")
    assert rig.std("log_stiffness_Nm2") <= 1.001 * alone.std("log_stiffness_Nm2")
